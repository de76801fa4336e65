"""Choose a method and its options; look at what the sensor's weight changes.

python examples/03_options.py
"""

from dataclasses import asdict

import numpy as np

import rakelight
from rakelight.synthetic import SceneOptions, make_albedo, make_shape, render_scene

vase = make_shape("vase")
scene = SceneOptions(camera=vase.camera.scaled(0.2), photographs=8)
capture, _ = render_scene(vase, make_albedo("pattern"), scene)

# The options' type says which method is meant; every option has a default.
for options in (
    rakelight.MultiLight(),
    rakelight.MultiLight(depth_weight=100.0),
    rakelight.MultiLightAlternating(max_iterations=5),
    rakelight.FusionLike(),  # looks at the first photograph only
):
    result = rakelight.refine(capture, options)
    moved_mm = 1000 * np.nanmedian(np.abs(result.depth - result.prepared_depth))
    changed = {
        name: value
        for name, value in asdict(options).items()
        if value != getattr(type(options)(), name)
    }
    print(f"{result.method:24} {changed or 'defaults'!s:24} moved the depth by {moved_mm:.2f} mm")

# On the command line the same is `rakelight refine CAPTURE -o OUT --set depth_weight=100`.

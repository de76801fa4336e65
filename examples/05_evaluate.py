"""Compare a result with the truth of a synthetic capture, and with the depth it started from.

python examples/05_evaluate.py
"""

import numpy as np

import rakelight
from rakelight.metrics import evaluate_depth
from rakelight.synthetic import SceneOptions, make_albedo, make_shape, render_scene

vase = make_shape("vase")
scene = SceneOptions(camera=vase.camera.scaled(0.25), photographs=8)
capture, truth = render_scene(vase, make_albedo("pattern"), scene)
result = rakelight.refine(capture)

before = evaluate_depth(result.prepared_depth, result.camera, truth)
after = rakelight.evaluate(result, truth)
print("            depth, rms    normals, mean    coverage")
for name, scores in (("prepared", before), ("refined", after)):
    print(
        f"{name:10}{scores.depth.rmse_mm:9.2f} mm{scores.normals.mae_deg:13.2f} deg"
        f"{100 * scores.depth.coverage:10.0f} %"
    )

# Only part of the object: the pixels whose depth the method itself expects to be good.
expected_m = result.depth_sigma
assert expected_m is not None  # multi-light gives it
surest = truth.mask & (expected_m < np.nanmedian(expected_m))
best = rakelight.evaluate(result, truth, surest)
print(f"the surer half: {best.depth.rmse_mm:.2f} mm, {best.normals.mae_deg:.2f} deg")

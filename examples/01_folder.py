"""From a capture folder to a result folder, as `rakelight refine` does it.

    python examples/01_folder.py

A capture of your own has rgb/, depth/ and capture.toml; what they hold: docs/reference/files.md.
Here a small synthetic one stands in.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import rakelight
from rakelight.synthetic import SceneOptions, make_albedo, make_shape, render_scene


def write_example_capture(folder: Path) -> None:
    """A vase under eight lights, depth at half the photographs' resolution."""
    vase = make_shape("vase")
    options = SceneOptions(camera=vase.camera.scaled(0.25), photographs=8)
    capture, truth = render_scene(vase, make_albedo("pattern"), options)
    rakelight.write_capture(capture, folder, truth=truth)


with TemporaryDirectory() as scratch:
    write_example_capture(Path(scratch) / "vase")

    capture = rakelight.load_capture(Path(scratch) / "vase")
    result = rakelight.refine(capture)
    for finding in result.findings:
        print(f"{finding.severity}: {finding.message}")
    rakelight.save_result(result, Path(scratch) / "out")

    again = rakelight.load_result(Path(scratch) / "out")
    height, width = again.depth.shape
    print(f"{again.method}: {width} x {height}, {again.mask.sum()} pixels")
    print("files:", ", ".join(sorted(path.name for path in (Path(scratch) / "out").iterdir())))

"""Scans and the paper's bust in paints that one photograph cannot tell from relief.

    python tests/quality/no_harm.py           every method for one photograph on all of them

Not worse than the prepared depth by more than 2 %, in depth and in normals, is what the methods
promise; `*` marks what is worse.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from rakelight.geometry.normals import surface_normals
from rakelight.methods import METHODS, load_method
from rakelight.metrics import evaluate_maps
from rakelight.model import silent
from rakelight.paper.scenes import SCENARIOS, paper_object, paper_scene
from rakelight.prepare import prepare
from rakelight.synthetic import (
    DepthNoise,
    SceneOptions,
    make_albedo,
    make_shape,
    render_scene,
    shape_from_file,
)
from rakelight.synthetic.albedo import Albedo

ONE_PHOTOGRAPH = [name for name in METHODS if load_method(name).lighting != "moving-lamp"]
SCANS = sorted((Path(__file__).resolve().parents[3] / "shared" / "shapes").glob("*.npz"))
NOISE = {
    "white": DepthNoise(rms_mm=3.3),
    "smooth": DepthNoise(rms_mm=3.3, correlation_length_px=7.0),
}
SIDE = 512  # of the texture
LOOP_PX = 10  # half a period, in pixels of twice the object's resolution


def natural_paint(seed=0):
    """Paint with the statistics of photographs: amplitudes fall as 1/f, and objects have edges.

    Leaves of all sizes lie on each other, each with a colour of its own; brightness varies more
    than colour does.
    """

    def paint(camera, rows):
        import cv2

        side = max(camera.shape)
        image = cv2.resize(_texture(seed), (side, side), interpolation=cv2.INTER_AREA)
        top, left = (side - camera.height) // 2, (side - camera.width) // 2
        window = image[top : top + camera.height, left : left + camera.width]
        return np.clip(window, 0.03, 0.95).astype(np.float32)[rows]

    return Albedo(f"natural {seed}", paint)


@cache
def _texture(seed):
    """(SIDE, SIDE, 3) the reflectance of `natural_paint`."""
    rng = np.random.default_rng(seed)
    row, column = np.mgrid[:SIDE, :SIDE]
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(SIDE), np.fft.fftfreq(SIDE)))
    frequency[0, 0] = np.inf
    clouds = rng.normal(size=(4, SIDE, SIDE))
    clouds = np.fft.ifft2(np.fft.fft2(clouds) / frequency).real
    clouds /= clouds.std(axis=(1, 2), keepdims=True)
    leaves = np.zeros((SIDE, SIDE, 3))
    for _ in range(400):
        radius = min(8 * rng.random() ** -0.5, 120.0)
        y, x = rng.uniform(0, SIDE, 2)
        inside = (row - y) ** 2 + (column - x) ** 2 < radius**2
        leaves[inside] = 0.35 * rng.normal() + 0.06 * rng.normal(size=3)
    log = 0.35 * clouds[0][..., None] + 0.12 * np.moveaxis(clouds[1:], 0, -1) + leaves
    return 0.3 * np.exp(log)


def woven_paint(camera, rows):
    """Paint of one hue that looks like yarn: loops of 10 of the object's pixels."""
    row, column = np.mgrid[: camera.height, : camera.width] * np.pi / LOOP_PX
    loops = np.sin(row) * np.cos(column)
    return np.repeat(0.4 + 0.16 * loops[rows, :, None], 3, axis=-1).astype(np.float32)


@cache
def scene(name, paint, noise, lighting, size=0.5, factor=1):
    """Prepared capture and truth of a scan or the bust (name "head") at `size`.

    factor : colour pixels per depth pixel, along each side; of scans
    """
    if name == "head":
        capture, truth = paper_scene(paint, lighting, size, _bust())
    else:
        files = {path.stem: path for path in SCANS}
        shape = shape_from_file(files[name]) if name in files else make_shape(name)
        if "natural" in paint:
            albedo = natural_paint(int(paint[-1]))
        else:
            albedo = Albedo(paint, woven_paint) if paint == "woven" else make_albedo(paint)
        options = SceneOptions(
            lighting=lighting,
            camera=shape.camera.scaled(size),
            depth_factor=factor,
            depth_noise=NOISE[noise],
        )
        capture, truth = render_scene(shape, albedo, options)
    return prepare(capture), truth


_bust = cache(paper_object)


def scores(prepared, log_depth, truth):
    """RMSE in mm and MAE in degrees."""
    depth = np.exp(log_depth)
    normals = surface_normals(depth, prepared.mask, prepared.camera)
    found = evaluate_maps(prepared.embed(depth, np.nan), prepared.embed(normals, np.nan), truth)
    return np.array([found.depth.rmse_mm, found.normals.mae_deg])


def before_and_after(method, *case):
    """The scores of the prepared depth and of the method's."""
    chosen = load_method(method)
    prepared, truth = scene(case[0], case[1], case[2], chosen.lighting, *case[3:])
    estimate = chosen.run(prepared, chosen.options(), silent)
    return (
        scores(prepared, np.log(prepared.depth_m), truth),
        scores(prepared, estimate.log_depth, truth),
    )


CASES = [("head", paint, "as the paper's", size) for size in (1.0, 0.5) for paint in SCENARIOS]
CASES += [
    (path.stem, paint, noise)
    for path in SCANS
    for noise in NOISE
    for paint in ("natural 0", "natural 1", "pattern")
]
# Nothing is promised of a coarser depth map, nor of paint that looks like yarn.
BEYOND = [
    *((path.stem, paint, "white", 0.5, 2) for path in SCANS for paint in ("natural 1", "pattern")),
    *((path.stem, "woven", "white") for path in SCANS),
]


def main():
    """Print the table of docs/results/single-photograph.md."""
    print("| object, paint, noise | input |", " | ".join(ONE_PHOTOGRAPH), "|")  # noqa: T201
    print("| --- | --- |" + " --- |" * len(ONE_PHOTOGRAPH))  # noqa: T201
    for case in CASES + BEYOND:
        cells = []
        for method in ONE_PHOTOGRAPH:
            before, after = before_and_after(method, *case)
            harm = " \\*" if (after > 1.02 * before).any() else ""
            cells.append(f"{after[0]:.2f} / {after[1]:.1f}{harm}")
        size = f", {case[3]:g}" if len(case) == 4 else ""
        size += f", factor {case[4]}" if len(case) > 4 else ""
        name = f"{case[0]}, {case[1]}, {case[2]}{size}"
        print(f"| {name} | {before[0]:.2f} / {before[1]:.1f} |", " | ".join(cells), "|")  # noqa: T201


if __name__ == "__main__":
    main()

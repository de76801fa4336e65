"""The figures of docs/explanation/depth-sensor.md: python benchmarks/depth_sensor.py [CAPTURES]

CAPTURES is the folder with the real captures mitten, android and monkey; those that are missing are
left out.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # the tests are a package there
from rakelight import load_capture
from rakelight.geometry.grid import area_mean
from rakelight.prepare.average import nan_median, scatter
from rakelight.prepare.flying import flying
from rakelight.prepare.mask import cut_out, nearest_object
from rakelight.prepare.register import register, sensor_grid
from tests.prepare.ray_traced import COLOUR, POSE, depth_of
from tests.prepare.test_prepare_flying import CAMERA, SIGMA, wrong_by
from tests.prepare.test_prepare_mask import flat_on_a_table
from tests.prepare.test_prepare_register import DEPTH, jumps


def flying_pixels() -> None:
    """How many of the pixels that are wrong by more than 20 mm are left."""
    rays, truth = depth_of(CAMERA.scaled(4)), depth_of(CAMERA)
    for blur_px in (0.0, 0.3, 0.5, 0.7, 1.0):
        depth = area_mean(gaussian_filter(rays, 4 * blur_px) if blur_px else rays, 4)
        wrong = wrong_by(depth, truth) > 0.02
        left = wrong & ~flying(depth, SIGMA.at(depth), CAMERA)
        share = left.sum() / wrong.sum()
        print(f"flying, blur {blur_px} px: {left.sum()} of {wrong.sum()} left ({share:.1%})")


def registration() -> None:
    """Errors of registered depth away from jumps."""
    for factor, camera in DEPTH.items():
        depth, grid = depth_of(camera, POSE), sensor_grid(COLOUR, camera)
        found, _ = register(depth, depth, camera, POSE, grid)
        truth = depth_of(grid)
        seen = np.isfinite(found) & ~jumps(truth)
        off_mm = 1000 * np.abs(found - truth)[seen]
        figures = ", ".join(f"{np.quantile(off_mm, q):.3g}" for q in (0.5, 0.99, 1))
        print(f"registered at 1/{factor}: error median, 99 %, worst {figures} mm")


def flat_objects() -> None:
    """Of flat objects on a table, how much is found, by their width."""
    for height_mm in (6, 8, 9, 10, 12, 15, 20):
        overlaps = []
        for wide_px in (40, 60, 80, 100, 120, 140):
            margin = (160 - wide_px) // 2
            beside = slice(margin, 160 - margin)
            *sensed, truth = flat_on_a_table(slice(18, 102), beside, height_mm / 1000)
            found = nearest_object(*sensed)
            mask = np.ones_like(truth) if found is None else found.mask
            overlaps.append((mask & truth).sum() / (mask | truth).sum())
        print(f"flat, {height_mm} mm high: IoU " + ", ".join(f"{x:.2f}" for x in overlaps))


def real_captures(folder: Path) -> None:
    """The masks of people against those cut out, and the noise of several maps."""
    for name in ("mitten", "android", "monkey"):
        if not (folder / name).is_dir():
            continue
        capture = load_capture(folder / name)
        mask, (finding,) = cut_out(replace(capture, mask=np.ones_like(capture.mask)))
        union, both = (mask | capture.mask).sum(), (mask & capture.mask).sum()
        print(
            f"{name}: IoU {both / union:.3f}, {both / capture.mask.sum():.1%} found, "
            f"{finding.severity}"
        )
        if len(capture.depth_m) > 1:
            small = area_mean(capture.mask, capture.mask.shape[0] // capture.depth_m.shape[1]) > 0
            share = scatter(capture.depth_m) / nan_median(capture.depth_m) ** 2
            figures = np.nanquantile(share[small], [0.05, 0.5, 0.95])
            print(
                f"{name}: scatter / z^2, 5 %, median, 95 %: "
                + ", ".join(f"{x:.2e}" for x in figures)
            )


if __name__ == "__main__":
    flying_pixels()
    registration()
    flat_objects()
    real_captures(Path(sys.argv[1] if len(sys.argv) > 1 else "../shared/captures"))

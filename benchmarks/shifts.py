"""What `refine` says of depth and of photographs that were shifted on purpose: two tables.

python benchmarks/shifts.py ../shared/captures/mitten      # captures of yours; none is fine
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import cv2
import numpy as np

from rakelight import load_capture
from rakelight.check.camera_motion import camera_motion
from rakelight.check.depth_shift import depth_shift
from rakelight.check.measured import Measured
from rakelight.errors import CaptureError
from rakelight.model import Capture, Finding
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene

DEPTH_SHIFTS = (0, 1, 2, 3, 5, 8, 15, 30)
CAMERA_SHIFTS = (0, 0.5, 1, 2, 5, 15, 30)
AXES = {"right": (1, 0), "up": (0, -1)}


def captures(folders: list[str]) -> Iterator[tuple[str, Capture]]:
    """Those named, and synthetic ones with depth at half and a quarter of the resolution."""
    for folder in folders:
        yield folder.rstrip("/").rsplit("/", 1)[-1], load_capture(folder)
    noise = DepthNoise(rms_mm=2.5, correlation_length_px=6.0, step_mm=1.0, hole_fraction=0.05)
    for name, paint, factor in (
        ("vase", "pattern", 2),
        ("head", "pattern", 2),
        ("cloth", "white", 4),
        ("coin", "complicated", 1),
        ("sphere", "white", 2),
    ):
        options = SceneOptions(depth_factor=factor, depth_noise=noise)
        yield f"{name} /{factor}", render_scene(make_shape(name), make_albedo(paint), options)[0]


def depth_moved(capture: Capture, right: float, down: float) -> Capture:
    """Depth maps shifted by photograph pixels, between the pixels as the nearest is."""
    factor = capture.camera.width / capture.depth_m.shape[2]
    steps = round(down / factor), round(right / factor)
    return replace(capture, depth_m=np.roll(capture.depth_m, steps, axis=(1, 2)))


def camera_moved(capture: Capture, first: int, last: int, right: float, down: float) -> Capture:
    """Photographs first..last shifted by pixels."""
    photographs, (height, width) = capture.photographs.copy(), capture.camera.shape
    shift = np.array([[1.0, 0.0, right], [0.0, 1.0, down]])
    for i in range(first, last + 1):
        photographs[i] = cv2.warpAffine(
            photographs[i], shift, (width, height), borderMode=cv2.BORDER_REPLICATE
        )
    return replace(capture, photographs=photographs)


def said(check: Any, capture: Capture) -> str:
    """What a person reads of the pixels, or -."""
    try:
        found: tuple[Finding, ...] = check(Measured(capture))
    except CaptureError as error:
        return "refused: " + error.seen.removeprefix("shifted by about ")
    return found[0].message.rsplit("shifted by ", 1)[1] if found else "-"


def main(folders: list[str]) -> None:
    """Print both tables."""
    print("| capture | depth shifted | said |\n| --- | --- | --- |")
    scenes = list(captures(folders))
    for name, capture in scenes:
        for axis, (x, y) in AXES.items():
            for px in DEPTH_SHIFTS:
                words = said(depth_shift, depth_moved(capture, px * x, px * y))
                print(f"| {name} | {px} {axis} | {words} |")
    print("\n| capture | photographs | shifted | said |\n| --- | --- | --- | --- |")
    for name, capture in scenes:
        last = len(capture.photographs) - 1
        if last == 0:
            continue
        for which in ((last // 3, last // 3), (last // 2 + 1, last)):
            for px in CAMERA_SHIFTS:
                words = said(camera_motion, camera_moved(capture, *which, px, 0))
                print(f"| {name} | {which[0]} to {which[1]} | {px} right | {words} |")


if __name__ == "__main__":
    main(sys.argv[1:])

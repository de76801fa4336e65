"""What the way through a recording costs, and which frames of a video are taken.

    python -m benchmarks.recordings formats              # phones' files against the same frames
    python -m benchmarks.recordings dropped                  # frames with faults, and good ones
    python -m benchmarks.recordings shots                    # the same of 20 to 60 single shots
    python -m benchmarks.recordings chosen --seeds 100:107   # 16 photographs against evenly spaced

From the project's root: the recordings are those of the tests.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from rakelight import Capture, evaluate, load_capture, refine
from rakelight.capture.recording import PHOTOGRAPHS, evenly
from rakelight.capture.video.choice import most_different
from rakelight.capture.video.frames import look_through
from rakelight.capture.video.judging import reasons_to_drop
from rakelight.capture.video.light import explained
from rakelight.capture.video.positions import positions
from rakelight.model import silent
from tests.capture.moving_lamp import make_video, single_shots
from tests.capture.readers import phone_sources as phone

FRAMES = 120
SEEDS = {"shots": "300:400"}
"""Of the parts, where they are not 40:64."""


def formats(_: range) -> None:
    """Errors of refined recordings, on the object's true mask."""
    made, truth = phone.scene()
    direct = Capture.from_arrays(
        phone.frames(), phone.expected(phone.depth_maps()), phone.CAMERA, encoding="srgb",
        depth_camera=made.depth_camera, depth_to_color=made.depth_to_color, mask=truth.mask,
    )  # fmt: skip
    with TemporaryDirectory() as scratch:
        folder = Path(scratch)
        sources = {"Record3D": phone.write_r3d(folder / "a.r3d")}
        for crf in (18, 23):
            sources[f"H.264, crf {crf}"] = phone.write_stray(folder / f"crf{crf}", crf=crf)
        captures = {name: load_capture(source) for name, source in sources.items()}
    for name, capture in {"the frames themselves": direct, **captures}.items():
        found = evaluate(refine(replace(capture, mask=truth.mask)), truth)
        print(f"{name}: {found.depth.rmse_mm:.2f} mm, {found.normals.mae_deg:.2f} degrees")


def dropped(seeds: range) -> None:
    """How many frames with each fault are dropped, and how many good ones."""
    lost, there = Counter[str](), Counter[str]()
    for seed in seeds:
        video = make_video(
            seed, FRAMES, size=0.6, arm=0.12, blurred=0.06, over=0.04, shake=3,
            bump=(None, 80, 35)[seed % 3], bump_px=(4, 2, 1.5)[seed % 3],
            quality=(0, 90)[seed % 2], flicker=(0, 0.05)[seed // 2 % 2],
        )  # fmt: skip
        count_dropped(video, f"video {seed}", lost, there)
    print_dropped(lost, there)


def shots(seeds: range) -> None:
    """The same of single shots under lamps far from each other, a third of the sets all good."""
    lost, there = Counter[str](), Counter[str]()
    for seed in seeds:
        count = (20, 24, 30, 40, 60)[seed % 5]
        lamp = single_shots(count, np.random.default_rng([seed, 5]))
        bump = (None, round(0.7 * count))[seed // 2 % 2]
        faults = {"arm": 0.12, "blurred": 0.08, "bump": bump, "bump_px": 3} if seed % 3 else {}
        video = make_video(
            seed, count, size=0.5, lamp=lamp, quality=(0, 90)[seed // 4 % 2], **faults
        )
        count_dropped(video, f"{count} shots {seed}", lost, there)
    print_dropped(lost, there)


def count_dropped(video: Any, shown: str, lost: Counter[str], there: Counter[str]) -> None:
    """Count the frames of a video that are dropped, and that are there, by what is wrong."""
    frames = look_through(video.recording, silent)
    light = explained(frames)
    at_px = positions(frames, light.coefficients, silent)
    out = np.any(list(reasons_to_drop(frames, light, at_px).values()), axis=0)
    good = sorted(set(range(len(frames))) - set(video.bad))
    for name, numbers in {**video.wrong, "good": good}.items():
        lost[name] += int(out[numbers].sum())
        there[name] += len(numbers)
    print(f"{shown}: {out[good].mean():.0%} of the good frames dropped", flush=True)


def print_dropped(lost: Counter[str], there: Counter[str]) -> None:
    """One line for each fault, and for the good frames."""
    for name, count in there.items():
        print(f"{name}: {lost[name]} of {count} dropped, {lost[name] / max(count, 1):.1%}")


def chosen(seeds: range) -> None:
    """Normals of photographs whose light differs most over those of evenly spaced ones."""
    ratios = []
    for seed in seeds:
        video = make_video(seed, FRAMES, size=0.4, quality=90)
        light = explained(look_through(video.recording, silent))
        depth = np.stack([each for _, each in video.recording.depth.walk(range(0, FRAMES, 10))])
        even, taken = (
            normals_error(video, numbers, depth)
            for numbers in (
                evenly(FRAMES, PHOTOGRAPHS),
                most_different(light.coefficients, PHOTOGRAPHS),
            )
        )
        ratios.append(taken / even)
        print(f"video {seed}: {even:.2f} degrees evenly, {taken:.2f} chosen", flush=True)
    print(f"geometric mean of the ratios: {np.exp(np.mean(np.log(ratios))):.2f}")


def normals_error(video: Any, numbers: list[int], depth: np.ndarray) -> float:
    """Mean angle, degrees, of the refined normals of some frames."""
    capture = Capture.from_arrays(
        video.frames[numbers], depth, video.recording.camera, mask=video.truth.mask, encoding="srgb"
    )
    return evaluate(refine(capture), video.truth).normals.mae_deg


def main() -> None:
    """Run the part that is named."""
    parts = {part.__name__: part for part in (formats, dropped, shots, chosen)}
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=parts)
    parser.add_argument("--seeds", help="first:end")
    arguments = parser.parse_args()
    first, end = map(int, (arguments.seeds or SEEDS.get(arguments.part, "40:64")).split(":"))
    parts[arguments.part](range(first, end))


if __name__ == "__main__":
    main()

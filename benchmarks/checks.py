"""What the checks say of captures drawn at random: as they are, and made wrong on purpose.

    python -m benchmarks.checks --seeds 4000:4060
    python -m benchmarks.checks --seeds 4000:4060 --ratios 10 12 16 --size 2     # coarse sensors
    python -m benchmarks.checks --seeds 0:50 --refine      with what watches over the result

Per check, how many sound draws it warns of and refuses, and how many of those made wrong: disparity
in the place of depth, before a wall and before nothing; depth mirrored or turned by 180 degrees
against photographs and mask; depth shifted by a tenth of the object's width; photographs 12 pixels
beside depth and mask; a slanted plane in the place of depth; half the photographs, or one of them,
moved by 3.6 pixels.  Draws whose depth is shifted by more than a depth pixel are
drawn without, for a warning of that is true.  Which sound draws a check spoke of follows.

With --refine also the error of held-back photographs by the refined surface over that by the
prepared depth, and by how much the worst photograph is predicted worse than the typical one; then
both again with photographs of noise alone, and with one photograph moved by a quarter of the image.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from rakelight.check.findings import FINDINGS
from rakelight.check.measured import Measured
from rakelight.check.odd_photograph import odd_photographs
from rakelight.errors import RakelightError
from rakelight.methods import load_method
from rakelight.model import Capture, silent
from rakelight.pipeline.guarded import surface
from rakelight.pipeline.held_back import predict
from rakelight.pipeline.inside_out import refuse_inverted
from rakelight.prepare import prepare
from rakelight.solve.robust import NOTABLE
from rakelight.synthetic import Draw, draw, render_draw

Change = Callable[[Capture], Capture]
CHECKS = {row.codes[0]: row.check for row in FINDINGS if row.check and row.in_refine}
"""Those that refine runs, beside whichever stage."""
MOVED_PX = (3.0, -2.0)
BESIDE_PX = 12
SHIFTED, LEAST_SHIFTED_PX = 0.1, 3
"""Of the object's width, and in depth pixels at the least."""


def drawn(seed: int, size: float, ratios: list[float]) -> Draw:
    """A draw whose depth lies on the photographs, to a depth pixel."""
    scans = sorted(Path("../shared/shapes").glob("*.npz"))
    pictures = [file for file in (Path("../shared/captures/mitten/rgb/000.png"),) if file.exists()]
    one = draw(seed, size, scans, pictures, ratios)
    if size * np.hypot(one.shift_x, one.shift_y) <= one.depth_factor:
        return one
    return replace(one, shift_x=0.0, shift_y=0.0)


def disparity(capture: Capture) -> Capture:
    """The capture with disparity in the place of depth."""
    middle_m = np.nanmedian(capture.depth_m)
    return replace(capture, depth_m=(middle_m**2 / capture.depth_m).astype(np.float32))


def mirrored(capture: Capture) -> Capture:
    """The capture with its depth mirrored left to right."""
    return replace(capture, depth_m=np.ascontiguousarray(capture.depth_m[:, :, ::-1]))


def turned(capture: Capture) -> Capture:
    """The capture with its depth turned by 180 degrees."""
    return replace(capture, depth_m=np.ascontiguousarray(capture.depth_m[:, ::-1, ::-1]))


def shifted(capture: Capture) -> Capture:
    """The capture with its depth shifted to the right."""
    per_pixel = capture.depth_m.shape[2] / capture.mask.shape[1]
    by = max(LEAST_SHIFTED_PX, round(SHIFTED * float(np.sqrt(capture.mask.sum())) * per_pixel))
    depth_m = np.full_like(capture.depth_m, np.nan)
    depth_m[:, :, by:] = capture.depth_m[:, :, :-by]
    return replace(capture, depth_m=depth_m)


def beside(capture: Capture) -> Capture:
    """The capture with its photographs shifted to the right of depth and mask."""
    return replace(capture, photographs=np.roll(capture.photographs, BESIDE_PX, axis=2))


def plane(capture: Capture) -> Capture:
    """The capture with a plane in the place of its depth, 5 % nearer on the left than on it."""
    depth_m = np.full_like(capture.depth_m[:1], np.nanmedian(capture.depth_m))
    depth_m *= np.linspace(0.95, 1.05, depth_m.shape[2], dtype=depth_m.dtype)
    return replace(capture, depth_m=depth_m)


def half_moved(capture: Capture) -> Capture:
    """The capture with the second half of its photographs moved."""
    return moved(capture, slice(len(capture.photographs) // 2 + 1, None))


def middle_moved(capture: Capture) -> Capture:
    """The capture with the photograph in the middle moved."""
    middle = len(capture.photographs) // 2
    return moved(capture, slice(middle, middle + 1))


def moved(capture: Capture, which: slice) -> Capture:
    """The capture with some of its photographs moved."""
    photographs = capture.photographs.copy()
    height, width = capture.mask.shape
    shift = np.array([[1.0, 0.0, MOVED_PX[0]], [0.0, 1.0, MOVED_PX[1]]])
    for photograph in photographs[which]:
        photograph[:] = cv2.warpAffine(
            photograph.copy(), shift, (width, height), borderMode=cv2.BORDER_REPLICATE
        )
    return replace(capture, photographs=photographs)


WRONG: dict[str, tuple[str, Change]] = {
    "half the photographs moved": ("camera-moved", half_moved),
    "one photograph moved": ("camera-moved", middle_moved),
    "depth shifted": ("depth-shifted", shifted),
    "photographs beside depth and mask": ("depth-shifted", beside),
    "a plane for depth": ("depth-unrelated", plane),
    "depth mirrored": ("depth-turned", mirrored),
    "depth turned": ("depth-turned", turned),
    "disparity": ("depth-inside-out", disparity),
}


def verdict(check: str, capture: Capture) -> str:
    """What a check says, after the photographs were asked about depth inside out."""
    measured = Measured(capture)
    try:
        found = CHECKS[check](measured)
        refuse_inverted(measured, found)
        return "warned" if found else "silent"
    except RakelightError:
        return "refused"


def sayings(capture: Capture, wall: bool) -> dict[tuple[str, str], str]:
    """(what was done to the capture, check) -> verdict; wall: whether one stands behind it."""
    said = {("nothing", check): verdict(check, capture) for check in CHECKS}
    for name, (check, change) in WRONG.items():
        if check == "depth-inside-out":
            name += ", before a wall" if wall else ", before nothing"
        said[name, check] = verdict(check, change(capture))
    return said


def held_back(capture: Capture) -> tuple[float, int]:
    """The refined surface's error over the prepared depth's, and how many photographs are odd."""
    method, prepared = load_method("multi-light"), prepare(capture)
    estimate = method.run(prepared, method.options(), silent)
    found = predict(prepared, *surface(prepared, estimate), estimate.lights)
    if found is None:
        return float("nan"), 0
    odd = odd_photographs(found.refined, found.brightness, found.variation)
    return found.gain, int(odd.either.sum())


def one_moved(capture: Capture) -> Capture:
    """The capture with a photograph in the middle moved by a quarter of the image."""
    photographs = capture.photographs.copy()
    which = len(photographs) // 2
    photographs[which] = np.roll(photographs[which], capture.mask.shape[1] // 4, axis=1)
    return replace(capture, photographs=photographs)


def noise(capture: Capture) -> Capture:
    """The capture with photographs of noise alone."""
    rng, white = np.random.default_rng(0), int(capture.white)
    values = rng.integers(white // 20, white - white // 20, capture.photographs.shape)
    return replace(capture, photographs=values.astype(capture.photographs.dtype))


CHANGES = {"as they are": replace, "noise alone": noise, "one moved": one_moved}


def table(all_said: dict[int, dict[tuple[str, str], str]]) -> None:
    """Print how often each check warned and refused, and of which sound draws."""
    counts = Counter((key, what) for said in all_said.values() for key, what in said.items())
    print(
        "| what is wrong | check | of draws | warned | refused |\n| --- | --- | --- | --- | --- |"
    )
    keys = sorted({key for key, _ in counts}, key=lambda key: (key[0] != "nothing", key[1], key[0]))
    for key in keys:
        silent_, warned, refused = (counts[key, what] for what in ("silent", "warned", "refused"))
        print(f"| {key[0]} | `{key[1]}` | {silent_ + warned + refused} | {warned} | {refused} |")
    for seed, said in all_said.items():
        alarms = {check: what for (done, check), what in said.items() if done == "nothing"}
        for check, what in alarms.items():
            if what != "silent":
                print(f"draw {seed}, nothing wrong: {check} {what}")


def share(values: list[bool]) -> str:
    """So many of so many."""
    return f"{sum(values)} of {len(values)}"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", default="4000:4060", help="FIRST:END")
    parser.add_argument("--ratios", type=float, nargs="+", default=[], help="of depth_factor")
    parser.add_argument("--size", type=float, default=1.0, help="scale of the images")
    parser.add_argument("--refine", action="store_true")
    arguments = parser.parse_args()
    all_said, refined = {}, []
    for seed in range(*map(int, arguments.seeds.split(":"))):
        one = drawn(seed, arguments.size, arguments.ratios)
        capture, _ = render_draw(one)
        try:
            all_said[seed] = sayings(capture, one.wall)
            if arguments.refine:
                refined.append([held_back(change(capture)) for change in CHANGES.values()])
        except RakelightError as error:
            print(f"{seed:4d}  {error}", flush=True)
    table(all_said)
    for name, rows in zip(CHANGES, zip(*refined, strict=True), strict=bool(refined)):
        gains = np.array([gain for gain, _ in rows])
        gains, odd = gains[np.isfinite(gains)], [count > 0 for _, count in rows]
        if not gains.size:
            print(f"{name}: no draw has photographs that can be held back")
            continue
        low, high = gains.min(), gains.max()
        kept = share((gains > 1 - NOTABLE).tolist())
        print(f"{name}: error ratio {low:.2f} to {high:.2f}, kept {kept}, odd in {share(odd)}")


if __name__ == "__main__":
    main()

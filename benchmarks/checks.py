"""What the checks say of captures drawn at random: as they are, turned, and as disparity.

    python benchmarks/checks.py --seeds 0:120
    python benchmarks/checks.py --seeds 0:50 --refine      with what watches over the result

Per draw: the evidence for the best turn of the depth (`depth_orientation`), the same with the
photographs and the mask turned by 180 degrees, and what `inside_out` says of the depth and of
disparity in its place.  With --refine also the error of held-back photographs by the refined
surface over that by the prepared depth, and by how much the worst photograph is predicted worse
than the typical one; then both again with photographs of noise alone, and with one photograph
moved by a quarter of the image.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from rakelight.check.depth_orientation import LIKELY, SURELY, orientation_fits
from rakelight.check.inside_out import inside_out
from rakelight.check.odd_photograph import odd_photographs
from rakelight.errors import RakelightError
from rakelight.methods import load_method
from rakelight.model import Capture, silent
from rakelight.pipeline.guarded import surface
from rakelight.pipeline.held_back import LARGEST_RATIO, predict
from rakelight.prepare import prepare
from rakelight.synthetic import draw, render_draw


def evidence(capture: Capture) -> float:
    """For the best turn of the depth; -inf where there is none to be had."""
    return max((fit.evidence for fit in orientation_fits(capture)), default=-np.inf)


def turned(capture: Capture) -> Capture:
    """The capture with photographs and mask turned by 180 degrees."""
    photographs = np.ascontiguousarray(capture.photographs[:, ::-1, ::-1])
    return replace(
        capture, photographs=photographs, mask=np.ascontiguousarray(capture.mask[::-1, ::-1])
    )


def disparity(capture: Capture) -> Capture:
    """The capture with disparity in the place of depth."""
    middle_m = np.nanmedian(capture.depth_m)
    return replace(capture, depth_m=(middle_m**2 / capture.depth_m).astype(np.float32))


def verdict(capture: Capture) -> str:
    """What `inside_out` says."""
    try:
        return "warned" if inside_out(capture) else "silent"
    except RakelightError:
        return "refused"


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


def share(values: list[bool]) -> str:
    """So many of so many."""
    return f"{sum(values)} of {len(values)}"


def main() -> None:
    """Print a line per draw and the counts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", default="0:120")
    parser.add_argument("--refine", action="store_true")
    arguments = parser.parse_args()
    turns, outlines, refined = [], [], []
    for seed in range(*map(int, arguments.seeds.split(":"))):
        capture, _ = render_draw(draw(seed))
        try:
            turns.append((evidence(capture), evidence(turned(capture))))
            outlines.append((verdict(capture), verdict(disparity(capture))))
            line = "turn {:6.2f} {:6.2f}  {:7s} {:7s}".format(*turns[-1], *outlines[-1])
            if arguments.refine:
                refined.append([held_back(change(capture)) for change in CHANGES.values()])
                line += "".join(f"  {gain:.2f} odd {odd}" for gain, odd in refined[-1])
            print(f"{seed:4d}  {line}", flush=True)
        except RakelightError as error:
            print(f"{seed:4d}  {error}", flush=True)
    for name, found in zip(("as they are", "turned"), zip(*turns, strict=True), strict=True):
        likely, surely = ([each >= least for each in found] for least in (LIKELY, SURELY))
        print(f"{name}: at most {max(found):.2f}, warned {share(likely)}, refused {share(surely)}")
    for name, found in zip(
        ("as they are", "as disparity"), zip(*outlines, strict=True), strict=True
    ):
        warned, refused = ([each == said for each in found] for said in ("warned", "refused"))
        print(f"{name}: inside out, warned {share(warned)}, refused {share(refused)}")
    for name, rows in zip(CHANGES, zip(*refined, strict=True), strict=bool(refined)):
        gains = np.array([gain for gain, _ in rows])
        gains, odd = gains[np.isfinite(gains)], [count > 0 for _, count in rows]
        low, high = gains.min(), gains.max()
        kept = share((gains > LARGEST_RATIO).tolist())
        print(f"{name}: error ratio {low:.2f} to {high:.2f}, kept {kept}, odd in {share(odd)}")


if __name__ == "__main__":
    main()

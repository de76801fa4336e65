"""What lies beyond the limits of `rakelight check`, on captures drawn at random.

    python benchmarks/check_limits.py --seeds 200:250 --size 0.5
    python benchmarks/check_limits.py --seeds 200:250 --geometry

Each draw is refined as it is, then spoiled up to a limit: so much of the object saturated or black,
so dark, so blurred, with so many holes.  Printed are the ratios of the errors to those of the draw
as it is.  "next light": one photograph is left out; its gain as `next_lights` predicts it, and what
it really is.  With --geometry, which refines nothing: how black the photographs are, which draws
are said to be out of focus, what is said of the unit as it is and ten times wrong, and how the best
next light moves with the information of the depth.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import replace

import cv2
import numpy as np

from rakelight import evaluate, refine
from rakelight.capture.arrays import checked_capture
from rakelight.check import next_lights as design
from rakelight.check.depth_quality import depth_findings
from rakelight.check.exposure import BRIGHT_PART, exposure
from rakelight.check.measured import Measured
from rakelight.check.sharpness import sharpness_findings
from rakelight.errors import RakelightError
from rakelight.model import Capture, Floats, Truth
from rakelight.prepare.linear import srgb, to_linear
from rakelight.synthetic import random_capture


def exposed(capture: Capture, factor: float) -> Capture:
    """The photographs with so many times the light."""
    photographs = np.empty_like(capture.photographs)
    for photograph, out in zip(capture.photographs, photographs, strict=True):
        light = np.clip(factor * to_linear(photograph, capture.encoding), 0, 1)
        value = srgb(light) if capture.encoding == "srgb" else light
        out[:] = np.rint(capture.white * value)
    return replace(capture, photographs=photographs)


def brightest(capture: Capture) -> Floats:
    """(N, P) light of the brightest channel on the object."""
    return np.asarray(
        [to_linear(each[capture.mask], capture.encoding).max(-1) for each in capture.photographs]
    )


def saturated(capture: Capture, share: float) -> Capture:
    """Exposed until that share of the object's values is saturated, over all photographs."""
    return exposed(capture, 1 / max(float(np.quantile(brightest(capture), 1 - share)), 1e-3))


def dark(capture: Capture, brightness: float) -> Capture:
    """Exposed until the object's brighter part has that light in the median photograph."""
    part = np.quantile(brightest(capture), BRIGHT_PART, axis=1)
    return exposed(capture, brightness / max(float(np.median(part)), 1e-3))


def blackened(capture: Capture, share: float) -> Capture:
    """Every photograph with that share of the object's pixels black, the darkest ones."""
    photographs = capture.photographs.copy()
    for photograph, light in zip(photographs, brightest(capture), strict=True):
        inside = photograph[capture.mask]
        inside[light <= np.quantile(light, share)] = 0
        photograph[capture.mask] = inside
    return replace(capture, photographs=photographs)


def blurred(capture: Capture, sigma_px: float) -> Capture:
    """Every photograph blurred by a Gaussian, as out of focus."""
    soft = [cv2.GaussianBlur(each, (0, 0), sigma_px) for each in capture.photographs]
    return replace(capture, photographs=np.stack(soft))


def holed(capture: Capture, share: float) -> Capture:
    """That share of the depth pixels lost, in patches of about 6 pixels."""
    field = np.random.default_rng(0).standard_normal(capture.depth_m.shape[1:])
    field = cv2.GaussianBlur(field, (0, 0), 3.0)
    lost = field < np.quantile(field, share)
    return replace(capture, depth_m=np.where(lost, np.nan, capture.depth_m).astype(np.float32))


SPOILED: dict[str, Callable[[Capture], Capture]] = {
    "saturated 0.2": lambda capture: saturated(capture, 0.2),
    "saturated 0.4": lambda capture: saturated(capture, 0.4),
    "bright 0.06": lambda capture: dark(capture, 0.06),
    "bright 0.02": lambda capture: dark(capture, 0.02),
    "black 0.4": lambda capture: blackened(capture, 0.4),
    "black 0.6": lambda capture: blackened(capture, 0.6),
    "blurred 2 px": lambda capture: blurred(capture, 2.0),
    "blurred 3 px": lambda capture: blurred(capture, 3.0),
    "holes 0.1": lambda capture: holed(capture, 0.1),
    "holes 0.3": lambda capture: holed(capture, 0.3),
    "holes 0.5": lambda capture: holed(capture, 0.5),
    "holes 0.7": lambda capture: holed(capture, 0.7),
    "holes 0.9": lambda capture: holed(capture, 0.9),
}


def errors(capture: Capture, truth: Truth) -> Floats:
    """(2,) depth mm and normals degrees; NaN where it is refused."""
    try:
        found = evaluate(refine(capture), truth)
    except RakelightError:
        return np.full(2, np.nan)
    return np.array([found.depth.rmse_mm, found.normals.mae_deg])


def predicted(truth: Truth, chosen: list[int]) -> float:
    """Root of the mean expected squared angle of the normals under those lights."""
    normals = truth.normals[truth.mask]
    normals = normals[:: max(len(normals) // design.SAMPLE, 1)].astype(np.float64)
    lights = truth.lights.vector[chosen].mean(axis=1)
    lights = lights / np.median(np.linalg.norm(truth.lights.vector.mean(axis=1), axis=1))
    M = design.information(lights, normals)
    return float(np.sqrt(np.trace(design.across(normals) @ np.linalg.inv(M), 0, 1, 2).mean()))


def next_light(capture: Capture, truth: Truth, whole: Floats) -> tuple[float, float]:
    """Predicted and real ratio of the normals' error with the first photograph to that without."""
    rest = list(range(1, len(capture.photographs)))
    ratio = predicted(truth, [0, *rest]) / predicted(truth, rest)
    return ratio, float(whole[1] / errors(capture.select(rest), truth)[1])


def draws(arguments: argparse.Namespace) -> Iterator[tuple[int, Capture, Truth]]:
    """The captures."""
    for seed in range(*map(int, arguments.seeds.split(":"))):
        capture, truth = random_capture(seed, size=arguments.size)
        if len(capture.photographs) > 3:
            yield seed, checked_capture(capture), truth


def show_errors(arguments: argparse.Namespace) -> None:
    """A line per draw, and the geometric means."""
    names = [name for name in SPOILED if arguments.only in name]
    rows, lights = [], []
    for seed, capture, truth in draws(arguments):
        whole = errors(capture, truth)
        rows.append([errors(SPOILED[name](capture), truth) / whole for name in names])
        ratios = zip(names, rows[-1], strict=True)
        line = "  ".join(f"{name}: {d:.2f} {n:.2f}" for name, (d, n) in ratios)
        if "next".startswith(arguments.only):
            lights.append(next_light(capture, truth, whole))
            line += "  next light: {:.3f} {:.3f}".format(*lights[-1])
        print(f"{seed:4}  {whole[0]:.2f} mm {whole[1]:.2f} deg  {line}", flush=True)
        if len(rows) % 10 == 0:
            summary(names, np.array(rows), np.array(lights))
    if len(rows) % 10:
        summary(names, np.array(rows), np.array(lights))


def summary(names: list[str], rows: Floats, lights: Floats) -> None:
    """Geometric means so far, and how many draws are better and worse by a tenth."""
    for i, name in enumerate(names):
        ratio = rows[:, i][np.isfinite(rows[:, i]).all(axis=1)]
        depth, normals = np.exp(np.log(ratio).mean(axis=0))
        better, worse = (ratio[:, 1] < 1 / 1.1).sum(), (ratio[:, 1] > 1.1).sum()
        print(f"## {name}: {len(ratio)} of {len(rows)} draws refined, depth {depth:.3f}, "
              f"normals {normals:.3f}, by a tenth {better} better, {worse} worse")  # fmt: skip
    if len(lights):
        for low, high in ((0.0, 0.9), (0.9, 0.96), (0.96, 0.98), (0.98, 1.0)):
            within = (lights[:, 0] > low) & (lights[:, 0] <= high) & np.isfinite(lights[:, 1])
            if within.any():
                mean, real = np.exp(np.log(lights[within]).mean(axis=0))
                print(f"## next light: predicted {mean:.3f}, real {real:.3f} ({within.sum()})")


def show_geometry(arguments: argparse.Namespace) -> None:
    """Black photographs, focus, units, and the information of the depth."""
    said: dict[str, list[bool]] = {}
    soft: dict[float, list[bool]] = {}
    black: list[float] = []
    moved, gains = [], []
    for _, capture, truth in draws(arguments):
        black += exposure(capture).black.tolist()
        for sigma_px in (0.0, 2.0, 3.0, 4.0):
            spoiled = blurred(capture, sigma_px) if sigma_px else capture
            codes = {each.code for each in sharpness_findings(Measured(spoiled))}
            soft.setdefault(sigma_px, []).append("out-of-focus" in codes)
        for name, factor in (("as it is", 1), ("10 times", 10.0), ("a tenth", 0.1),
                             ("25.4 times", 25.4), ("a thousandth", 1e-3)):  # fmt: skip
            said.setdefault(name, []).append(doubted(capture, factor))
        normals = truth.normals[truth.mask].astype(np.float64)
        lights = truth.lights.vector.mean(axis=1)
        usual = design.PRIOR_INFORMATION
        found = []
        for information in (usual / 4, usual, usual * 4):
            design.PRIOR_INFORMATION = information
            found.append(design.next_lights(lights, normals, 1)[0])
        design.PRIOR_INFORMATION = usual
        cosines = [min(float(each.direction @ found[1].direction), 1.0) for each in found]
        moved.append(np.degrees(np.arccos(cosines)))
        gains.append([each.gain for each in found])
    print(f"black: {max(black):.0%} of the object at the most, of {len(black)} photographs")
    for sigma_px, found_soft in soft.items():
        print(f"blurred by {sigma_px:g} px: out of focus in {sum(found_soft)} of {len(found_soft)}")
    for name, doubts in said.items():
        print(f"unit {name}: doubted or refused in {sum(doubts)} of {len(doubts)}")
    print("information / 4, * 4: best light moves by", np.median(moved, axis=0)[[0, 2]].round(1),
          "degrees; gains", np.median(gains, axis=0).round(3))  # fmt: skip
    least = (np.array(gains)[:, 1] >= design.LEAST_GAIN).sum()
    print(f"named as the next light in {least} of {len(gains)}")


def doubted(capture: Capture, factor: float) -> bool:
    """Whether something is said of the unit where the depth is that many times too large."""
    try:
        scaled = replace(capture, depth_m=(capture.depth_m * factor).astype(np.float32))
        findings = depth_findings(Measured(checked_capture(scaled)))
    except RakelightError:
        return True
    return any(each.code == "depth-unit" for each in findings)


def main() -> None:
    """Print what was asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", default="200:250", help="first:end")
    parser.add_argument("--size", type=float, default=0.5, help="scale of the images")
    parser.add_argument("--only", default="", help="limits whose name contains this, such as holes")
    parser.add_argument("--geometry", action="store_true")
    arguments = parser.parse_args()
    (show_geometry if arguments.geometry else show_errors)(arguments)


if __name__ == "__main__":
    main()

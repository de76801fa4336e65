"""What multi-light chooses at its coarsest level, beside all that it could have chosen.

    python benchmarks/coarse_choices.py --seeds 0:60 --jobs 2 [-o out/choices.json]
    python benchmarks/coarse_choices.py --read out/choices.json out/others.json

For each draw of `random_captures.py` a descent from each start (the sensor's depth, the
photographs' factorisation), under each depth weight, with distant lights and, from where that
ends, with near ones.  Printed are geometric means of what an error at that level is over that of
the descent that `Search.select` chooses: of normals, of depth, of the lights' directions.  The rows
choose with the truth in sight, or by the likelihood of `model_selection.cost`, in which the depth
counts as n values (n = N there) and each of the N photographs as one.  "The truth too": of
descents that begin at the true depth as well.  Draws under lights of several colours are left out:
only white lights are tried here.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rakelight import Capture, RakelightError, Truth
from rakelight.methods.levels import Level, pyramid
from rakelight.methods.multi_light import MultiLight, coarsest_level, first_levels
from rakelight.methods.multi_light.energy import Fit, first_fit, reset_scale
from rakelight.methods.multi_light.equal_intensity import equal_intensity_energy
from rakelight.methods.multi_light.initial_lights import lights_of_prior
from rakelight.methods.multi_light.model_selection import (
    SHARED_AMBIENT,
    Search,
    are_near,
    radius_over_distance,
    sensor_cost,
    starts,
    with_near_lights,
)
from rakelight.methods.multi_light.steps import descend, refine_lights
from rakelight.metrics import normal_error_map_deg
from rakelight.model import silent
from rakelight.prepare import prepare
from rakelight.synthetic import draw, render_draw
from random_captures import add_sources, lights_deg, processes, seeds

ERRORS = ("deg", "mm", "lights_deg")
SHARES = (0.1, 0.2, 0.3, 0.5, 0.8, 1.0)
"""n / N, the values for which the depth counts."""

Record = dict[str, Any]


def assess(seed: int, scans: Sequence[Path], pictures: Sequence[Path]) -> Record:
    """All descents of one draw at the coarsest level, and the one that is chosen."""
    drawn = draw(seed, 1.0, scans, pictures)
    record: Record = {"seed": seed, "coloured": drawn.colour_spread > 0}
    try:
        capture, truth = render_draw(drawn)
        record |= descents(capture, truth)
    except RakelightError as error:
        record["failed"] = str(error)
    return record


def descents(capture: Capture, truth: Truth) -> Record:
    """The chosen descent and the others: their errors, and what a criterion may use."""
    prepared, options = prepare(capture), MultiLight()
    levels, weights = first_levels(prepared, options)
    finest, (level, factor) = levels[0], coarsest_level(levels)
    weights = [factor * each for each in weights]
    true = truth.depth[prepared.rows, prepared.columns]
    known = finest.mask & np.isfinite(true)
    log_true = np.where(known, np.log(np.where(known, true, 1.0)), finest.prior)
    exact = pyramid(replace(finest, prior=log_true), options.coarse_pixels)[-1]
    measured = partial(figures, level, exact, truth)

    chosen = Search(level, weights, options, silent, "look").select()
    others: list[Record] = []
    for name, start in named_starts(level, exact):
        for weight in weights:
            weighted = level.weighted(weight)
            distant = descend(weighted, start, options, silent, "look").fit
            begun = with_near_lights(weighted, distant)
            near = descend(weighted, begun, options, silent, "look").fit
            for fit in (distant, near):
                others.append({"start": name, "weight": weight, **measured(fit, weight)})
    chosen_here = measured(chosen.fit, chosen.weight)
    return {"photographs": len(level.photographs), "chosen": chosen_here, "others": others}


def named_starts(level: Level, exact: Level) -> Iterator[tuple[str, Fit]]:
    """Where descents begin; `exact` has the true depth for a prior."""
    yield from zip(("sensor", "factored"), starts(level, None), strict=False)
    fit = first_fit(level, exact.prior, lights_of_prior(exact), SHARED_AMBIENT)
    for _ in range(6):  # until lights and robust scale agree
        fit = refine_lights(level, reset_scale(level, fit))
    yield "truth", reset_scale(level, fit)


def figures(level: Level, exact: Level, truth: Truth, fit: Fit, weight: float) -> Record:
    """Errors of a state, the depth's but for an offset, and the terms of a likelihood.

    level : its depth weight is of one sensor pixel's noise; weight : that of the descent, a
        multiple; exact : with the true depth for a prior
    """
    (normals, _), (true_normals, _) = (level.normals(each) for each in (fit.log_depth, exact.prior))
    active = level.photographs.active
    off_deg = normal_error_map_deg(normals, true_normals, active)
    off = (fit.log_depth - exact.prior)[level.mask]
    nearness = radius_over_distance(level, fit.lights)
    return {
        "deg": float(off_deg[active].mean()),
        "mm": 1000 * float(level.middle_m[2]) * float(np.std(off)),
        "lights_deg": lights_deg(fit.lights.as_lights(level.middle_m), truth.lights),
        "near": fit.model.near,
        "plausible": not fit.model.near or are_near(level, fit.lights),
        "log_sigma": float(np.log(fit.linearization.noise_sigma) + np.log1p(nearness**2)),
        "sensor": sensor_cost(level, fit, weight),
        "equal_intensity": equal_intensity_energy(fit.lights.vector),
    }


# ---- what is printed


def cost(share: float, record: Record, other: Record) -> float:
    """Minus twice the logarithm of the likelihood of a descent, n = share N."""
    photographs = 2 * other["log_sigma"] + share * other["sensor"]
    return float(record["photographs"] * photographs + other["equal_intensity"])


def table(records: Sequence[Record]) -> Iterator[str]:
    """A row for each way to choose."""
    used = [each for each in records if "failed" not in each and not each["coloured"]]
    yield f"{len(used)} draws of {len(records)}; error over that of what is chosen now"
    yield f"{'chosen by':34s} {'normals':>8s} {'depth':>8s} {'lights':>8s}"

    def row(name: str, with_truth: bool, by: Callable[[Record, Record], float]) -> str:
        ratios: dict[str, list[float]] = {error: [] for error in ERRORS}
        for record in used:
            free = [
                each for each in record["others"]
                if each["plausible"] and (with_truth or each["start"] != "truth")
            ]  # fmt: skip
            best = min(free, key=partial(by, record))
            for error in ERRORS:
                before, after = record["chosen"][error], best[error]
                if before and after:  # None where the truth has other lights
                    ratios[error].append(after / before)
        means = (float(np.exp(np.mean(np.log(each)))) for each in ratios.values())
        return f"{name:34s} " + " ".join(f"{each:8.3f}" for each in means)

    yield row("the least angle, the truth too", True, lambda _, other: other["deg"])
    yield row("the least angle", False, lambda _, other: other["deg"])
    for share in SHARES:
        words = f"likelihood, n = {share:g} N"
        yield row(words, False, partial(cost, share))
    yield row("likelihood, 0.3 N, the truth too", True, partial(cost, 0.3))


def main() -> None:
    """Run, or read, and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=seeds, default=range(60), help="FIRST:END")
    parser.add_argument("--jobs", type=int, default=1, help="processes of one thread each")
    add_sources(parser)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/choices.json"))
    parser.add_argument("--read", type=Path, nargs="+", metavar="JSON", help="runs, to print")
    arguments = parser.parse_args()
    if arguments.read:
        records = [each for file in arguments.read for each in json.loads(file.read_text())]
    else:
        one = partial(assess, scans=arguments.scans, pictures=arguments.pictures)
        arguments.output.parent.mkdir(parents=True, exist_ok=True)
        records = []
        with processes(arguments.jobs) as pool:
            for record in pool.imap(one, arguments.seeds):
                records.append(record)
                arguments.output.write_text(json.dumps(records, indent=1))
                print(record["seed"], record.get("failed", ""), flush=True)
    print(*table(records), sep="\n")


if __name__ == "__main__":
    main()

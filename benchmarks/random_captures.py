"""Captures drawn at random, refined: errors beside the best that could be.

    python benchmarks/random_captures.py --seeds 0:200 --jobs 2 [--oracle 60] [-o out/random.json]
    python benchmarks/random_captures.py --seeds 0:60 --method rgb-ratio --oracle 60
    python benchmarks/random_captures.py --seeds 0:24 --ratios 10 12 16 --size 2   # coarse sensors
    python benchmarks/random_captures.py --seeds 3:4 --set lights=one-side    # causes taken apart
    python benchmarks/random_captures.py --seeds 0:20 --lights fixed --off 5      # given lights
    python benchmarks/random_captures.py --compare before.json after.json
    python benchmarks/random_captures.py --read out/random.json --worst 10

Per draw the mean angle of the normals, degrees, and the depth's root mean square, mm, of

prepared : the depth map that the method starts from
result : what it returns, with all its choices made by itself
oracle : the least error over a grid of depth weights (the option depth_weight), angle and depth
    each by itself; of the first `--oracle` draws only
limit : the true relief, its generalised bas-relief transform (depth scale and plane) fitted to
    the sensor's depth by weighted least squares.  No method can do better by the sensor alone

over the pixels that the object covers whole, in the mask and not in a hole that nothing fills.
Of the pairs of neighbours that the truth links (no jump) two shares are off by more than 3 mm and
three deviations of the sensor's white noise and steps: torn are those that the result takes that
far apart, and farther than they are; flattened those on true slopes that it makes less steep.
Within are the shares of pixels whose error is at most what the method expects (`normal_sigma`,
`depth_sigma`): 63 % and 68 % where it is right and errors are normally distributed.
Seconds are the processor's: a busy machine does not change them.
"""

from __future__ import annotations

import argparse
import ast
import json
import multiprocessing
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import asdict, replace
from functools import partial
from multiprocessing.pool import Pool
from pathlib import Path
from typing import Any

import numpy as np

from rakelight import Capture, GivenLights, Lights, RakelightError, Result, Truth, refine
from rakelight.geometry.averaging import Averaging
from rakelight.geometry.camera import back_project
from rakelight.geometry.grid import pair_slices, surface_links
from rakelight.geometry.normals import surface_normals
from rakelight.methods import load_method
from rakelight.metrics import depth_error_map_mm, evaluate_maps, normal_error_map_deg
from rakelight.model import Floats, Mask
from rakelight.prepare.sensor import SensorGrid, sensed
from rakelight.synthetic import Draw, draw, render_draw

WEIGHTS = tuple(np.geomspace(1e-3, 30, 7).tolist())
"""The oracle's grid, multiples of white noise's weight."""
WORSE = 1.02
"""A result is worse than the prepared depth where an error is this much larger."""
FAR_DEG = 10
"""Mean error of normals, degrees, above which a person should have been warned."""
TORN_M, TORN_SIGMAS = 0.003, 3.0

Record = dict[str, Any]


def assess(seed: int, arguments: argparse.Namespace) -> Record:
    """All about one draw."""
    drawn = draw(
        seed, arguments.size, arguments.scans, arguments.pictures, arguments.ratios,
        **arguments.overrides,
    )  # fmt: skip
    record: Record = {"seed": seed, "draw": asdict(drawn)}
    began = time.process_time()
    try:
        capture, truth = render_draw(drawn)
        record["drawing_s"] = time.process_time() - began
        if arguments.lights != "found":
            given = given_lights(truth, seed, arguments.off, arguments.lights == "fixed")
            capture = replace(capture, lights=given)
        record |= scores(drawn, capture, truth, arguments.method, seed in arguments.with_oracle)
    except RakelightError as error:
        record["failed"] = str(error)
    except Exception as error:  # one draw's fault must not lose the others
        record["failed"] = repr(error)
    return record


def given_lights(truth: Truth, seed: int, off_deg: float, fixed: bool) -> GivenLights:
    """The true lights, each turned about the object's middle by `off_deg` to a random side."""
    lights = truth.lights
    assert lights is not None
    middle_m = np.zeros(3) if lights.middle_m is None else lights.middle_m
    place = lights.direction if lights.position_m is None else lights.position_m - middle_m
    toward = place.mean(axis=1)
    length = np.linalg.norm(toward, axis=1, keepdims=True)
    side = np.cross(toward, np.random.default_rng(seed).standard_normal(toward.shape))
    side *= length / np.linalg.norm(side, axis=1, keepdims=True)
    turned = np.cos(np.radians(off_deg)) * toward + np.sin(np.radians(off_deg)) * side
    if lights.position_m is None:
        return GivenLights(directions=turned / length, fixed=fixed)
    return GivenLights(positions_m=middle_m + turned, fixed=fixed)


def scores(drawn: Draw, capture: Capture, truth: Truth, method: str, oracle: bool) -> Record:
    """Errors and counts of one draw."""
    began = time.process_time()
    result = refine(capture, method)
    seconds = time.process_time() - began
    inside = truth.mask & capture.mask
    counted = inside & np.isfinite(result.prepared_depth)

    def errors(depth: Floats, normals: Floats) -> Record:
        found = evaluate_maps(depth, normals, truth, counted)
        return {"deg": found.normals.mae_deg, "mm": found.depth.rmse_mm}

    before = result.prepared_depth
    seen = np.isfinite(before)
    record: Record = {
        "pixels": int(np.count_nonzero(counted)),
        "coverage": float(counted.sum() / inside.sum()),
        "prepared": errors(before, surface_normals(before, seen, capture.camera)),
        "result": errors(result.depth, result.normals),
        "limit": errors(*limit(capture, truth)),
        **torn_and_flattened(result.depth, capture, truth, counted, drawn),
        "within": within(result, truth, counted),
        "converged": result.converged,
        "seconds": seconds,
        "lights_deg": lights_deg(result.lights, truth.lights),
        "warnings": [each.code for each in result.findings if each.severity == "warning"],
        "notes": [each.message for each in result.findings if each.code == "depth-weight"],
    }
    if oracle:
        record["grid"] = []
        defaults = load_method(method).options()
        for weight in WEIGHTS:
            tried = refine(capture, method, options=replace(defaults, depth_weight=weight))
            record["grid"].append({"weight": weight, **errors(tried.depth, tried.normals)})
        record["oracle"] = {
            unit: min(each[unit] for each in record["grid"]) for unit in ("deg", "mm")
        }
    return record


def limit(capture: Capture, truth: Truth) -> tuple[Floats, Floats]:
    """(H, W) depth and (H, W, 3) normals of the true relief, its bas-relief read off the sensor.

    1/z' = a/z + g . r at the rays r = (x, y, 1):  normals n become a n + (n . X) g at points X.
    """
    average, sigma = sensed(capture, capture.mask)
    grid = SensorGrid(average.shape, capture.camera.shape)
    depth = Averaging.on(truth.mask, grid.edges(0), grid.edges(1)).down(np.nan_to_num(truth.depth))
    used = grid.covered(truth.mask) & np.isfinite(average) & (sigma > 0)
    camera = capture.camera.resized(*average.shape[::-1])
    rays = back_project(np.ones(average.shape), camera)[used]
    columns = np.column_stack([1 / depth[used], rays])
    root = average[used] ** 2 / sigma[used]
    a, *g = np.linalg.lstsq(columns * root[:, None], root / average[used], rcond=None)[0]
    rays = back_project(np.ones(truth.depth.shape), capture.camera)
    inverse = a / truth.depth + rays @ g
    distance = np.sum(truth.normals * rays, axis=-1) * truth.depth
    return 1 / inverse, a * truth.normals + distance[..., None] * np.asarray(g)


def torn_and_flattened(
    depth: Floats, capture: Capture, truth: Truth, counted: Mask, drawn: Draw
) -> dict[str, float]:
    """The shares of linked pairs of neighbours that the result tears, and that it flattens."""
    links = surface_links(truth.depth, counted, capture.camera)
    fine_m = np.hypot(drawn.depth_white_mm, drawn.depth_step_mm / np.sqrt(12)) / 1000
    limit = max(TORN_M, TORN_SIGMAS * fine_m)
    torn = off = count = 0
    for axis, linked in ((1, links.right), (0, links.down)):
        here, there = pair_slices(axis)
        with np.errstate(invalid="ignore"):
            found, true = (each[there] - each[here] for each in (depth, truth.depth))
            wrong = linked[here] & ~(np.abs(found - true) <= limit)
            apart = ~(np.abs(found) <= np.maximum(limit, np.abs(true)))
        torn += np.count_nonzero(wrong & apart)
        off += np.count_nonzero(wrong)
        count += np.count_nonzero(linked)
    return {"torn": torn / max(count, 1), "flattened": (off - torn) / max(count, 1)}


def within(result: Result, truth: Truth, counted: Mask) -> Record | None:
    """The shares of pixels whose errors are within one expected error; None without those."""
    if result.depth_sigma is None or result.normal_sigma is None:
        return None
    off_deg = normal_error_map_deg(result.normals, truth.normals, counted)
    off_mm = depth_error_map_mm(result.depth, truth.depth, counted)
    return {
        "deg": float(np.mean((off_deg <= result.normal_sigma)[counted])),
        "mm": float(np.mean((off_mm <= 1000 * result.depth_sigma)[counted])),
    }


def lights_deg(estimated: Lights, true: Lights | None) -> float | None:
    """Mean angle between the lights' directions."""
    if true is None or len(estimated) != len(true):
        return None
    cosine = np.sum(estimated.direction * true.direction, axis=-1)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean())


# ---- what is printed


def line(record: Record) -> str:
    """One draw."""
    drawn = record["draw"]
    what = f"{record['seed']:5d} {Path(drawn['shape']).stem[:7]:7s} {drawn['photographs']:2d}"
    what += " easy" if drawn["easy"] else "     "
    if "failed" in record:
        return f"{what} FAILED {record['failed']}"
    cells = [
        f"{key} {record[key]['deg']:5.2f} {record[key]['mm']:5.2f}"
        for key in ("prepared", "result", "oracle", "limit")
        if key in record
    ]
    marks = [f"torn {record['torn']:.2%}"] if record["torn"] else []
    marks += ["WORSE"] * worse(record) + ["not converged"] * (not record["converged"])
    return " | ".join([what, *cells, f"{record['seconds']:.1f} s", *marks])


def warned_of(done: list[Record]) -> Iterator[str]:
    """Whether the results whose normals are far off are those with a warning."""
    far = [record for record in done if record["result"]["deg"] > FAR_DEG]
    told = sum(bool(record["warnings"]) for record in far)
    yield f"normals more than {FAR_DEG} degrees off: {len(far)}, with a warning: {told}"
    for name, uncertain in (("with", True), ("without", False)):
        angles = [
            record["result"]["deg"]
            for record in done
            if ("normals-uncertain" in record["warnings"]) == uncertain
        ]
        if angles:
            yield f"{name} normals-uncertain: {len(angles)}, median {np.median(angles):.1f} degrees"


def worse(record: Record) -> bool:
    """Whether an error is larger than the prepared depth's by more than `WORSE`."""
    return any(record["result"][unit] > WORSE * record["prepared"][unit] for unit in ("deg", "mm"))


def summary(records: Sequence[Record]) -> Iterator[str]:
    """Medians, 90th percentiles, ratios and counts."""
    done = [record for record in records if "failed" not in record]
    yield f"{len(records)} draws, {len(records) - len(done)} failed"
    if not done:
        return
    yield "| | draws | angle, deg: median | 90 % | depth, mm: median | 90 % |"
    yield "|" + " --- |" * 6
    groups: dict[str, Callable[[Record], bool]] = {
        "": lambda record: True,
        ", easy": lambda record: record["draw"]["easy"],
        ", with an oracle": lambda record: "oracle" in record,
    }
    for name, belongs in groups.items():
        chosen = [record for record in done if belongs(record)]
        for key in ("prepared", "result", "oracle", "limit"):
            if chosen and all(key in record for record in chosen):
                cells = [
                    f"{quantile:.2f}"
                    for unit in ("deg", "mm")
                    for quantile in np.quantile([each[key][unit] for each in chosen], [0.5, 0.9])
                ]
                yield f"| {key}{name} | {len(chosen)} | " + " | ".join(cells) + " |"
    for key in ("prepared", "oracle", "limit"):
        chosen = [record for record in done if key in record]
        for unit, of in (("deg", "angle"), ("mm", "depth")):
            if chosen:
                ours = np.array([record["result"][unit] for record in chosen])
                best = np.array([record[key][unit] for record in chosen])
                ratios, medians = ours / np.maximum(best, 1e-9), np.median(ours) / np.median(best)
                ninth = np.quantile(ours, 0.9) / np.quantile(best, 0.9)
                yield (
                    f"{of}, result to {key}: median of ratios {np.median(ratios):.2f}, "
                    f"90th percentile {np.quantile(ratios, 0.9):.2f}; ratio of medians "
                    f"{medians:.2f}, of 90th percentiles {ninth:.2f}"
                )
    yield f"torn: {share_in(done, 'torn')}; flattened: {share_in(done, 'flattened')}"
    if told := [record for record in done if record.get("within")]:
        pixels = np.array([record["pixels"] for record in told])
        for unit, of in (("deg", "angle"), ("mm", "depth")):
            shares = np.array([record["within"][unit] for record in told])
            low, middle, high = np.quantile(shares, [0.1, 0.5, 0.9])
            yield (
                f"{of} within one sigma: {shares @ pixels / pixels.sum():.1%} of the pixels of "
                f"{len(told)} draws; of a draw's, {low:.0%} (10 %), {middle:.0%} (median), "
                f"{high:.0%} (90 %)"
            )
    yield f"worse than the prepared depth by more than 2 %: {sum(map(worse, done))}"
    yield from warned_of(done)
    yield f"not converged: {sum(not record['converged'] for record in done)}"
    seconds = [record["seconds"] for record in done]
    drawing = [record["drawing_s"] for record in done]
    yield (
        f"processor's seconds to refine: median {np.median(seconds):.1f}, most {max(seconds):.1f}; "
        f"to draw: median {np.median(drawing):.1f}, most {max(drawing):.1f}"
    )


def badness(record: Record) -> float:
    """The angle over the oracle's, or where there is none the prepared depth's."""
    if "failed" in record:
        return np.inf
    return float(record["result"]["deg"] / record.get("oracle", record["prepared"])["deg"])


def worst(records: Sequence[Record], count: int) -> Iterator[str]:
    """The draws whose angle is largest over the oracle's, else the prepared depth's, described."""
    for record in sorted(records, key=badness, reverse=True)[:count]:
        yield line(record)
        yield f"      {Draw(**record['draw'])}"


def share_in(records: Sequence[Record], what: str) -> str:
    """The share of all draws' neighbours that are `what`, torn or flattened; in how many draws.

    nan where the records are older than that figure.
    """
    pixels = [record["pixels"] for record in records]
    share = np.average([record.get(what, np.nan) for record in records], weights=pixels)
    return (
        f"{share:.3%} of neighbours, in {sum(record.get(what, 0) > 0 for record in records)} draws"
    )


def compared(before: Sequence[Record], after: Sequence[Record]) -> Iterator[str]:
    """How the draws of two runs differ."""
    firsts = {record["seed"]: record for record in before if "failed" not in record}
    pairs = [
        (firsts[record["seed"]], record)
        for record in after
        if "failed" not in record and record["seed"] in firsts
    ]
    others = [a["seed"] for a, b in pairs if a["draw"] != b["draw"]]
    yield f"{len(pairs)} draws in both" + (f"; drawn differently: {others}" if others else "")
    if not pairs:
        return
    for unit, of in (("deg", "angle"), ("mm", "depth")):
        ratios = np.array([b["result"][unit] / a["result"][unit] for a, b in pairs])
        yield (
            f"{of}: geometric mean of ratios {np.exp(np.log(ratios).mean()):.3f}; "
            f"better by 5 %: {np.count_nonzero(ratios < 1 / 1.05)}, "
            f"worse by 5 %: {np.count_nonzero(ratios > 1.05)}"
        )
        yield "  worst: " + ", ".join(
            f"{pairs[i][0]['seed']} {pairs[i][0]['result'][unit]:.2f} to "
            f"{pairs[i][1]['result'][unit]:.2f}"
            for i in np.argsort(-ratios)[:10]
        )
    lights = np.array([[each["lights_deg"] for each in pair] for pair in pairs], dtype=float)
    lights = lights[(lights > 0).all(axis=1)]  # nan without true lights
    if len(lights):
        change = np.exp(np.log(lights[:, 1] / lights[:, 0]).mean())
        yield f"lights: geometric mean of ratios {change:.3f}"
    for what in ("torn", "flattened"):
        shares = [share_in(side, what) for side in zip(*pairs, strict=True)]
        yield f"{what} before: {shares[0]}; after: {shares[1]}"
    for name, test in (
        ("worse than prepared", worse),
        ("not converged", lambda record: not record["converged"]),
    ):
        yield f"{name}: {sum(test(a) for a, _ in pairs)} before, {sum(test(b) for _, b in pairs)}"
    seconds = [np.sum([pair[i]["seconds"] for pair in pairs]) for i in (0, 1)]
    yield f"seconds: {seconds[0]:.0f} before, {seconds[1]:.0f}"


# ---- the command


def seeds(text: str) -> range:
    """`FIRST:END` or one seed."""
    first, _, end = text.partition(":")
    return range(int(first), int(end) if end else int(first) + 1)


def add_sources(parser: argparse.ArgumentParser) -> None:
    """The options for what draws take shapes and paints from, with those that are there."""
    picture = Path("../shared/captures/mitten/rgb/000.png")
    parser.add_argument("--scans", type=scans_in, default="../shared/shapes", help="of *.npz")
    parser.add_argument(
        "--pictures", type=Path, nargs="*", default=[picture] if picture.exists() else []
    )


def scans_in(folder: str) -> list[Path]:
    """The scans of a folder, in order."""
    return sorted(Path(folder).glob("*.npz"))


def setting(text: str) -> tuple[str, Any]:
    """`FIELD=VALUE` of `Draw`."""
    name, _, value = text.partition("=")
    try:
        return name, ast.literal_eval(value)
    except (ValueError, SyntaxError):
        return name, value


def recorded(
    job: Callable[[int, argparse.Namespace], Record], arguments: argparse.Namespace
) -> list[Record]:
    """The records that `job` makes of the seeds, printed and written as they come, in order."""
    records: list[Record] = []
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    work = partial(job, arguments=arguments)
    with processes(arguments.jobs) if arguments.jobs > 1 else nullcontext() as pool:
        found = map(work, arguments.seeds) if pool is None else pool.imap(work, arguments.seeds)
        for record in found:
            print(line(record), flush=True)
            records.append(record)
            arguments.output.write_text(json.dumps(records, indent=1))
    return records


def changed_draw(drawn: Draw, change: Callable[[Capture, Truth], tuple[Capture, Truth]]) -> Record:
    """All about a draw whose capture and truth are changed after they are rendered."""
    record: Record = {"seed": drawn.seed, "draw": asdict(drawn)}
    began = time.process_time()
    try:
        capture, truth = change(*render_draw(drawn))
        record["drawing_s"] = time.process_time() - began
        return record | scores(drawn, capture, truth, "multi-light", False)
    except RakelightError as error:
        return record | {"failed": str(error)}


def run_changed_draws(
    description: str | None,
    job: Callable[[int, argparse.Namespace], Record],
    first: range,
    output: str,
    unchanged: str,
    meaning: str,
) -> None:
    """The command of a benchmark of `changed_draw`: a line for each, and a summary.

    first : the seeds unless others are named; output : the file, likewise
    unchanged : the option that leaves the change away; meaning : what it says
    """
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=seeds, default=first, help="FIRST:END")
    parser.add_argument("--jobs", type=int, default=1, help="processes of one thread each")
    parser.add_argument(unchanged, action="store_true", help=meaning)
    add_sources(parser)
    parser.add_argument("-o", "--output", type=Path, default=Path(output))
    print(*summary(recorded(job, parser.parse_args())), sep="\n")


def processes(count: int) -> Pool:
    """A pool of so many processes of one thread each."""
    # read when a process starts
    for name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[name] = "1"
    return multiprocessing.get_context("spawn").Pool(count, one_thread)


def one_thread() -> None:
    """OpenCV does not read the environment."""
    import cv2

    cv2.setNumThreads(1)


def main() -> None:
    """Run, read or compare."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=seeds, default=range(200), help="FIRST:END")
    parser.add_argument("--method", default="multi-light")
    parser.add_argument("--ratios", type=float, nargs="+", default=[], help="of depth_factor")
    parser.add_argument("--size", type=float, default=1.0, help="scale of the images")
    parser.add_argument("--oracle", type=int, default=0, help="of so many draws, the first")
    parser.add_argument("--jobs", type=int, default=1, help="processes of one thread each")
    parser.add_argument("--set", type=setting, action="append", default=[], metavar="FIELD=VALUE")
    parser.add_argument("--lights", choices=("found", "start", "fixed"), default="found")
    parser.add_argument("--off", type=float, default=0.0, metavar="DEG", help="of given lights")
    add_sources(parser)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/random.json"))
    parser.add_argument("--worst", type=int, default=0, metavar="N", help="describe so many")
    parser.add_argument("--read", type=Path, metavar="JSON", help="a run, instead of running")
    parser.add_argument("--compare", type=Path, nargs=2, metavar="JSON")
    arguments = parser.parse_args()
    if arguments.compare:
        print(*compared(*(json.loads(file.read_text()) for file in arguments.compare)), sep="\n")
        return
    if arguments.read:
        records = json.loads(arguments.read.read_text())
    else:
        lighting = {"lighting": load_method(arguments.method).lighting}
        arguments.overrides = lighting | dict(arguments.set)
        arguments.with_oracle = arguments.seeds[: arguments.oracle]
        records = recorded(assess, arguments)
    print(*summary(records), *worst(records, arguments.worst), sep="\n")


if __name__ == "__main__":
    main()

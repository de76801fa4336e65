"""What each constant of a method changes: switched off, halved and doubled, one at a time.

    python benchmarks/ablation.py --seeds 0:50 --size 0.5 --jobs 2 [-o out/ablation.json]
    python benchmarks/ablation.py --method rgb-ratio
    python benchmarks/ablation.py --only energy.FOURTH_DIFFERENCE_WEIGHT robust.NOTABLE
    python benchmarks/ablation.py --seeds 0:50 --jobs 2 --go-on      # after a stop
    python benchmarks/ablation.py --read out/ablation.json

A constant is a name in capitals to which a module of the method gives a number or several.  It is
set in every module that holds it and in the defaults of functions; then all draws are refined.  A
number from 0.75 to 1.5 has its distance from 1 halved and doubled.  Off is the value in `OFF`, with
which the constant does nothing; most have none.

Printed per value: the median over the draws of the angle's error, the geometric mean of its ratio
to the unchanged program's and of the depth error's, and how many draws are better and worse by 5 %.
Some draws lie between two local minima, where any change decides: the median says more than the
mean.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import json
import pickle
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from rakelight import RakelightError, refine
from rakelight.methods import load_method
from rakelight.metrics import evaluate_maps
from rakelight.synthetic import draw, render_draw
from random_captures import add_sources, processes, seeds

MODULES = {
    "multi-light": (
        *(f"methods/multi_light/{name}.py" for name in (
            "__init__", "model_selection", "steps", "energy", "joint_step", "noise",
            "equal_intensity", "initial_lights", "factored_start", "outliers", "normals",
            "bas_relief",
        )),
        "methods/levels.py", "prepare/jumps.py", "pipeline/guarded.py", "pipeline/held_back.py",
        "photometry/images.py", "photometry/specular.py", "solve/levenberg_marquardt.py",
        "solve/robust.py",
    ),
    "rgb-ratio": (
        "methods/rgb_ratio/__init__.py", "methods/levels.py", "methods/rgb_ratio/ratios.py",
        "pipeline/saturated_albedo.py", "pipeline/prediction.py",
        "methods/rgb_ratio/findings.py", "solve/robust.py",
    ),
}  # fmt: skip
"""Where a method's constants stand."""
NOT_TUNED = (
    "FOURTH_DIFFERENCE", "MEAN_ABSOLUTE_TO_SIGMA", "GAUGE_FREEDOM", "FEWEST", "SMALLEST_NOISE",
    "TINY", "ROUNDING", "BLOCKS", "ROWS", "BESIDE", "EXPONENTS",
)  # fmt: skip
"""The coefficients of one; the normal distribution's; unknowns, and what they need at least; the
rounding of values; against division by zero; parts of the work; the neighbours of one; and what is
compiled in, so that it cannot be set here (ablation.md has its trial)."""
OFF: dict[str, Any] = {
    "model_selection.MOST_VARIED_DISTANCES": np.inf,
    "energy.FOURTH_DIFFERENCE_WEIGHT": 0.0,
    "levels.FILLED": 1e-9,
    "robust.CAUCHY": 1e9,
}
"""Values with which a constant does nothing."""
NEAR_ONE = (0.75, 1.5)
"""Of such a number the distance from 1 is halved and doubled, or it would change sides."""

Errors = dict[str, tuple[float, float]]
"""Of each draw the angle, degrees, and the depth, mm."""


@dataclass(frozen=True)
class Trial:
    """One constant at one value; without a label the program as it is."""

    label: str = ""
    what: str = ""
    module: str = ""
    value: Any = None


def constants(method: str) -> Iterator[tuple[str, str, Any]]:
    """Module, name and value of each constant of a method, in the order of its modules."""
    for path in MODULES[method]:
        module = "rakelight." + path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        held = vars(importlib.import_module(module))
        for name in sorted(assigned(module), key=list(held).index):
            if name not in NOT_TUNED and is_number(held[name]):
                yield module, name, held[name]


def is_number(value: Any) -> bool:
    """Whether a value is a number or a tuple of numbers."""
    each = value if isinstance(value, tuple) else (value,)
    return all(isinstance(one, (int, float)) and not isinstance(one, bool) for one in each)


def scaled(value: Any, factor: float) -> Any:
    """A constant times a factor; whole numbers stay whole, and numbers near 1 on their side."""
    if isinstance(value, tuple):
        return tuple(scaled(each, factor) for each in value)
    if isinstance(value, int):
        return max(1, round(value * factor))
    if NEAR_ONE[0] <= value <= NEAR_ONE[1] and value != 1:
        return 1 + (value - 1) * factor
    return value * factor


def trials(method: str, only: Sequence[str]) -> list[Trial]:
    """The program as it is, then every constant off, halved, doubled."""
    found = [Trial()]
    for module, name, value in constants(method):
        label = f"{module.rpartition('.')[2]}.{name}"
        if only and label not in only:
            continue
        values = {"halved": scaled(value, 0.5), "doubled": scaled(value, 2.0)}
        if label in OFF:
            values = {"off": OFF[label], **values}
        found += [Trial(label, what, module, new) for what, new in values.items()]
    return found


def put(module: str, name: str, value: Any) -> Any:
    """Give a constant a value in every module that imports it; returns the value that it had.

    A default of a function is a value of its own; small whole numbers, of which Python keeps one
    object each, are not looked for there.
    """
    old = getattr(sys.modules[module], name)
    for key, holder in list(sys.modules.items()):
        if not key.startswith("rakelight") or getattr(holder, name, None) is not old:
            continue
        if key != module and name in assigned(key):  # another constant of that name
            continue
        setattr(holder, name, value)
        for function in vars(holder).values():
            if isinstance(function, FunctionType) and function.__defaults__ and not is_small(old):
                function.__defaults__ = tuple(
                    value if each is old else each for each in function.__defaults__
                )
    return old


def is_small(value: Any) -> bool:
    """Whether a value is one of the whole numbers of which Python keeps one object each."""
    return isinstance(value, int) and -5 <= value <= 256


@cache
def assigned(module: str) -> frozenset[str]:
    """The names in capitals that a module assigns itself."""
    tree = ast.parse(Path(sys.modules[module].__file__ or "").read_text())
    nodes = (
        node
        for statement in tree.body
        if isinstance(statement, ast.Assign)
        for node in ast.walk(statement.targets[0])
    )
    return frozenset(node.id for node in nodes if isinstance(node, ast.Name) and node.id.isupper())


def refined(trial: Trial, method: str, folder: Path) -> dict[str, Any]:
    """Every draw's errors in one trial, or how it failed."""
    files = sorted(folder.glob("*.pickle"))
    # What a method imports late has to be there before a constant is set.
    refine(pickle.loads(files[0].read_bytes())[0], method)
    name = trial.label.rpartition(".")[2]
    old = put(trial.module, name, trial.value) if name else None
    record: dict[str, Any] = {"label": trial.label, "what": trial.what, "was": str(old)}
    errors: Errors = {}
    try:
        for file in files:
            capture, truth = pickle.loads(file.read_bytes())
            try:
                result = refine(capture, method)
            except RakelightError:
                continue
            counted = truth.mask & capture.mask & np.isfinite(result.prepared_depth)
            found = evaluate_maps(result.depth, result.normals, truth, counted)
            errors[file.stem] = (found.normals.mae_deg, found.depth.rmse_mm)
    except Exception as error:  # a value that the method cannot work with is a result
        return {**record, "failed": type(error).__name__}
    finally:
        if name:
            put(trial.module, name, old)
    return {**record, "errors": errors}


def render(seed: int, arguments: argparse.Namespace, folder: Path) -> None:
    """Render one draw of `random_captures.py`, at another size, to a file."""
    lighting = load_method(arguments.method).lighting
    drawn = draw(seed, arguments.size, arguments.scans, arguments.pictures, lighting=lighting)
    (folder / f"{seed:04d}.pickle").write_bytes(pickle.dumps(render_draw(drawn)))


def table(records: Sequence[dict[str, Any]]) -> Iterator[str]:
    """A line per constant and value."""
    base = next(record["errors"] for record in records if not record["label"])
    middle = np.median([deg for deg, _ in base.values()])
    yield f"{len(base)} draws; unchanged: median {middle:.2f} deg"
    yield ""
    yield "| constant | value | | median angle | angle | depth | better | worse |"
    yield "|" + " --- |" * 8
    for record in records:
        if record["label"]:
            cells = [record["label"], record["was"], record["what"], *compared(base, record)]
            yield f"| {' | '.join(cells)} |"


def compared(base: Errors, record: dict[str, Any]) -> list[str]:
    """Ratio of the median angle, of angle and depth (geometric means), draws better and worse."""
    if "failed" in record:
        return [record["failed"], "", "", "", ""]
    shared = sorted(set(base) & set(record["errors"]))
    before, after = (np.array([each[seed] for seed in shared]) for each in (base, record["errors"]))
    ratios = after / before
    means = np.exp(np.log(ratios).mean(axis=0))
    median = np.median(after[:, 0]) / np.median(before[:, 0])
    better, worse = (ratios[:, 0] < 0.95).sum(), (ratios[:, 0] > 1.05).sum()
    return [*(f"{value:.3f}" for value in (median, *means)), str(better), str(worse)]


def main() -> None:
    """Run or read."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--method", choices=list(MODULES), default="multi-light")
    parser.add_argument("--seeds", type=seeds, default=range(50), help="FIRST:END")
    parser.add_argument("--size", type=float, default=0.5, help="of the draws' images")
    parser.add_argument("--jobs", type=int, default=2, help="processes of one thread each")
    add_sources(parser)
    parser.add_argument("--only", nargs="*", default=[], help="MODULE.NAME")
    parser.add_argument(
        "--go-on",
        action="store_true",
        help="only the trials that the output does not hold yet, of the same draws",
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("out/ablation.json"))
    parser.add_argument("--read", type=Path, metavar="JSON", help="a run, instead of running")
    arguments = parser.parse_args()
    if arguments.read:
        print(*table(json.loads(arguments.read.read_text())), sep="\n")
        return
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    records = json.loads(arguments.output.read_text()) if arguments.go_on else []
    done = {(record["label"], record["what"]) for record in records}
    wanted = [
        each
        for each in trials(arguments.method, arguments.only)
        if (each.label, each.what) not in done
    ]
    with tempfile.TemporaryDirectory() as folder, processes(arguments.jobs) as pool:
        pool.map(partial(render, arguments=arguments, folder=Path(folder)), arguments.seeds)
        run = partial(refined, method=arguments.method, folder=Path(folder))
        for count, record in enumerate(pool.imap(run, wanted), 1):
            print(f"{count}/{len(wanted)}", record["label"], record["what"], flush=True)
            records.append(record)
            arguments.output.write_text(json.dumps(records))
    print(*table(records), sep="\n")


if __name__ == "__main__":
    main()

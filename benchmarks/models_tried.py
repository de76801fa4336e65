"""How much of a refinement goes into models that are tried and not taken.

    python benchmarks/models_tried.py --seeds 0:30 --jobs 2
    python benchmarks/models_tried.py --seeds 0:30 --set photographs=60 --jobs 2
    python benchmarks/models_tried.py --seeds 0:16 --beams --jobs 2

Captures of `random_captures.py` with objects of about 40,000 pixels and 16 photographs, unless set
otherwise; with `--beams` under a torch, as in `beams.py`.  Printed is the processor's time of a
refinement over that of the model that wins: of what is left without the starts, kinds of lights and
depth weights that did not lead there.  Refinements that are refused do not count.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from time import process_time
from typing import Any
from unittest import mock

import numpy as np

from beams import aimed
from rakelight import RakelightError
from rakelight.methods import multi_light
from rakelight.methods.multi_light import MultiLight, model_selection
from rakelight.methods.multi_light.energy import Fit
from rakelight.methods.multi_light.steps import Descent
from rakelight.model import silent
from rakelight.prepare import prepare
from rakelight.synthetic import draw, render_draw
from random_captures import add_sources, processes, seeds, setting

PIXELS, PHOTOGRAPHS = 40_000, 16
PIXEL_MM = 0.3  # one pixel on the object, so that it is as large as other draws'


class Stopwatch:
    """The processor's seconds of each descent, found again by the depth maps that it joins."""

    def __init__(self) -> None:
        self.descents: list[tuple[Fit, Descent, float]] = []
        self.starts: list[tuple[Fit, float]] = []
        self.near_s = 0.0

    def timed(
        self, descend: Callable[..., Descent], level: Any, fit: Fit, *rest: Any, **named: Any
    ) -> Descent:
        """A descent at the coarsest level, or of near lights tried at the finest."""
        began = process_time()
        descent = descend(level, fit, *rest, **named)
        self.descents.append((fit, descent, process_time() - began))
        return descent

    def started(self, starts: Callable[..., Iterator[Fit]], *given: Any) -> Iterator[Fit]:
        """The starts, one by one."""
        began = process_time()
        for fit in starts(*given):
            self.starts.append((fit, process_time() - began))
            yield fit
            began = process_time()

    def near(self, with_near_lights: Callable[..., Fit], *given: Any) -> Fit:
        """The lights with which near ones begin."""
        began = process_time()
        fit = with_near_lights(*given)
        self.near_s += process_time() - began
        return fit

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Inside, the coarsest level's descents and starts are timed."""
        names = {"descend": self.timed, "starts": self.started, "with_near_lights": self.near}
        with mock.patch.multiple(
            model_selection,
            **{name: partial(own, getattr(model_selection, name)) for name, own in names.items()},
        ):
            yield

    def lost_s(self, chosen: Fit) -> float:
        """Seconds of the descents and starts that did not lead to the chosen state."""
        wanted, lost = chosen.log_depth, 0.0
        for fit, descent, seconds in reversed(self.descents):
            if descent.fit.log_depth is wanted:
                wanted = fit.log_depth
            else:
                lost += seconds
        lost += sum(seconds for fit, seconds in self.starts if fit.log_depth is not wanted)
        return lost + (0.0 if chosen.model.near else self.near_s)


def ratio(seed: int, arguments: argparse.Namespace) -> tuple[float, float] | None:
    """Seconds of a refinement and those of the model that wins."""
    settings = {"photographs": PHOTOGRAPHS, "object_px": PIXELS, "pixel_mm": PIXEL_MM}
    if arguments.beams:
        settings |= {"bits": 16, "encoding": "linear", "gamma": 1.0}
    settings |= dict(arguments.set)
    drawn = draw(seed, 1.0, arguments.scans, arguments.pictures, **settings)
    watch, chosen = Stopwatch(), []
    select = multi_light.select_without_outliers

    def selected(*given: Any) -> Descent:
        chosen.append(select(*given))
        return chosen[-1]

    try:
        capture, truth = render_draw(drawn)
        prepared = prepare(aimed(capture, truth, seed, wide=not arguments.beams))
        began = process_time()
        with watch.watching(), mock.patch.object(multi_light, "select_without_outliers", selected):
            multi_light.multi_light(prepared, MultiLight(), silent)
    except RakelightError:
        return None
    seconds = process_time() - began
    return seconds, seconds - watch.lost_s(chosen[0].fit)


def main() -> None:
    """Run, and print the ratios."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=seeds, default=range(30), help="FIRST:END")
    parser.add_argument("--jobs", type=int, default=1, help="processes of one thread each")
    parser.add_argument("--set", type=setting, action="append", default=[], metavar="FIELD=VALUE")
    parser.add_argument("--beams", action="store_true", help="under a torch")
    add_sources(parser)
    arguments = parser.parse_args()
    with processes(arguments.jobs) as pool:
        found = pool.map(partial(ratio, arguments=arguments), arguments.seeds, chunksize=1)
    each = np.array([pair for pair in found if pair])
    if not each.size:
        raise SystemExit("no capture of these seeds can be refined")
    ratios = each[:, 0] / each[:, 1]
    seconds, winner = np.median(each, axis=0)
    print(
        f"{len(each)} captures: {seconds:.2f} s at the median, {winner:.2f} of the model that wins"
    )
    middle, most = np.quantile(ratios, [0.5, 0.9])
    print(f"ratio: median {middle:.2f}, 90 % {most:.2f}, largest {ratios.max():.2f}")


if __name__ == "__main__":
    main()

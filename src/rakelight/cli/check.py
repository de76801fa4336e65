"""`rakelight check CAPTURE`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from rakelight.checkup.report import CheckReport
from rakelight.cli.options import NamedPath, output_options, refuse_input_as_output
from rakelight.errors import printable, rounded

# Characters; no line is as long, and what is no terminal breaks none.
_ENDLESS = 100_000
# Characters of the narrowest column of marks: the longest of their words, "under-exposed,".
_NARROWEST_MARKS = 14
_HEADINGS = (
    "photograph", "saturated", "black", "edges px", "shift px", "light off axis", "from",
)  # fmt: skip


@click.command("check")
@click.argument("capture", type=NamedPath())
@click.option(
    "--html",
    type=NamedPath(),
    metavar="FILE",
    help="Write the check as a page with the photographs and a plot of the lights.",
)
@click.option("--overwrite", is_flag=True, help="Replace an older page of a check at FILE.")
@output_options
def command(
    capture: Path, html: Path | None, overwrite: bool, as_json: bool, quiet: bool, debug: bool
) -> None:
    """Is the capture folder CAPTURE any good, and what could be better: before anybody waits.

    Looks at exposure, sharpness, motion, lights and depth, refines it quickly at low resolution,
    and says what accuracy to expect and where the next lights should be.  The exit code is 2 when
    nothing is to be gained by refining it.
    """
    from tempfile import TemporaryFile

    from rakelight.capture import load_capture
    from rakelight.checkup import check_capture
    from rakelight.cli.first_run import compiling_beside
    from rakelight.files import clear_errors
    from rakelight.report.check_page import check_html, require_free_page, write_page

    if html is not None:
        refuse_input_as_output(capture, html)
        require_free_page(html, overwrite=overwrite)
        with clear_errors(str(html), "cannot be written"), TemporaryFile(dir=html.parent):
            pass  # its folder is there, and may be written to
    with compiling_beside():
        loaded = load_capture(capture)
        report = check_capture(loaded)
    if html is not None:
        write_page(html, check_html(report, loaded), overwrite=overwrite)
    if as_json:
        click.echo(json.dumps(report.as_dict()))
    elif not quiet:
        show(report)
        if html is not None:
            click.echo(f"page: {printable(str(html))}")
    if report.refusal is not None:
        raise report.refusal


def show(report: CheckReport) -> None:
    """Print the verdict, the findings and a table of the photographs."""
    import sys

    from rich.console import Console
    from rich.text import Text

    console = Console(file=sys.stdout, highlight=False)
    colour = {"good": "green", "usable": "yellow"}.get(report.verdict, "red")
    console.print(Text(printable(report.headline), style=f"bold {colour}"), soft_wrap=True)
    for finding in report.findings:
        line = f"{finding.severity}: {finding.message}"
        line += f". To do: {finding.remedy}" if finding.remedy else ""
        style = "yellow" if finding.severity == "warning" else ""
        console.print(Text(printable(line), style=style), soft_wrap=True)
    table = photograph_table(report, _degrees(console.encoding))
    room = console.measure(table, options=console.options.update(width=_ENDLESS))
    terminal = sys.stdout.isatty()
    console.width = max(console.width, room.minimum) if terminal else room.maximum
    console.print(table)
    for line in facts(report):
        console.print(Text(printable(line)), soft_wrap=True)


def _degrees(encoding: str) -> str:
    """The unit of an angle, in letters that the encoding has.

    >>> _degrees("utf-8"), _degrees("ascii")
    ('°', ' deg')
    """
    try:
        "°".encode(encoding)
    except UnicodeEncodeError:
        return " deg"
    return "°"


def photograph_table(report: CheckReport, degrees: str = "°") -> Any:
    """A line for each photograph, as a rich table in which only headings and marks are wrapped."""
    from rich import box
    from rich.cells import cell_len
    from rich.table import Table
    from rich.text import Text

    rows, marks = [], []
    for each in report.as_dict()["photographs"]:
        light, shift, edge = each["light"], each["shift_px"], each["edge_px"]
        moved = None if shift is None else (shift[0] ** 2 + shift[1] ** 2) ** 0.5
        rows.append(
            [
                printable(each["name"]),
                f"{each['saturated']:.0%}",
                f"{each['black']:.0%}",
                "-" if edge is None else f"{edge:.1f}",
                "-" if moved is None else f"{moved:.1f}",
                "-" if light is None else f"{light['tilt_deg']:.0f}{degrees}",
                "-" if light is None else f"{light['azimuth_deg']:.0f}{degrees}",
            ]
        )
        marks.append(printable(", ".join(each["marks"])))
    table = Table(box=box.SIMPLE, padding=0)
    for i, heading in enumerate(_HEADINGS):
        width = max(map(cell_len, [*heading.split(), *(row[i] for row in rows)]))
        table.add_column(heading, width=width, justify="right" if i else "left")
    table.add_column("", min_width=min(max(map(len, marks), default=0), _NARROWEST_MARKS))
    for row, marked in zip(rows, marks, strict=True):
        style = "yellow" if marked else ""
        table.add_row(*(Text(cell) for cell in (*row, marked)), style=style)
    return table


def facts(report: CheckReport) -> list[str]:
    """Depth, expected accuracy and the next lights, a line each."""
    lines = []
    if (depth := report.depth) is not None:
        lines.append(
            f"depth: {depth.median_m:.2f} m away, object {1000 * depth.width_m:.0f} mm "
            f"wide and {1000 * depth.height_m:.0f} mm high, "
            f"{depth.holes:.1%} holes, noise {rounded(depth.noise_mm)} mm, "
            f"{depth.pixels} depth pixels"
        )
    if (expected := report.accuracy) is not None:
        (low, high), (least, most) = expected.depth_mm, expected.normals_deg
        lines.append(
            f"expect: two thirds of the object within {rounded(low)} - {rounded(high)} mm and "
            f"{rounded(least)} - {rounded(most)} degrees (3 of 4 captures)"
        )
    for i, light in enumerate(report.next_lights):
        start = "the next light: " if i == 0 else "then: "
        lines.append(f"{start}{light.words} (normals' error {-light.gain:.0%})")
    return lines

"""`rakelight refine CAPTURE -o OUT`."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any, Literal

import click

from rakelight.cli.options import (
    count_photographs,
    findings_as_json,
    output_options,
    parse_memory,
    parse_photographs,
    parse_scale,
    print_findings,
    refuse_input_as_output,
)
from rakelight.cli.progress import shown_progress
from rakelight.cli.view import view_command
from rakelight.errors import printable
from rakelight.methods import METHODS
from rakelight.model import Progress, Result


@click.command("refine")
@click.argument("capture", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    required=True,
    metavar="OUT",
    help="The result folder; appears complete or not at all.",
)
@click.option(
    "--method",
    default="auto",
    show_default=True,
    help=f"{', '.join(METHODS)}; auto is the best one that fits.",
)
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="NAME=VALUE",
    help="An option of the method, as depth_weight=3 or lights=white; none for None; repeatable.",
)
@click.option(
    "--scale",
    default="auto",
    show_default=True,
    help="Output resolution over the depth's, a whole number; auto is the colour camera's.",
)
@click.option(
    "--memory",
    metavar="SIZE",
    help="Keep to so much memory, as 4GB; by default to what is free. Large photographs are then "
    "refined in parts.",
)
@click.option("--photographs", metavar="LIST", help="Use only these, as 0-14,17; all if left away.")
@click.option("--overwrite", is_flag=True, help="Replace an older result at OUT.")
@click.option(
    "--normal-map",
    type=click.Choice(["opengl", "directx"]),
    default="opengl",
    show_default=True,
    help="Axes of normals.png.",
)
@click.option(
    "--mesh",
    type=click.Choice(["ply", "glb", "none"]),
    default="ply",
    show_default=True,
    help="Format of the mesh; ply has the camera's axes, glb those of glTF (y up).",
)
@output_options
def command(
    capture: Path,
    output: Path,
    method: str,
    settings: tuple[str, ...],
    scale: str,
    memory: str | None,
    photographs: str | None,
    overwrite: bool,
    normal_map: Literal["opengl", "directx"],
    mesh: Literal["ply", "glb", "none"],
    as_json: bool,
    quiet: bool,
    debug: bool,
) -> None:
    """Refine the depth of CAPTURE by its photographs; write OUT.

    CAPTURE is a capture folder or whatever else `rakelight import --list` names.
    """
    from rakelight.capture import has_truth, load_truth
    from rakelight.capture.readers import Wanted, find_reader
    from rakelight.cli.settings import options_with, parse_settings
    from rakelight.export import RESULT
    from rakelight.folders import require_free
    from rakelight.memory import limited_memory
    from rakelight.methods import choose_method, load_method
    from rakelight.pipeline import refine
    from rakelight.report import save_result

    limit = None if memory is None else parse_memory(memory)
    wanted, named, options = parse_scale(scale), parse_settings(settings), None
    if named and method != "auto":  # wrong ones are refused before anything is read
        options = options_with(load_method(method), named)
    chosen = None if photographs is None else tuple(parse_photographs(photographs))
    refuse_input_as_output(capture, output)
    require_free(output, manifest=RESULT, overwrite=overwrite)
    began = perf_counter()
    with limited_memory(limit), shown_progress(quiet or as_json) as progress:
        progress(Progress("read"))
        loaded = find_reader(capture).read(capture, Wanted(chosen, progress)).capture
        truth = load_truth(capture) if has_truth(capture) else None
        read_s = perf_counter() - began
        if named and method == "auto":
            options = options_with(load_method(choose_method(loaded)), named)
        result = refine(loaded, method, scale=wanted, options=options, progress=progress)
        progress(Progress("write"))
        result = result.timed(read=read_s)
        kept = save_result(
            result, output, overwrite=overwrite, mesh=mesh, normal_map=normal_map, truth=truth
        )
        result = replace(result, findings=(*result.findings, *kept))
    if as_json or not quiet:
        report_result(result, output, as_json)


def outcome(result: Result, folder: Path) -> dict[str, Any]:
    """What `--json` prints of a result."""
    return {
        "output": printable(str(folder)),
        "method": result.method,
        "iterations": result.iterations,
        "converged": result.converged,
        "pixels": int(result.mask.sum()),
        "photographs": len(result.lights),
        "timings_s": {stage: round(seconds, 3) for stage, seconds in result.timings_s.items()},
        "findings": findings_as_json(result.findings),
    }


def report_result(result: Result, folder: Path, as_json: bool) -> None:
    """Print the outcome: JSON on stdout, or a few lines with the warnings on stderr."""
    facts = outcome(result, folder)
    if as_json:
        click.echo(json.dumps(facts))
        return
    print_findings(result.findings)
    height, width = result.depth.shape
    ended = "converged" if result.converged else "stopped"
    click.echo(
        f"{result.method}: {count_photographs(facts['photographs'])}, {width} x {height}, "
        f"{facts['pixels']} pixels, {ended} after {result.iterations} iterations"
    )
    click.echo(f"result: {facts['output']}  (look at it with `{printable(view_command(folder))}`)")

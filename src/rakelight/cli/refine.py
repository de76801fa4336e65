"""`rakelight refine CAPTURE -o OUT`."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rakelight.cli.options import (
    F,
    NamedPath,
    findings_as_json,
    output_folder,
    output_options,
    parse_memory,
    parse_photographs,
    parse_scale,
    print_findings,
    refuse_input_as_output,
)
from rakelight.cli.progress import shown_progress
from rakelight.cli.view import view_command
from rakelight.errors import counted, printable, rounded
from rakelight.export.mesh_formats import DEFAULT_MESH, MESH_CHOICES, MESH_FORMATS
from rakelight.methods import METHODS
from rakelight.model import Result
from rakelight.pictures.colors import AXES

if TYPE_CHECKING:
    from rakelight.recipe import Recipe


# How a capture is refined and written; `recipe_of` reads them.
_RECIPE_OPTIONS = (
    click.option(
        "--method",
        default="auto",
        show_default=True,
        help=f"{', '.join(METHODS)}; auto is the best one that fits.",
    ),
    click.option(
        "--set",
        "settings",
        multiple=True,
        metavar="NAME=VALUE",
        help="An option of the method, as depth_weight=3 or lights=white; none for None; "
        "repeatable.",
    ),
    click.option(
        "--scale",
        default="auto",
        show_default=True,
        help="Output resolution over the depth's, a whole number; auto is the colour camera's.",
    ),
    click.option(
        "--photographs", metavar="LIST", help="Use only these, as 0-14,17; all if left away."
    ),
    click.option(
        "--normal-map",
        type=click.Choice(list(AXES)),
        default="opengl",
        show_default=True,
        help="Axes of normals.png.",
    ),
    click.option(
        "--mesh",
        type=click.Choice(MESH_CHOICES),
        default=DEFAULT_MESH,
        show_default=True,
        help="Format of the mesh; "
        + ", ".join(f"{name} has {each.axes}" for name, each in MESH_FORMATS.items())
        + ".",
    ),
)


def recipe_options(command: F) -> F:
    """The options that `refine` and `batch` share."""
    for option in reversed(_RECIPE_OPTIONS):
        command = option(command)
    return command


def recipe_of(
    method: str, settings: tuple[str, ...], scale: str, photographs: str | None, **written: Any
) -> Recipe:
    """The recipe that these options ask for; raises InputError for a wrong one.

    written : `mesh` and `normal_map`
    """
    from rakelight.cli.settings import options_with, parse_settings
    from rakelight.recipe import Recipe

    named = parse_settings(settings)
    recipe = Recipe(
        method=method,
        settings=tuple(named.items()),
        options_for=partial(options_with, settings=named) if named else None,
        scale=parse_scale(scale),
        photographs=None if photographs is None else tuple(parse_photographs(photographs)),
        **written,
    )
    if named or method != "auto":  # wrong ones are refused before anything is read
        recipe.check()
    return recipe


@click.command("refine")
@click.argument("capture", type=NamedPath())
@output_folder("OUT", "The result folder; appears complete or not at all.")
@recipe_options
@click.option(
    "--memory",
    metavar="SIZE",
    help="Keep to so much memory, as 4GB; by default to what is free. Large photographs are then "
    "refined in parts.",
)
@click.option("--overwrite", is_flag=True, help="Replace an older result at OUT.")
@output_options
def command(
    capture: Path,
    output: Path,
    memory: str | None,
    overwrite: bool,
    as_json: bool,
    quiet: bool,
    debug: bool,
    **options: Any,
) -> None:
    """Refine the depth of CAPTURE by its photographs; write OUT.

    CAPTURE is a capture folder or whatever else `rakelight import --list` names.
    """
    from rakelight.cli.first_run import compiling_beside
    from rakelight.export import RESULT
    from rakelight.folders import only_writer, require_free
    from rakelight.memory import limited_memory
    from rakelight.recipe import refine_source

    limit = None if memory is None else parse_memory(memory)
    recipe = recipe_of(**options)
    refuse_input_as_output(capture, output)
    require_free(output, manifest=RESULT, overwrite=overwrite)
    progress_shown = shown_progress(quiet or as_json)
    with only_writer(output), limited_memory(limit), compiling_beside(), progress_shown as progress:
        result = refine_source(capture, output, recipe, overwrite=overwrite, progress=progress)
    if as_json or not quiet:
        report_result(result, output, as_json)


def outcome(result: Result, folder: Path) -> dict[str, Any]:
    """What `--json` prints of a result."""
    expected = None
    if result.expected_errors is not None:
        depth_m, normals_deg = result.expected_errors
        expected = {"depth_mm": round(1000 * depth_m, 3), "normals_deg": round(normals_deg, 2)}
    return {
        "output": printable(str(folder)),
        "method": result.method,
        "iterations": result.iterations,
        "converged": result.converged,
        "pixels": int(result.mask.sum()),
        "photographs": len(result.lights),
        "expected_errors": expected,
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
        f"{result.method}: {counted(facts['photographs'], 'photograph')}, {width} x {height}, "
        f"{facts['pixels']} pixels, {ended} after {counted(result.iterations, 'iteration')}"
    )
    if (expected := facts["expected_errors"]) is not None:
        click.echo(
            f"expected errors: {rounded(expected['depth_mm'])} mm in depth, "
            f"{rounded(expected['normals_deg'])} degrees in normals (medians)"
        )
    click.echo(f"result: {facts['output']}  (look at it with `{printable(view_command(folder))}`)")

"""`rakelight demo`: a synthetic capture, refined, beside its own truth."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import click

from rakelight.cli.eval import score_table
from rakelight.cli.options import NamedPath, output_options, print_findings
from rakelight.cli.progress import shown_progress
from rakelight.cli.refine import outcome
from rakelight.errors import OutputExistsError, printable
from rakelight.model import Progress


@click.command("demo")
@click.option(
    "-o",
    "--output",
    type=NamedPath(),
    default=Path("out/demo"),
    show_default=True,
    help="Where the capture and the result go; an earlier demo there is replaced.",
)
@output_options
def command(output: Path, as_json: bool, quiet: bool, debug: bool) -> None:
    """Make a synthetic capture of a painted vase under 12 lights and refine it.

    The depth sensor of this capture has half the colour camera's resolution, noise of 2.5 mm,
    steps of 1 mm and holes.
    """
    from rakelight.capture import SYNTHETIC, load_capture, write_capture
    from rakelight.capture.config import CONFIG
    from rakelight.cli.first_run import compiling_beside
    from rakelight.export import RESULT
    from rakelight.export.mesh_formats import DEFAULT_MESH, mesh_file
    from rakelight.folders import only_writer, require_free
    from rakelight.metrics import evaluate_depth, evaluate_maps
    from rakelight.pipeline import refine
    from rakelight.report import save_result
    from rakelight.synthetic import demo_scene

    if any((output / each).exists() for each in (CONFIG, RESULT.name)):
        raise OutputExistsError(
            "this is a capture or a result, into which no demo is written",
            source=str(output),
            remedy="choose another folder",
        )
    folder, result_folder = output / "capture", output / "result"
    require_free(folder, manifest=SYNTHETIC, overwrite=True)  # never somebody's own capture
    require_free(result_folder, manifest=RESULT, overwrite=True)
    taken = (only_writer(folder), only_writer(result_folder))
    with taken[0], taken[1], compiling_beside(), shown_progress(quiet or as_json) as progress:
        progress(Progress("render"))
        scene, truth = demo_scene()
        kept = write_capture(scene, folder, truth=truth, overwrite=True)
        result = refine(load_capture(folder), progress=progress)
        progress(Progress("write"))
        kept += save_result(result, result_folder, overwrite=True, truth=truth)
    if not quiet:
        print_findings(kept)
    before = evaluate_depth(result.prepared_depth, result.camera, truth)
    after = evaluate_maps(result.depth, result.normals, truth)
    if as_json:
        scores = {"prepared": asdict(before), "refined": asdict(after)}
        click.echo(json.dumps({**outcome(result, result_folder), "errors": scores}))
    elif not quiet:
        click.echo(score_table(before, after))
        click.echo(f"normals: {before.normals.mae_deg / after.normals.mae_deg:.1f} times better")
        for name in (
            "preview.png",
            "depth.tiff",
            "normals.png",
            mesh_file(DEFAULT_MESH),
            "report.html",
        ):
            click.echo(f"  {printable(str(result_folder / name))}")

"""`rakelight eval OUT --truth CAPTURE`."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import click

from rakelight.cli.options import NamedPath, output_options, print_findings, refuse_input_as_output
from rakelight.errors import InputError, printable
from rakelight.folders import file_list, require_free, staged_folder
from rakelight.metrics import DEPTH_RANGE_MM, NORMAL_RANGE_DEG, Evaluation
from rakelight.model import Finding, Floats, Truth, checksum

_MAPS = file_list("folder of error maps")


@click.command("eval")
@click.argument("result", type=NamedPath(), metavar="OUT")
@click.option(
    "--truth",
    type=NamedPath(),
    required=True,
    metavar="CAPTURE",
    help="A capture folder with its truth, as synth writes it.",
)
@click.option(
    "--maps",
    type=NamedPath(),
    metavar="DIR",
    help="Write error maps there: depth_error.png, normal_error.png.",
)
@click.option("--overwrite", is_flag=True, help="Replace older error maps at DIR.")
@output_options
def command(
    result: Path,
    truth: Path,
    maps: Path | None,
    overwrite: bool,
    as_json: bool,
    quiet: bool,
    debug: bool,
) -> None:
    """Compare the result folder OUT with the truth of the capture it was made from.

    RMSE and quantiles of depth in mm, mean and quantiles of the normals' angle in degrees, over
    the truth's mask; docs/reference/conventions.md says how missing pixels count.
    """
    from rakelight.capture import load_depth, load_truth
    from rakelight.export import load_result
    from rakelight.metrics import evaluate_depth, evaluate_maps

    if maps is not None:
        refuse_input_as_output(truth, maps)
        refuse_input_as_output(result, maps, "result")
        require_free(maps, manifest=_MAPS, overwrite=overwrite)
    loaded, reference = load_result(result), load_truth(truth)
    made_from, source = loaded.capture.get("depth_checksum"), loaded.source
    # Results of earlier versions have none.
    if made_from is not None and made_from != checksum(load_depth(truth)):
        raise InputError(
            "this result was made from another capture",
            source=str(result),
            seen=f"the depth maps of {source or 'another'}, size {loaded.depth.shape}",
            needed=f"those of {truth}, size {reference.depth.shape}",
            remedy="name the capture that was refined, or refine this one again",
        )
    after = evaluate_maps(loaded.depth, loaded.normals, reference)
    before = evaluate_depth(loaded.prepared_depth, loaded.camera, reference)
    if maps is not None:
        kept = _write_maps(loaded.depth, loaded.normals, reference, maps, overwrite)
        if not quiet:
            print_findings(kept)
    if as_json:
        scores = {"prepared": asdict(before), "refined": asdict(after)}
        click.echo(json.dumps({"result": printable(str(result)), **scores}))
    elif not quiet:
        click.echo(score_table(before, after))
        if maps is not None:
            click.echo(f"error maps: {printable(str(maps))}")


def score_table(before: Evaluation, after: Evaluation) -> str:
    """The errors of the prepared and of the refined depth, as a table."""
    lines = [f"{'':10}{'depth, mm':>26}{'normals, degrees':>28}{'':>12}"]
    head = ("RMSE", "median", "95 %", "mean", "median", "95 %")
    lines.append(f"{'':10}" + "".join(f"{h:>9}" for h in head) + f"{'coverage':>12}")
    for name, e in (("prepared", before), ("refined", after)):
        depth, normals = e.depth, e.normals
        values = (depth.rmse_mm, depth.median_mm, depth.p95_mm)
        angles = (normals.mae_deg, normals.median_deg, normals.p95_deg)
        numbers = "".join(f"{v:9.2f}" for v in (*values, *angles))
        lines.append(f"{name:10}{numbers}{100 * depth.coverage:10.1f} %")
    return "\n".join(lines)


def _write_maps(
    depth: Floats, normals: Floats, truth: Truth, folder: Path, overwrite: bool
) -> tuple[Finding, ...]:
    from rakelight.capture.images import encode_png
    from rakelight.files import write_bytes
    from rakelight.metrics import depth_error_map_mm, normal_error_map_deg
    from rakelight.pictures.colors import color_errors

    depth_map = depth_error_map_mm(depth, truth.depth, truth.mask)
    normal_map = normal_error_map_deg(normals, truth.normals, truth.mask)
    with staged_folder(folder, manifest=_MAPS, overwrite=overwrite) as staging:
        for name, errors, largest in (
            ("depth_error.png", depth_map, DEPTH_RANGE_MM),
            ("normal_error.png", normal_map, NORMAL_RANGE_DEG),
        ):
            write_bytes(staging.path / name, encode_png(color_errors(errors, largest)))
    return staging.findings

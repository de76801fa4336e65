"""A result folder with its report."""

from __future__ import annotations

from functools import partial
from os import PathLike

from rakelight.export import save_result
from rakelight.export.normals import NormalMap
from rakelight.export.summary import MeshFormat
from rakelight.model import Finding, Result, Truth
from rakelight.report.page import report_html

REPORT = "report.html"


def save_with_report(
    result: Result,
    folder: str | PathLike[str],
    *,
    overwrite: bool = False,
    mesh: MeshFormat = "ply",
    normal_map: NormalMap = "opengl",
    truth: Truth | None = None,
) -> tuple[Finding, ...]:
    """`export.save_result` with report.html among the files; what `Result.save` calls.

    truth : of a synthetic capture, for the errors in the report; left out where it has another
        size than the result

    Returns and raises what `save_result` does.
    """
    if truth is not None and truth.depth.shape != result.depth.shape:
        truth = None
    return save_result(
        result,
        folder,
        overwrite=overwrite,
        mesh=mesh,
        normal_map=normal_map,
        extra_files={REPORT: partial(report_html, truth=truth)},
    )

"""A result folder with its report."""

from __future__ import annotations

from functools import partial
from os import PathLike

from rakelight.export import save_result
from rakelight.export.normals import NormalMap
from rakelight.export.summary import MeshFormat
from rakelight.model import Result, Truth
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
) -> None:
    """`export.save_result` with report.html among the files; what `Result.save` calls.

    truth : of a synthetic capture, for the errors in the report; left out where it has another
        size than the result

    Raises what `save_result` raises.

    >>> from tempfile import TemporaryDirectory
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from rakelight.model import Camera, Lights
    >>> plane, facing = np.ones((4, 4), np.float32), np.zeros((4, 4, 3), np.float32)
    >>> facing[..., 2] = -1
    >>> result = Result(depth=plane, normals=facing, albedo=-facing, confidence=plane,
    ...                 lights=Lights(np.zeros((1, 1, 3)), np.ones((1, 1))),
    ...                 camera=Camera(4, 4, 100.0, 100.0, 1.5, 1.5), prepared_depth=plane,
    ...                 method="none")
    >>> with TemporaryDirectory() as scratch:
    ...     save_with_report(result, Path(scratch) / "out")
    ...     (Path(scratch) / "out" / "report.html").read_text(encoding="utf-8")[:15]
    '<!doctype html>'
    """
    if truth is not None and truth.depth.shape != result.depth.shape:
        truth = None
    save_result(
        result,
        folder,
        overwrite=overwrite,
        mesh=mesh,
        normal_map=normal_map,
        extra_files={REPORT: partial(report_html, truth=truth)},
    )

"""A result folder with its report."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from os import PathLike
from pathlib import Path

from rakelight.errors import InputError, check_is
from rakelight.export import write_result
from rakelight.export.mesh_formats import DEFAULT_MESH
from rakelight.geometry.finite import require_numbers
from rakelight.model import Finding, Result, Truth
from rakelight.pictures.colors import NormalMap
from rakelight.report.page import report_html

REPORT = "report.html"


def save_result(
    result: Result,
    folder: str | PathLike[str],
    *,
    overwrite: bool = False,
    mesh: str = DEFAULT_MESH,
    normal_map: NormalMap = "opengl",
    truth: Truth | None = None,
    extra_files: Mapping[str, bytes] | None = None,
) -> tuple[Finding, ...]:
    """Write the result folder of docs/reference/files.md; it appears complete or not at all.

    Parameters
    ----------
    folder : where it is to appear; its parents are made
    overwrite : replace an older result folder there if it holds nothing but what its result.json
        lists; other folders and files are never replaced
    mesh : format of the mesh file, such as "glb"; "none" for no mesh file
    normal_map : the axes of normals.png
    truth : of a synthetic capture, for the errors in report.html; left out where it has another
        size than the result
    extra_files : more files for the folder: name -> content

    Returns
    -------
    a warning for each older folder that stays under a hidden name because it could not be deleted

    Raises
    ------
    InputError
        no Result, an option that does not exist, arrays of different sizes, nothing finite to
        write, a field that `load_result` could not read again, extra files with names of the
        result's own or in other folders
    OutputExistsError
        something stands at `folder` and may not be replaced
    MachineError
        disk full, no permission, or another run is writing the same folder

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> import numpy as np, rakelight
    >>> flat, facing = np.ones((4, 4)), np.tile([0.0, 0.0, -1.0], (4, 4, 1))
    >>> lights = rakelight.Lights(np.array([[[0.0, 0.0, -1.0]]]), np.zeros((1, 1)))
    >>> result = Result(flat, facing, np.ones((4, 4, 3)), flat, lights,
    ...                 rakelight.Camera(4, 4, 100.0, 100.0, 1.5, 1.5), flat, "none")
    >>> with TemporaryDirectory() as scratch:
    ...     findings = rakelight.save_result(result, f"{scratch}/out")
    ...     rakelight.load_result(f"{scratch}/out").depth.shape
    (4, 4)
    """
    check_is(result, Result, "result", "give what rakelight.refine returned")
    if truth is not None:
        check_is(truth, Truth, "truth", "give what rakelight.load_truth returned")
        for name in ("depth", "normals", "albedo"):
            require_numbers(f"truth.{name}", getattr(truth, name))
    if truth is not None and truth.depth.shape != result.depth.shape:
        truth = None
    more = {name: partial(_as_is, data) for name, data in _own_files(extra_files).items()}
    return write_result(
        result,
        folder,
        overwrite=overwrite,
        mesh=mesh,
        normal_map=normal_map,
        extra_files={REPORT: partial(report_html, truth=truth), **more},
    )


def _own_files(extra_files: Mapping[str, bytes] | None) -> Mapping[str, bytes]:
    """The extra files; InputError where one could stand elsewhere, or is not of bytes."""
    extra_files = {} if extra_files is None else extra_files
    check_is(extra_files, Mapping, "extra_files", "give a dict, name -> content")
    for name, data in extra_files.items():
        source = f"extra_files[{name!r}]"
        plain = isinstance(name, str) and name.isprintable() and Path(name).name == name
        plain = plain and "\\" not in name
        if not plain or name in ("", "..", REPORT):
            raise InputError(
                "no name of a file in the result folder",
                source=source,
                needed="a name without folders, such as notes.txt",
            )
        check_is(data, bytes, source, "give the file's content: text.encode()")
    return extra_files


def _as_is(data: bytes, _: Result) -> bytes:
    """The content of a file that does not depend on the result."""
    return data

"""Result folders: written whole or not at all, and read back.

What every file holds is in docs/reference/files.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import TypeAlias

import numpy as np

from rakelight.errors import InputError
from rakelight.export.albedo import albedo_png
from rakelight.export.checked import checked_maps
from rakelight.export.confidence import confidence_png
from rakelight.export.depth import choose_values_per_metre, depth_png, float32_tiff
from rakelight.export.lights import lights_json
from rakelight.export.mesh import Surface
from rakelight.export.mesh_formats import (
    DEFAULT_MESH,
    MESH_CHOICES,
    MESH_FORMATS,
    NO_MESH,
    mesh_file,
)
from rakelight.export.normals import normals_png
from rakelight.export.preview import preview_png
from rakelight.export.reading import load_result, read_summary
from rakelight.export.summary import (
    MARKER,
    Conventions,
    Summary,
    parse_summary,
    stored_fields,
    summarise,
    summary_json,
    told,
)
from rakelight.files import as_path, in_threads, write_bytes, write_parts
from rakelight.folders import Manifest, sha256, staged_folder
from rakelight.geometry.finite import SIGMAS, only_finite
from rakelight.model import Finding, Result
from rakelight.pictures.colors import AXES, NormalMap

__all__ = ["RESULT", "Summary", "load_result", "read_summary", "write_result"]


def _listed(data: bytes) -> Mapping[str, None]:
    return dict.fromkeys(parse_summary(data, source=MARKER).files)


RESULT = Manifest("result", MARKER, _listed)
"""By which a result folder is known."""

ExtraFiles: TypeAlias = Mapping[str, Callable[[Result], bytes]]


def write_result(
    result: Result,
    folder: str | PathLike[str],
    *,
    overwrite: bool = False,
    mesh: str = DEFAULT_MESH,
    normal_map: NormalMap = "opengl",
    extra_files: ExtraFiles | None = None,
) -> tuple[Finding, ...]:
    """Write the result folder of docs/reference/files.md, whole or not at all, without its report.

    Parameters
    ----------
    folder : where it is to appear; its parents are made
    overwrite : replace an older result folder there if it holds nothing but what its result.json
        lists; other folders and files are never replaced
    mesh : format of the mesh file, such as "glb"; "none" for no mesh file
    normal_map : the axes of normals.png
    extra_files : more files for the folder, such as the report: name -> function that makes the
        content from the result as it is written

    Returns
    -------
    a warning for each older folder that stays under a hidden name because it could not be deleted

    Raises
    ------
    InputError
        an option that does not exist, arrays of different sizes, nothing finite to write, a field
        that could not be read again
    OutputExistsError
        something stands at `folder` and may not be replaced
    MachineError
        disk full, no permission, or another run is writing the same folder

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from rakelight.model import Camera, Lights
    >>> plane, facing = np.ones((4, 4), np.float32), np.zeros((4, 4, 3), np.float32)
    >>> facing[..., 2] = -1
    >>> result = Result(depth=plane, normals=facing, albedo=-facing, confidence=plane,
    ...                 lights=Lights(np.zeros((1, 1, 3)), np.ones((1, 1))),
    ...                 camera=Camera(4, 4, 100.0, 100.0, 1.5, 1.5), prepared_depth=plane,
    ...                 method="none")
    >>> with TemporaryDirectory() as scratch:
    ...     findings = write_result(result, Path(scratch) / "out")
    ...     load_result(Path(scratch) / "out").method
    'none'
    """
    _check_option("mesh", mesh, MESH_CHOICES)
    _check_option("normal_map", normal_map, tuple(AXES))
    result = checked_maps(only_finite(replace(result, **told(stored_fields(result)))))
    with staged_folder(as_path(folder, "folder"), manifest=RESULT, overwrite=overwrite) as staging:
        _write(result, staging.path, mesh, normal_map, extra_files or {})
    return staging.findings


def _write(
    result: Result,
    staging: Path,
    mesh: str,
    normal_map: NormalMap,
    extra_files: ExtraFiles,
) -> None:
    """Write every file of a finite result into the staging folder; result.json last."""
    surface = Surface.of(result) if mesh != NO_MESH else None
    if surface is not None and not surface.faces:
        surface, result = None, replace(result, findings=(*result.findings, _WITHOUT_MESH))
    values_per_metre = choose_values_per_metre(float(np.nanmax(result.depth)))
    contents: dict[str, Callable[[], bytes | Iterator[bytes]]] = {
        "depth.tiff": lambda: float32_tiff(result.depth),
        "prepared_depth.tiff": lambda: float32_tiff(result.prepared_depth),
        "depth.png": lambda: depth_png(result.depth, values_per_metre),
        "normals.tiff": lambda: float32_tiff(result.normals),
        "normals.png": lambda: normals_png(result.normals, normal_map),
        "albedo.png": lambda: albedo_png(result.albedo),
        "confidence.png": lambda: confidence_png(result.confidence),
        "lights.json": lambda: lights_json(result.lights, result.photograph_names),
        "preview.png": lambda: preview_png(result),
    }
    for name in SIGMAS:
        if (sigma := getattr(result, name)) is not None:
            contents[f"{name}.tiff"] = partial(float32_tiff, sigma)
    if surface is not None:
        contents[mesh_file(mesh)] = partial(MESH_FORMATS[mesh].parts, surface)

    for name, content in extra_files.items():
        if name in contents or name == MARKER:
            raise InputError("a result folder has a file of that name", source=name)
        contents[name] = partial(content, result)

    def write(name: str) -> str:
        data = contents[name]()
        if isinstance(data, bytes):
            write_bytes(staging / name, data)
        else:
            write_parts(staging / name, data)
        return sha256(staging / name)

    # The mesh first: it takes longest, and begun last it would have one core to itself.
    names = sorted(contents, key=lambda name: name != mesh_file(mesh))
    checksums = dict(zip(names, in_threads(write, names), strict=True))
    conventions = Conventions(depth_png_values_per_metre=values_per_metre, normal_map=normal_map)
    summary = summarise(result, conventions, checksums)
    write_bytes(staging / MARKER, summary_json(summary))


_WITHOUT_MESH = Finding(
    "warning", "no-mesh", "no mesh was written: no three neighbouring pixels form a surface"
)


def _check_option(name: str, value: str, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise InputError(
            "no such option", source=name, seen=repr(value), needed=" or ".join(allowed)
        )

"""Result folders: written whole or not at all, and read back.

What every file holds is in docs/conventions.md.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import TypeAlias

import numpy as np

from rakelight.capture.headers import read_header
from rakelight.capture.images import decode_image
from rakelight.errors import InputError
from rakelight.export.albedo import albedo_png
from rakelight.export.confidence import confidence_png
from rakelight.export.depth import choose_values_per_metre, depth_png, float32_tiff
from rakelight.export.finite import only_finite
from rakelight.export.lights import lights_json
from rakelight.export.mesh import mesh_glb, mesh_ply, result_triangles
from rakelight.export.normals import NormalMap, normals_png, normals_tiff
from rakelight.export.pictures import preview_png
from rakelight.export.summary import (
    Conventions,
    MeshFormat,
    Summary,
    parse_summary,
    summarise,
    summary_json,
)
from rakelight.files import MAX_TEXT_BYTES, in_threads, read_bytes, write_bytes
from rakelight.folders import Manifest, put_back, staged_folder
from rakelight.model import Array, Finding, Floats, Result

__all__ = ["RESULT", "LoadedResult", "Summary", "load_result", "save_result"]

MARKER = "result.json"
SIGMAS = ("depth_sigma", "normal_sigma")


def _listed(data: bytes) -> Mapping[str, None]:
    return dict.fromkeys(parse_summary(data, source=MARKER).files)


RESULT = Manifest("result", MARKER, _listed)
"""By which a result folder is known."""

ExtraFiles: TypeAlias = Mapping[str, Callable[[Result], bytes]]


def save_result(
    result: Result,
    folder: str | PathLike[str],
    *,
    overwrite: bool = False,
    mesh: MeshFormat = "ply",
    normal_map: NormalMap = "opengl",
    extra_files: ExtraFiles | None = None,
) -> tuple[Finding, ...]:
    """Write the result folder of docs/conventions.md; it appears complete or not at all.

    Parameters
    ----------
    folder : where it is to appear; its parents are made
    overwrite : replace an older result folder there if it holds nothing but what its result.json
        lists; other folders and files are never replaced
    mesh : format of the mesh file
    normal_map : the axes of normals.png
    extra_files : more files for the folder, such as the report: name -> function that makes the
        content from the result as it is written

    Returns
    -------
    a warning for each older folder that stays under a hidden name because it could not be deleted

    Raises
    ------
    InputError
        an option that does not exist, arrays of different sizes, nothing finite to write
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
    ...     findings = save_result(result, Path(scratch) / "out")
    ...     load_result(Path(scratch) / "out").summary.pixels
    16
    """
    _check_option("mesh", mesh, ("ply", "glb", "none"))
    _check_option("normal_map", normal_map, ("opengl", "directx"))
    result = only_finite(result)
    with staged_folder(Path(folder), manifest=RESULT, overwrite=overwrite) as staging:
        _write(result, staging.path, mesh, normal_map, extra_files or {})
    return staging.findings


def _write(
    result: Result,
    staging: Path,
    mesh: MeshFormat,
    normal_map: NormalMap,
    extra_files: ExtraFiles,
) -> None:
    """Write every file of a finite result into the staging folder; result.json last."""
    surface = result_triangles(result) if mesh != "none" else None
    if surface is not None and not len(surface.faces):
        surface, result = None, replace(result, findings=(*result.findings, _NO_MESH))
    values_per_metre = choose_values_per_metre(float(np.nanmax(result.depth)))
    contents: dict[str, Callable[[], bytes]] = {
        **{name: partial(content, result) for name, content in extra_files.items()},
        "depth.tiff": lambda: float32_tiff(result.depth),
        "prepared_depth.tiff": lambda: float32_tiff(result.prepared_depth),
        "depth.png": lambda: depth_png(result.depth, values_per_metre),
        "normals.tiff": lambda: normals_tiff(result.normals),
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
        to_bytes = {"ply": mesh_ply, "glb": mesh_glb}[mesh]
        contents[f"mesh.{mesh}"] = partial(to_bytes, surface, result.normals, result.albedo)
    in_threads(lambda name: write_bytes(staging / name, contents[name]()), contents)
    conventions = Conventions(depth_png_values_per_metre=values_per_metre, normal_map=normal_map)
    summary = summarise(result, conventions, [*contents, MARKER])
    write_bytes(staging / MARKER, summary_json(summary))


_NO_MESH = Finding(
    "warning", "no-mesh", "no mesh was written: no three neighbouring pixels form a surface"
)


@dataclass(frozen=True)
class LoadedResult:
    """A result folder read back.

    depth : (H, W) float32 metres along the optical axis, NaN outside the object
    normals : (H, W, 3) float32 unit vectors, camera frame, NaN outside
    prepared_depth : (H, W) float32 metres, what the method started from
    confidence : (H, W) float32 in 0..1, None when the folder has none
    depth_sigma, normal_sigma : (H, W) float32 metres and degrees, the expected errors of depth and
        normals, NaN outside; None when the folder has none
    summary : the content of result.json
    """

    depth: Floats
    normals: Floats
    prepared_depth: Floats
    confidence: Floats | None
    depth_sigma: Floats | None
    normal_sigma: Floats | None
    summary: Summary


def load_result(folder: str | PathLike[str]) -> LoadedResult:
    """Read the result folder that `save_result` wrote.

    An older one that a killed run had moved aside is put back first.

    Raises InputError when `folder` is not one or one of its files is damaged, MachineError when
    a file cannot be read.
    """
    folder = put_back(Path(folder))
    if not (folder / MARKER).is_file():
        raise InputError(
            "not a result folder",
            source=str(folder),
            needed=f"a folder with {MARKER}",
            remedy="name the folder that `rakelight refine` wrote",
        )
    summary = parse_summary(
        read_bytes(folder / MARKER, max_bytes=MAX_TEXT_BYTES), source=str(folder / MARKER)
    )
    shape = summary.camera.shape
    confidence: Floats | None = None
    if os.path.lexists(folder / "confidence.png"):
        values = _read_map(folder / "confidence.png", shape, np.dtype(np.uint8))
        confidence = values.astype(np.float32) / summary.conventions.confidence_one
    float32 = np.dtype(np.float32)
    sigmas = {
        name: _read_map(folder / f"{name}.tiff", shape, float32)
        if os.path.lexists(folder / f"{name}.tiff")
        else None
        for name in SIGMAS
    }
    return LoadedResult(
        depth=_read_map(folder / "depth.tiff", shape, float32),
        normals=_read_map(folder / "normals.tiff", (*shape, 3), float32),
        prepared_depth=_read_map(folder / "prepared_depth.tiff", shape, float32),
        confidence=confidence,
        **sigmas,
        summary=summary,
    )


def _read_map(path: Path, shape: tuple[int, ...], dtype: np.dtype[np.generic]) -> Array:
    """The image at `path`, which has to have this shape and type."""
    data = read_bytes(path)
    header = read_header(data, str(path))
    if header.shape != shape or header.dtype != dtype:
        raise InputError(
            "this file does not belong to the result beside it",
            source=str(path),
            seen=f"{header.shape} {header.dtype}",
            needed=f"{shape} {dtype}, as {MARKER} says",
        )
    return decode_image(data, str(path))


def _check_option(name: str, value: str, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise InputError(
            "no such option", source=name, seen=repr(value), needed=" or ".join(allowed)
        )

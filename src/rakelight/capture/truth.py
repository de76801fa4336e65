"""What a synthetic capture really shows, in the folder `truth` inside its folder."""

from __future__ import annotations

import os
from dataclasses import fields
from os import PathLike
from pathlib import Path

import msgspec
import numpy as np

from rakelight.capture.headers import read_header
from rakelight.capture.images import decode_image, encode_tiff
from rakelight.capture.listing import Root
from rakelight.errors import CaptureError, InputError, parsing
from rakelight.files import MAX_TEXT_BYTES, as_path, clear_errors, read_bytes, write_bytes
from rakelight.geometry.finite import require_lights
from rakelight.model import Floats, Lights, Truth

TRUE_MAPS: dict[str, tuple[int, ...]] = {"depth": (), "normals": (3,), "albedo": (3,)}
"""The maps of a truth, and the axes of each beside (H, W)."""


def has_truth(folder: str | PathLike[str]) -> bool:
    """Whether the capture is a synthetic one that holds its truth.

    >>> has_truth("no/such/folder")
    False
    """
    return (as_path(folder, "folder") / "truth" / "depth.tiff").is_file()


def load_truth(folder: str | PathLike[str]) -> Truth:
    """Read the truth of a synthetic capture from the `truth` folder in its folder.

    Its albedo is NaN where there is no albedo.tiff, its lights are None where there is no
    lights.json.

    Raises CaptureError when there is none, or its files are damaged or do not fit each other.
    """
    root = Root(as_path(folder, "folder"))
    with clear_errors(root.shown(), "cannot be read"):
        there, folder_there = (root.path / "truth").is_dir(), root.path.is_dir()
    if not there:
        raise CaptureError(
            "this capture has no truth" if folder_there else "no such folder",
            source=root.shown(),
            needed="a folder truth in it",
            remedy="name a capture that `rakelight synth` wrote",
        )
    depth = _read_truth_map(root, "depth", None)
    shape = (*depth.shape, 3)
    known = os.path.lexists(root.path / "truth" / "albedo.tiff")
    return Truth(
        depth=depth,
        normals=_read_truth_map(root, "normals", shape),
        albedo=_read_truth_map(root, "albedo", shape)
        if known
        else np.full(shape, np.nan, np.float32),
        lights=_read_lights(root),
    )


class _LightsFile(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    """truth/lights.json: the fields of rakelight.model.Lights, nested lists."""

    vector: list[list[list[float]]]
    ambient: list[list[float]]
    position_m: list[list[list[float]]] | None = None
    middle_m: list[float] | None = None
    beam: list[list[list[float]]] | None = None
    ambient_direction: list[float] | None = None


def write_truth(truth: Truth, folder: Path) -> None:
    """Write the maps as float32 TIFF and lights.json into the new folder."""
    folder.mkdir()
    for name in TRUE_MAPS:
        pixels = np.asarray(getattr(truth, name), np.float32)
        write_bytes(folder / f"{name}.tiff", encode_tiff(pixels))
    if truth.lights is not None:
        write_lights(truth.lights, folder)


def write_lights(lights: Lights, folder: Path) -> None:
    """Write lights.json into the folder `truth`."""
    given = {each.name: getattr(lights, each.name) for each in fields(lights)}
    stored = _LightsFile(
        **{name: array.astype(float).tolist() for name, array in given.items() if array is not None}
    )
    data = msgspec.json.format(msgspec.json.encode(stored), indent=1)
    write_bytes(folder / "lights.json", data)


def _read_truth_map(root: Root, name: str, shape: tuple[int, ...] | None) -> Floats:
    source = root.shown(f"truth/{name}.tiff")
    data = read_bytes(root.path / "truth" / f"{name}.tiff", source=source)
    header = read_header(data, source)
    fits = header.channels == 1 if shape is None else header.shape == shape
    if not fits or header.dtype != "float32":
        raise CaptureError(
            "this map does not fit the others",
            source=source,
            seen=f"{header.shape} {header.dtype}",
            needed=f"{shape or '(H, W)'} float32",
            remedy="write the capture again with `rakelight synth`",
        )
    return decode_image(data, source)


def _read_lights(root: Root) -> Lights | None:
    path, source = root.path / "truth" / "lights.json", root.shown("truth/lights.json")
    if not os.path.lexists(path):
        return None
    data = read_bytes(path, source=source, max_bytes=MAX_TEXT_BYTES)
    with parsing(source, "not the lights of a capture", CaptureError):
        stored = msgspec.json.decode(data, type=_LightsFile)
        given = {name: getattr(stored, name) for name in stored.__struct_fields__}
        arrays = {name: np.array(each) for name, each in given.items() if each is not None}
    try:
        lights = Lights(**arrays)
        require_lights(lights, "lights")
    except InputError as error:
        raise CaptureError(
            "the lights do not fit each other",
            source=source,
            seen=f"{error.source}: {error.seen}",
            needed=error.needed,
            remedy="write the capture again with `rakelight synth`",
        ) from error
    return lights

"""result.json: what was done, with what, and how the other files are to be read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import nan
from typing import Annotated, Any, Literal, get_type_hints

import msgspec

from rakelight.errors import InputError, parsing
from rakelight.export.plain import json_bytes
from rakelight.model import Camera, Finding, Result
from rakelight.pictures.colors import NormalMap

SCHEMA = "rakelight-result/1"
# Stages of a result that follow each other; what else `timings_s` has are parts of them.
STAGES = ("read", "undistort", "register", "prepare", "refine")

MARKER = "result.json"
"""By which a result folder is known."""

Side = Annotated[int, msgspec.Meta(ge=1)]
# Pixels.  Of a shorter one a pixel would see a thousand times its distance: no lens does.
FocalLength = Annotated[float, msgspec.Meta(ge=1e-3)]


class Units(msgspec.Struct, frozen=True, kw_only=True):
    """Of the numbers in the result folder."""

    length: str = "metre"
    normals: str = "unit vector"
    albedo: str = "relative, 99th percentile = 1"
    intensity: str = "photograph value (0..1, linear) per albedo"
    timings: str = "second"


class Conventions(msgspec.Struct, frozen=True, kw_only=True):
    """How the files are to be read.

    depth_png_values_per_metre : depth.png holds round(depth * this); 0 = outside the object
    normal_map : the axes of normals.png, whose values are (n + 1)/2 * 255
    normal_map_outside : the colour of normals.png outside the object
    albedo_encoding, albedo_white : of albedo.png; the albedo that 65535 stands for
    confidence_one : the value in confidence.png that stands for 1
    """

    depth_png_values_per_metre: float
    normal_map: NormalMap
    normal_map_outside: tuple[int, int, int] = (128, 128, 255)
    albedo_encoding: Literal["srgb"] = "srgb"
    albedo_white: float = 1.0
    confidence_one: Annotated[int, msgspec.Meta(ge=1, le=255)] = 255
    camera_frame: str = "x right, y down, z forward"
    pixels: str = "(u, v) = (column, row), centres at integers from 0"
    depth: str = "along the optical axis; NaN = outside the object"
    mesh_ply_frame: str = "camera frame"
    mesh_glb_frame: str = "glTF: x right, y up, z to the viewer; linear vertex colours"
    mesh_stl_frame: str = "x right, y up, z to the viewer; millimetres, no colours"


class Intrinsics(msgspec.Struct, frozen=True):
    """Of the camera of every image in the folder, which has no lens distortion: pixels."""

    width: Side
    height: Side
    fx: FocalLength
    fy: FocalLength
    cx: float
    cy: float

    def as_camera(self) -> Camera:
        """The same as a Camera."""
        return Camera(self.width, self.height, self.fx, self.fy, self.cx, self.cy)


class Summary(msgspec.Struct, frozen=True, kw_only=True):
    """The content of result.json; numbers that were not finite are None."""

    schema: str = SCHEMA
    rakelight: str
    method: str
    options: dict[str, Any]
    source: str
    photographs: list[str]
    capture: dict[str, Any] = {}
    camera: Intrinsics
    pixels: int
    iterations: Annotated[int, msgspec.Meta(ge=0)]
    converged: bool
    energy: list[float | None]
    prediction_errors: list[float | None] = []
    timings_s: dict[str, float | None]
    findings: list[Finding]
    units: Units = Units()
    conventions: Conventions
    files: list[str]
    checksums: dict[str, str] = {}


class _Read(msgspec.Struct):
    """What `capture` holds where it is not empty, as far as the report shows it."""

    photographs: int
    photograph_size: tuple[int, int]
    bits: int
    encoding: str
    lighting: str
    depth_maps: int
    depth_size: tuple[int, int]


# Fields of a Result that result.json holds: what each has to be.
_NEEDED = {
    "method": "a str",
    "options": "a dict, name -> value",
    "iterations": "a whole number, 0 or more",
    "energy": "a tuple of numbers",
    "converged": "True or False",
    "timings_s": "a dict, name -> seconds",
    "findings": "a tuple of rakelight.Finding, each a note or a warning",
    "source": "a str",
    "photograph_names": "a tuple of str",
    "capture": "a dict of what was read, or an empty one",
    "prediction_errors": "a tuple of numbers",
    "camera": "a rakelight.Camera: whole sides, focal lengths above 0, finite numbers",
}
_KEYS = {"photograph_names": "photographs"}
"""The keys in result.json of those that have another name there."""


def stored_fields(result: Result) -> dict[str, Any]:
    """What result.json says of a result, by its keys, as it is read back.

    Each field is read by what reads the file, before anything is written.  Raises InputError for
    the first that could not be read.
    """
    hints = get_type_hints(Summary, include_extras=True)
    stored = {}
    for name, needed in _NEEDED.items():
        key = _KEYS.get(name, name)
        try:
            data = json_bytes(getattr(result, name))
            stored[key] = msgspec.json.decode(data, type=hints[key])
            if key == "capture" and stored[key]:
                msgspec.json.decode(data, type=_Read)
        except (msgspec.MsgspecError, ValueError, OverflowError, RecursionError) as error:
            raise InputError(
                f"{MARKER} cannot hold this",
                source=name,
                seen=str(error),
                needed=needed,
            ) from error
    return stored


def summarise(result: Result, conventions: Conventions, checksums: Mapping[str, str]) -> Summary:
    """The summary of a result that is written beside files: by their names, their SHA-256."""
    return Summary(
        rakelight=program_version(),
        pixels=int(result.mask.sum()),
        conventions=conventions,
        files=sorted([*checksums, MARKER]),
        checksums=dict(sorted(checksums.items())),
        **stored_fields(result),
    )


def told(stored: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a Result, but for its camera, that result.json holds by these keys."""
    seconds = stored["timings_s"]
    return {
        "method": stored["method"],
        "options": stored["options"],
        "iterations": stored["iterations"],
        "energy": _numbers(stored["energy"]),
        "converged": stored["converged"],
        "timings_s": dict(zip(seconds, _numbers(seconds.values()), strict=True)),
        "findings": tuple(stored["findings"]),
        "source": stored["source"],
        "photograph_names": tuple(stored["photographs"]),
        "capture": stored["capture"],
        "prediction_errors": _numbers(stored["prediction_errors"]),
    }


def _numbers(values: Iterable[float | None]) -> tuple[float, ...]:
    """null was a number that is not finite."""
    return tuple(nan if value is None else value for value in values)


def summary_json(summary: Summary) -> bytes:
    """The bytes of result.json."""
    return json_bytes(summary)


def parse_summary(data: bytes, *, source: str) -> Summary:
    """The summary in the bytes of a result.json; `source` names the file in messages.

    Raises InputError when it is not one, or of another version of the schema.
    """
    with parsing(source, "not a result.json"):
        schema = msgspec.json.decode(data, type=_Versioned).schema
        if schema != SCHEMA:
            raise InputError(
                "a result.json of another version", source=source, seen=schema, needed=SCHEMA
            )
        return msgspec.json.decode(data, type=Summary)


class _Versioned(msgspec.Struct):
    schema: str


def program_version() -> str:
    """The version of the installed package; a source tree that is not installed has none."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("rakelight")
    except PackageNotFoundError:
        return "unknown"

"""result.json: what was done, with what, and how the other files are to be read."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec

from rakelight.errors import InputError, parsing
from rakelight.export.plain import json_bytes, plain
from rakelight.model import Camera, Finding, Result
from rakelight.pictures.colors import NormalMap

SCHEMA = "rakelight-result/1"
# Stages of a result that follow each other; what else `timings_s` has are parts of them.
STAGES = ("read", "undistort", "register", "prepare", "refine")

MARKER = "result.json"
"""By which a result folder is known."""


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

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    @classmethod
    def of(cls, camera: Camera) -> Intrinsics:
        """Those of a camera without distortion."""
        return cls(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)

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
    iterations: int
    converged: bool
    energy: list[float | None]
    prediction_errors: list[float | None] = []
    timings_s: dict[str, float | None]
    findings: list[Finding]
    units: Units = Units()
    conventions: Conventions
    files: list[str]


def summarise(result: Result, conventions: Conventions, files: list[str]) -> Summary:
    """The summary of a result that is written as `files`."""
    return Summary(
        rakelight=program_version(),
        method=result.method,
        options=plain(result.options),
        source=plain(result.source),
        photographs=plain(result.photograph_names),
        capture=plain(result.capture),
        camera=Intrinsics.of(result.camera),
        pixels=int(result.mask.sum()),
        iterations=int(result.iterations),
        converged=bool(result.converged),
        energy=plain(result.energy),
        prediction_errors=plain(result.prediction_errors),
        timings_s=plain(result.timings_s),
        findings=list(result.findings),
        conventions=conventions,
        files=sorted(files),
    )


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

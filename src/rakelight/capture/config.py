"""capture.toml: what it may say, strictly."""

from __future__ import annotations

import re
import tomllib
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NoReturn, get_args

import msgspec
import numpy as np

from rakelight.capture.lights import Frame, LightsTable
from rakelight.errors import CaptureError, parsing, stated_in
from rakelight.model import (
    Camera,
    Distortion,
    Encoding,
    LensModel,
    Lighting,
    RigidTransform,
    SensorNoise,
)

CONFIG = "capture.toml"
_CAMERA = "width = 640, height = 480, fx = 525.0, fy = 525.0, cx = 319.5, cy = 239.5 (one per line)"
EXAMPLE = f"depth_scale = 1000.0 and, in a table [intrinsics], {_CAMERA}"
_LENS = 'distortion = { model = "brown-conrady", k = [k1, k2, p1, p2, k3] }'
# What may stand in a table whose key is missing.
_EXAMPLES = {
    "intrinsics": _CAMERA,
    "depth_intrinsics": _CAMERA,
    "depth_to_color": "rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], translation = [0.025, 0, 0] "
    "(one per line, metres)",
    "depth_noise": "sigma_m = 0.002 (metres, at at_m), or take the table out",
    "intrinsics.distortion": _LENS,
    "depth_intrinsics.distortion": _LENS,
}
# What msgspec calls the types of values.
_TYPES = {
    "int": "a whole number",
    "float": "a number",
    "float | null": "a number",
    "str": "text in quotes",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
    "object | null": "a table",
}
_HUGE = 1 << 63  # no integer here is that large; much larger ones are no floating-point number


class DistortionTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Of a lens, in [intrinsics] or [depth_intrinsics]: the model and its coefficients."""

    model: LensModel
    k: list[float]


class IntrinsicsTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[intrinsics] and [depth_intrinsics]: pixels, pixel centres at integers from 0."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: DistortionTable | None = None

    def camera(self, table: str = "intrinsics", source: str = CONFIG) -> Camera:
        """The same as a Camera; CaptureError where the distortion of that `table` is none."""
        lens = None
        if self.distortion is not None:
            with stated_in(source, f"key '{table}.distortion.k'"):
                lens = Distortion(self.distortion.model, tuple(self.distortion.k))
        return Camera(self.width, self.height, self.fx, self.fy, self.cx, self.cy, lens)


class TransformTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[depth_to_color]: three rows of the rotation (or its nine values), translation in metres."""

    rotation: list[float | list[float]]
    translation: list[float]


class NoiseTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[depth_noise]: sigma_m (z / at_m)^growth, metres."""

    sigma_m: float
    at_m: float = 1.0
    growth: float = 2.0

    def noise(self) -> SensorNoise:
        """The same as a SensorNoise."""
        return SensorNoise(self.sigma_m, self.at_m, self.growth)


class CaptureTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The whole of capture.toml; a key with a default is optional."""

    intrinsics: IntrinsicsTable
    depth_scale: float | None = None
    encoding: Encoding | None = None
    lighting: Lighting | None = None
    register: bool = False
    exposures: list[float] = []
    depth_intrinsics: IntrinsicsTable | None = None
    depth_to_color: TransformTable | None = None
    depth_noise: NoiseTable | None = None
    lights: LightsTable | None = None


_TABLES: dict[str, type[msgspec.Struct]] = {
    "": CaptureTable,
    "intrinsics": IntrinsicsTable,
    "depth_intrinsics": IntrinsicsTable,
    "depth_to_color": TransformTable,
    "depth_noise": NoiseTable,
    "intrinsics.distortion": DistortionTable,
    "depth_intrinsics.distortion": DistortionTable,
    "lights": LightsTable,
}
_CHOICES = {
    "encoding": get_args(Encoding),
    "lighting": get_args(Lighting),
    "intrinsics.distortion.model": get_args(LensModel),
    "depth_intrinsics.distortion.model": get_args(LensModel),
    "lights.frame": get_args(Frame),
}


def misnamed_config(folder: Path) -> str | None:
    """The file in a folder that is capture.toml but for its name; None where there is none.

    Windows' editor adds .txt and does not show it.  Raises OSError.
    """
    wrong = (CONFIG, f"{CONFIG}.txt")
    return next((path.name for path in folder.iterdir() if path.name.lower() in wrong), None)


def parse_config(data: bytes, source: str = "capture.toml") -> CaptureTable:
    """The content of a capture.toml.

    Raises CaptureError naming the key when one is unknown, twice there, missing or of a wrong
    type; the values themselves are checked by rakelight.capture.validate.

    >>> parse_config(b"[intrinsics]\\nfocal = 1").intrinsics
    Traceback (most recent call last):
    rakelight.errors.CaptureError: capture.toml: unknown key 'intrinsics.focal'. Fix: ...
    """
    try:
        text = data.decode("utf-8-sig")  # Windows editors put a mark first
    except UnicodeDecodeError as error:
        raise CaptureError(
            "not UTF-8 text", source=source, seen=f"byte {error.start}", remedy="save it as UTF-8"
        ) from error
    with parsing(source, "not valid TOML", CaptureError):
        try:
            # A CR alone ended lines on old Macs; TOML knows no such end.
            content = tomllib.loads(text.replace("\r\n", "\n").replace("\r", "\n"))
        except tomllib.TOMLDecodeError as error:
            raise _syntax_error(text, str(error), source) from error
    for table in _TABLES:
        keys = _at(content, table)
        if isinstance(keys, dict):
            _refuse_unknown(keys, table, source)
            _refuse_huge(keys, table, source)
    with parsing(source, "a wrong value", CaptureError):
        try:
            return msgspec.convert(content, CaptureTable)
        except msgspec.ValidationError as error:
            _refuse_value(content, str(error), source, error)


def format_config(
    camera: Camera,
    encoding: Encoding,
    lighting: Lighting,
    depth_scale: float | None = None,
    depth_camera: Camera | None = None,
    depth_to_color: RigidTransform | None = None,
    depth_noise: SensorNoise | None = None,
    register: bool = False,
    exposures: tuple[float, ...] = (),
) -> str:
    """The text of a capture.toml; every number is read back as it was, exposures to six digits.

    >>> print(format_config(Camera(4, 3, 5.0, 5.0, 1.5, 1.0), "linear", "ambient"), end="")
    encoding = "linear"
    lighting = "ambient"
    <BLANKLINE>
    [intrinsics]
    width = 4
    height = 3
    fx = 5.0
    fy = 5.0
    cx = 1.5
    cy = 1.0
    """
    lines = [] if depth_scale is None else [f"depth_scale = {float(depth_scale)!r}"]
    lines += [f'encoding = "{encoding}"', f'lighting = "{lighting}"']
    lines += ["register = true"] if register else []
    if exposures:
        lines += [f"exposures = [{', '.join(f'{each:.6g}' for each in exposures)}]"]
    lines += _intrinsics_lines("intrinsics", camera)
    if depth_camera is not None:
        lines += _intrinsics_lines("depth_intrinsics", depth_camera)
        if depth_to_color is not None:
            rotation = np.asarray(depth_to_color.rotation, float).tolist()
            translation = np.asarray(depth_to_color.translation_m, float).tolist()
            lines += ["", "[depth_to_color]"]
            lines += [f"rotation = {rotation!r}", f"translation = {translation!r}"]
    if depth_noise is not None:
        lines += ["", "[depth_noise]"]
        lines += _number_lines(depth_noise, "sigma_m", "at_m", "growth")
    return "\n".join(lines) + "\n"


def _intrinsics_lines(table: str, camera: Camera) -> list[str]:
    size = (f"width = {int(camera.width)}", f"height = {int(camera.height)}")
    lines = ["", f"[{table}]", *size, *_number_lines(camera, "fx", "fy", "cx", "cy")]
    if (lens := camera.distortion) is not None:
        coefficients = list(lens.coefficients)
        lines.append(f'distortion = {{ model = "{lens.model}", k = {coefficients!r} }}')
    return lines


def _number_lines(value: Camera | SensorNoise, *keys: str) -> list[str]:
    return [f"{key} = {float(getattr(value, key))!r}" for key in keys]


def _syntax_error(text: str, message: str, source: str) -> CaptureError:
    """A TOML error, with the key that is given twice when it is that."""
    found = re.search(r"line (\d+)", message)
    lines = text.splitlines() or [""]
    number = min(int(found[1]), len(lines)) if found else len(lines)
    line = lines[number - 1].strip()
    twice = re.search(r"overwrite|declare|duplicate", message, re.IGNORECASE)
    if twice:
        key = line.split("=")[0].strip()
        return CaptureError(
            f"key {key!r} is there twice",
            source=source,
            seen=f"line {number}",
            remedy="keep one of them",
        )
    return CaptureError(
        "not valid TOML",
        source=source,
        seen=f"line {number}: {line[:60]!r}",
        needed="key = value",
        remedy=_syntax_remedy(line),
    )


def _syntax_remedy(line: str) -> str:
    """What to do about a line that is no TOML.

    >>> _syntax_remedy("cx = 319,5"), _syntax_remedy("scale: 1000")
    ('write cx = 319.5', 'write the line as key = value, texts in quotes')
    """
    comma = re.fullmatch(r"(\w{1,40}\s*=\s*[-+]?\d{1,20}),(\d{1,20})\s*(#.*)?", line)
    if comma:
        return f"write {comma[1]}.{comma[2]}"
    if re.search("[“”„‘’«»]", line):
        return 'write straight quotes: "srgb"'
    if re.search(r"=\s*\".*\\", line):
        return "write / in paths, or put the text into 'single quotes'"
    return "write the line as key = value, texts in quotes"


def _refuse_unknown(keys: dict[str, Any], table: str, source: str) -> None:
    allowed = _keys_of(table)
    for key in keys:
        if key in allowed:
            continue
        near = get_close_matches(key.lower(), allowed, n=1)
        home = next((name for name in _TABLES if key in _keys_of(name)), None)
        if key in _TABLES:
            remedy = f"write a table of that name: [{key}]"
        elif home is not None:  # written rightly, in the wrong place
            remedy = f"it belongs in [{home}]" if home else "it belongs above the first [table]"
        elif near:
            remedy = f"did you mean {near[0]!r}?"
        else:
            remedy = f"the keys here are {', '.join(allowed)}"
        raise CaptureError(f"unknown key {_dotted(table, key)!r}", source=source, remedy=remedy)


def _refuse_huge(keys: dict[str, Any], table: str, source: str) -> None:
    for key, value in keys.items():
        if isinstance(value, int) and abs(value) >= _HUGE:
            raise CaptureError(
                f"key {_dotted(table, key)!r} has a wrong value",
                source=source,
                seen=f"a number of {value.bit_length()} bits",
                remedy="write the number that the camera or the calibration says",
            )


def _refuse_value(content: dict[str, Any], message: str, source: str, cause: Exception) -> NoReturn:
    """Raise the error for a missing key or a value of a wrong type, naming the key."""
    what, _, where = message.partition(" - at ")
    path = where.strip("`").removeprefix("$").lstrip(".")
    missing = re.search(r"missing required field `(.+)`", what)
    if missing:
        raise CaptureError(
            f"key {_dotted(path, missing[1])!r} is missing",
            source=source,
            remedy=f"for example {_EXAMPLES.get(path, EXAMPLE)}",
        ) from cause
    if path in _CHOICES:
        choices = _CHOICES[path]
        near = get_close_matches(str(_at(content, path)).lower(), choices, n=1)
        raise CaptureError(
            f"key {path!r} has an unknown value",
            source=source,
            seen=repr(_at(content, path)),
            needed=" or ".join(map(repr, choices)),
            remedy=f"did you mean {near[0]!r}?" if near else "",
        ) from cause
    types = re.search(r"Expected `(.+)`, got `(.+)`", what)
    seen, needed = (_TYPES.get(types[i], types[i]) for i in (2, 1)) if types else (what, "")
    lens = path.endswith(".distortion")
    raise CaptureError(
        f"key {path!r} has a wrong value",
        source=source,
        seen=seen,
        needed=needed,
        remedy=f"write {_LENS}" if lens else _value_remedy(seen, needed),
    ) from cause


def _value_remedy(seen: str, needed: str) -> str:
    """What to do about a value of a wrong type, by the words for both."""
    if (seen, needed) == (_TYPES["str"], _TYPES["float"]):
        return "write it without quotes"
    return "write it as docs/reference/files.md has it"


def _at(content: dict[str, Any], path: str) -> Any:
    """What stands at a dotted path, an empty table where nothing does."""
    found: Any = content
    for key in filter(None, path.split(".")):
        found = found.get(key, {}) if isinstance(found, dict) else {}
    return found


def _keys_of(table: str) -> tuple[str, ...]:
    return tuple(field.name for field in msgspec.structs.fields(_TABLES[table]))


def _dotted(table: str, key: str) -> str:
    return f"{table}.{key}" if table else key

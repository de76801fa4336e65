"""Lights that are given beside the photographs: checked, read from text files, written back.

A .lp file, as domes and chrome balls give it, has the number of lights in its first line and then
"name x y z" for each: x right, y up, z to the viewer.  Decimal commas occur, names have paths of
other computers and other endings.  A table has one row of one or three numbers per light.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from rakelight.capture.listing import numbered
from rakelight.capture.text_tables import text_of
from rakelight.capture.validate import LARGEST_RATIO, POSSIBLE_M
from rakelight.errors import CaptureError, check_is, parsing, printable
from rakelight.files import read_bytes
from rakelight.model import Array, Finding, Floats, GivenLights

LIGHTS_FILE, POSITIONS_FILE, INTENSITIES_FILE = (
    "lights.lp", "light_positions.txt", "light_intensities.txt",
)  # fmt: skip

Frame = Literal["opencv", "opengl"]
"""Axes of given vectors: x right, y down, z forward; or x right, y up, z to the viewer."""

# Length of a direction, beyond which it is no rounded unit vector but something else.
UNIT_LENGTHS = (0.9, 1.1)
# Distance of lights from the camera over the object's, beyond which positions are no metres; least
# distance of an object, metres.
TOO_FAR, LEAST_Z_M = 50.0, 0.05
TURN_ROUND = (
    "x is right, y down, z forward here, and directions point towards the light: "
    'turn y and z round, or say frame = "opengl" in capture.toml'
)
# Bytes of a text of lights, and lights in it: a dome has some hundred.
MAX_LIGHTS_BYTES, MOST_LIGHTS = 1_000_000, 10_000

# A name in a .lp file that goes on after its ending: numbers that are none of the three.
_IMAGE_AND_NUMBER = r"\.(jpe?g|png|tiff?|dng|nef|cr[23]|arw|heic|exr|bmp)\s+\S+$"

Rows = list[float | list[float]]


class LightsTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[lights]: one of file, directions, positions; texts name a file with one row per light."""

    file: str | None = None
    directions: str | Rows | None = None
    positions: str | Rows | None = None
    intensities: str | Rows | None = None
    fixed: bool = False
    frame: Frame | None = None


def in_frame(vectors: Floats, frame: Frame) -> Floats:
    """(N, 3) vectors of a frame in the camera's, or back: both are the same.

    >>> in_frame(np.array([[0.1, 0.2, 0.9]]), "opengl").tolist()
    [[0.1, -0.2, -0.9]]
    """
    return vectors * np.array([1.0, -1.0, -1.0]) if frame == "opengl" else vectors


def checked_lights(
    lights: GivenLights, count: int, middle_z_m: float, source: str = "lights"
) -> GivenLights:
    """The given lights with arrays of float64, directions of unit length.

    count : of the photographs; middle_z_m : median depth of the object
    Raises CaptureError for numbers, shapes, lengths or places that lights cannot have.

    >>> checked_lights(GivenLights(directions=np.array([[0.0, 0.0, 1.0]])), 1, 0.6)
    Traceback (most recent call last):
    rakelight.errors.CaptureError: lights.directions: all lights are behind the object (seen z from
    1 to 1, needed z below 0, towards the camera). Fix: ...
    """
    check_is(lights, GivenLights, source, "rakelight.GivenLights(directions=...)")
    check_is(lights.fixed, bool, f"{source}.fixed", "True or False")
    if (lights.directions is None) == (lights.positions_m is None):
        raise CaptureError(
            "lights have directions or positions",
            source=source,
            seen="neither" if lights.directions is None else "both",
            needed="one of directions and positions_m",
            remedy="give one of the two",
        )
    intensities = lights.intensities
    if intensities is not None:
        intensities = _checked_intensities(intensities, count, f"{source}.intensities")
    if lights.directions is None:
        positions_m = _numbers(lights.positions_m, count, (3,), f"{source}.positions_m")
        farthest_m = float(np.abs(positions_m).max())
        if farthest_m > POSSIBLE_M[1]:
            raise CaptureError(
                "positions that no lamp can have",
                source=f"{source}.positions_m",
                seen=f"a coordinate of {farthest_m:.3g} m",
                needed=f"at most {POSSIBLE_M[1]:g} m",
                remedy="give directions instead, if the lights are that far",
            )
        far = too_far(positions_m, max(middle_z_m, LEAST_Z_M))
        remedy = "divide by 1000 if they are millimetres" if far else TURN_ROUND
        _refuse_behind(positions_m[:, 2] - middle_z_m, f"{source}.positions_m", remedy)
        return replace(lights, positions_m=positions_m, intensities=intensities)
    directions = _numbers(lights.directions, count, (3,), f"{source}.directions")
    length = np.linalg.norm(directions, axis=1, keepdims=True)
    if length.min() < UNIT_LENGTHS[0] or length.max() > UNIT_LENGTHS[1]:
        raise CaptureError(
            "directions are unit vectors",
            source=f"{source}.directions",
            seen=f"lengths from {length.min():.3g} to {length.max():.3g}",
            needed="length 1",
            remedy="divide each by its length; for places in metres give positions_m",
        )
    _refuse_behind(directions[:, 2], f"{source}.directions")
    return replace(lights, directions=directions / length, intensities=intensities)


def too_far(positions_m: Floats, object_m: float) -> bool:
    """Whether positions (N, 3) are no metres, of an object at that distance from the camera."""
    return bool(np.median(np.linalg.norm(positions_m, axis=1)) > TOO_FAR * object_m)


def _refuse_behind(forward: Floats, source: str, remedy: str = TURN_ROUND) -> None:
    """Raise CaptureError where no light (N,) is before the object: their z as seen from it."""
    if forward.min() >= 0:
        raise CaptureError(
            "all lights are behind the object",
            source=source,
            seen=f"z from {forward.min():.3g} to {forward.max():.3g}",
            needed="z below 0, towards the camera",
            remedy=remedy,
        )


def _checked_intensities(intensities: Any, count: int, source: str) -> Floats:
    shape = (3,) if getattr(intensities, "ndim", 0) == 2 else ()
    found = _numbers(intensities, count, shape, source)
    if found.min() <= 0 or found.max() > LARGEST_RATIO * found.min():
        raise CaptureError(
            "not intensities of lights",
            source=source,
            seen=f"{found.min():.3g} to {found.max():.3g}",
            needed=f"above 0, within a factor of {LARGEST_RATIO:g}",
            remedy="leave out photographs without light",
        )
    return found


def _numbers(array: Any, count: int, shape: tuple[int, ...], source: str) -> Floats:
    """(count, *shape) float64, finite; raises CaptureError."""
    needed = (count, *shape)
    an_array = isinstance(array, np.ndarray)
    masked = isinstance(array, np.ma.MaskedArray)
    plain = an_array and not masked and array.dtype.kind in "fiu"
    if not plain or array.shape != needed:
        raise CaptureError(
            "these do not fit the photographs",
            source=source,
            seen=f"{'masked ' * masked}{array.shape} {array.dtype}"
            if an_array
            else type(array).__name__,
            needed=_rows(needed)
            if plain
            else f"a numpy.ndarray {needed} of numbers, one row per photograph",
            remedy="give a row for each photograph, in their order",
        )
    if not np.isfinite(array).all():
        raise CaptureError(
            "values that are not finite",
            source=source,
            needed="numbers",
            remedy="leave out the photographs whose lights are not known",
        )
    return np.array(array, np.float64)


def _rows(shape: tuple[int, ...]) -> str:
    """What an array of that shape is, for a message.

    >>> _rows((6, 3)), _rows((6,))
    ('6 rows of 3, one per photograph', '6 numbers, one per photograph')
    """
    what = f"{shape[0]} rows of {shape[1]}" if len(shape) == 2 else f"{shape[0]} numbers"
    return f"{what}, one per photograph"


# ---- what capture.toml says


@contextmanager
def lights_named(table: LightsTable | None, shown: Callable[[str], str]) -> Iterator[None]:
    """Errors by `checked_lights` name the file that states those lights, or the key in [lights]."""
    try:
        yield
    except CaptureError as error:
        key = error.source.rpartition(".")[2].removesuffix("_m")
        named = LightsTable(file=LIGHTS_FILE) if table is None else table
        in_list = named.file is not None and key == "directions"
        value = named.file if in_list else getattr(named, key, None)
        place = f"{shown('capture.toml')}: key 'lights.{key}'"
        error.source = shown(printable(value)) if isinstance(value, str) else place
        raise


def read_lights(
    table: LightsTable | None, folder: Path, shown: Callable[[str], str], names: Sequence[str]
) -> tuple[GivenLights | None, tuple[Finding, ...]]:
    """The lights of photographs called `names`: by [lights], else by lights.lp, or None.

    shown : the name of a file of the folder in messages.  Raises CaptureError; vectors are in the
    camera's frame, and not checked yet.  The finding is of a list that counts by its order.
    """
    if table is None:
        if not (folder / LIGHTS_FILE).is_file():
            return None, ()
        table = LightsTable(file=LIGHTS_FILE)
    ways = [key for key in ("file", "directions", "positions") if getattr(table, key) is not None]
    source = shown("capture.toml")
    if len(ways) != 1:
        raise CaptureError(
            "[lights] says where the lights are once",
            source=source,
            seen=" and ".join(ways) or "none of them",
            needed="one of file, directions, positions",
            remedy="keep one of them" if ways else "add one of them, or take the table out",
        )

    def rows(key: str) -> Floats | None:
        value = getattr(table, key)
        if isinstance(value, str):
            data = _file(folder, value, source, f"lights.{key}", shown)
            return parse_table(data, shown(printable(value)))
        return None if value is None else _array(value, f"{source}: lights.{key}")

    intensities = rows("intensities")
    if table.file is not None:
        data = _file(folder, table.file, source, "lights.file", shown)
        listed, vectors = parse_lp(data, shown(printable(table.file)))
        order = matched(listed, names, shown(printable(table.file)))
        directions = unit(in_frame(vectors[order], table.frame or "opengl"), shown(table.file))
        if intensities is not None and len(intensities) == len(listed):
            intensities = intensities[order]  # rows of both files belong together
        given_lights = GivenLights(directions, None, intensities, table.fixed)
        return given_lights, order_findings(listed, names, printable(table.file))
    given, frame = rows(ways[0]), table.frame or "opencv"
    if given is None or given.ndim != 2 or given.shape[1] != 3:
        raise CaptureError(
            f"key 'lights.{ways[0]}' has a wrong shape",
            source=source,
            needed="rows of x, y, z",
            remedy="write three numbers for each light",
        )
    given = in_frame(given, frame)
    if ways[0] == "positions":
        return GivenLights(None, given, intensities, table.fixed), ()
    return GivenLights(given, None, intensities, table.fixed), ()


def lights_files(table: LightsTable | None) -> tuple[str, ...]:
    """Names of the files of lights that are read.

    >>> lights_files(None), lights_files(LightsTable(positions="at.txt", intensities=[1.0]))
    (('lights.lp',), ('at.txt',))
    """
    if table is None:
        return (LIGHTS_FILE,)
    named = (table.file, table.directions, table.positions, table.intensities)
    return tuple(each for each in named if isinstance(each, str))


def _array(rows: Rows, source: str) -> Floats:
    with parsing(source, "rows of different length", CaptureError):
        return np.array(rows, np.float64)


def _file(folder: Path, name: str, source: str, key: str, shown: Callable[[str], str]) -> bytes:
    """The bytes of a text file in the folder itself; raises CaptureError for one elsewhere."""
    require_inside(name, source, f"key '{key}'")
    return read_bytes(folder / name, source=shown(printable(name)), max_bytes=MAX_LIGHTS_BYTES)


def require_inside(name: str, source: str, what: str) -> None:
    """Raise CaptureError unless `name` is that of a file in the folder itself.

    >>> require_inside("../secret.lp", "capture.toml", "key 'lights.file'")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: capture.toml: key 'lights.file' leaves the folder (seen ...
    """
    if not name or name in (".", "..") or any(c in name for c in "/\\\0:"):
        raise CaptureError(
            f"{what} leaves the folder",
            source=source,
            seen=repr(name),
            needed="a file in it",
            remedy="copy the file into the folder",
        )


def lights_lines(lights: GivenLights) -> tuple[str, dict[str, str]]:
    """What capture.toml says of lights, and the texts of the files beside it, by name.

    >>> toml, files = lights_lines(GivenLights(np.array([[0.0, 0.6, -0.8]])))
    >>> print(files["lights.lp"], end="")
    1
    000.png 0.0 -0.6 0.8
    """
    lines, files = ["", "[lights]", f"fixed = {str(lights.fixed).lower()}"], {}
    if lights.positions_m is not None:
        lines.append(f'positions = "{POSITIONS_FILE}"')
        files[POSITIONS_FILE] = _table(lights.positions_m)
    else:
        lines.append(f'file = "{LIGHTS_FILE}"')
        vectors = in_frame(np.asarray(lights.directions), "opengl")
        rows = (f"{numbered(i)} {row}" for i, row in enumerate(_table(vectors).splitlines()))
        files[LIGHTS_FILE] = "\n".join([str(len(lights)), *rows]) + "\n"
    if lights.intensities is not None:
        lines.append(f'intensities = "{INTENSITIES_FILE}"')
        files[INTENSITIES_FILE] = _table(lights.intensities)
    return "\n".join(lines) + "\n", files


def _table(values: Floats) -> str:
    rows = np.asarray(values, float).reshape(len(values), -1).tolist()
    return "".join(" ".join(map(repr, row)) + "\n" for row in rows)


# ---- text files


def parse_lp(data: bytes, source: str) -> tuple[list[str], Floats]:
    """Names and vectors (N, 3), as they are written, of a .lp file; raises CaptureError.

    >>> parse_lp(b"1\\nC:\\\\dome\\\\a 1.JPG 0,5 0 0,8", "lights.lp")
    (['C:\\\\dome\\\\a 1.JPG'], array([[0.5, 0. , 0.8]]))
    """
    lines = _lines(data, source)
    stated = lines[0].strip() if lines else ""
    if not (stated.isascii() and stated.isdigit() and len(stated) < 9):
        raise CaptureError(
            "not a list of lights",
            source=source,
            seen=f"first line {stated[:40]!r}",
            needed='the number of lights, then lines "name x y z"',
            remedy="write the number of lights into the first line",
        )
    if int(stated) != len(lines) - 1 or len(lines) < 2:
        raise CaptureError(
            "the first line says another number of lights",
            source=source,
            seen=f"{stated}, and {len(lines) - 1} lines of lights",
            needed="as many lines as it says",
            remedy="correct the first line, or look for lines that are lost",
        )
    names, vectors = [], []
    for number, line in enumerate(lines[1:], 2):
        name, *numbers = line.rsplit(None, 3)
        if len(numbers) != 3 or re.search(_IMAGE_AND_NUMBER, name, re.IGNORECASE):
            raise _bad_line(source, number, line, "name x y z")
        names.append(name.strip().strip("\"'"))
        vectors.append([_number(each, source, number, line) for each in numbers])
    return names, np.array(vectors)


def parse_table(data: bytes, source: str) -> Floats:
    """(N,) or (N, 3) numbers of lines with one or three each; raises CaptureError.

    >>> parse_table(b"0.1 0.2 0.9\\n0 0 1\\n", "light_directions.txt").shape
    (2, 3)
    """
    rows = []
    for number, line in enumerate(_lines(data, source), 1):
        # A comma ends a number where another one has a point, or a space follows.
        text = line.replace(",", " ") if "." in line else line.replace(", ", " ")
        rows.append([_number(each, source, number, line) for each in text.split()])
        if len(rows[-1]) not in (1, 3) or len(rows[-1]) != len(rows[0]):
            raise _bad_line(source, number, line, "one number or three, in each line as many")
    if not rows:
        raise CaptureError(
            "no numbers in it",
            source=source,
            needed="a line for each photograph",
            remedy="write one, or remove the file",
        )
    return np.array(rows) if len(rows[0]) == 3 else np.array(rows)[:, 0]


def text_lines(data: bytes) -> list[str]:
    """The lines of a text that are not empty; bytes of no known encoding are kept as surrogates."""
    text = text_of(data)
    if text is None:
        text = data.decode("utf-8-sig", "surrogateescape")
    return [line for line in text.replace("\r\n", "\n").split("\n") if line.strip()]


def _lines(data: bytes, source: str) -> list[str]:
    lines = text_lines(data)
    if len(lines) > MOST_LIGHTS:
        raise CaptureError(
            "too many lights",
            source=source,
            seen=f"{len(lines)} lines",
            needed=f"{MOST_LIGHTS}",
            remedy="keep the lines of these photographs",
        )
    return lines


def _number(text: str, source: str, number: int, line: str) -> float:
    point = text.replace(",", ".") if "." not in text else text
    try:
        value = float(point)
    except ValueError as error:
        raise _bad_line(source, number, line, "numbers") from error
    if not np.isfinite(value):
        raise _bad_line(source, number, line, "finite numbers")
    return value


def _bad_line(source: str, number: int, line: str, needed: str) -> CaptureError:
    return CaptureError(
        "a line is no light",
        source=source,
        seen=f"line {number}: {line[:60]!r}",
        needed=needed,
        remedy="correct the line, or take it out",
    )


def unit(vectors: Floats, source: str) -> Floats:
    """(N, 3) of unit length; raises CaptureError for one without a direction."""
    with np.errstate(over="ignore"):
        length = np.linalg.norm(vectors, axis=1, keepdims=True)
    wrong = ~((length > 1e-9) & np.isfinite(length))[:, 0]
    if wrong.any():
        raise CaptureError(
            "a light without a direction",
            source=source,
            seen=" ".join(f"{each:g}" for each in vectors[wrong][0]),
            remedy="correct its line",
        )
    return np.asarray(vectors / length)


def by_order(listed: Sequence[str], names: Sequence[str]) -> bool:
    """Whether no photograph's name is in a list of as many: its lines then count in their order.

    >>> by_order(["1.jpg", "2.jpg"], ["a.png", "b.png"]), by_order(["1.jpg"], ["1.png"])
    (True, False)
    """
    stems = {_stem(name) for name in listed}
    return len(listed) == len(names) and not any(_stem(name) in stems for name in names)


def order_findings(
    listed: Sequence[str], names: Sequence[str], list_name: str
) -> tuple[Finding, ...]:
    """A warning where the lights of a list belong to the photographs by their order alone."""
    if not by_order(listed, names):
        return ()
    message = f"no name in {list_name} is a photograph's: its lights count in their order"
    remedy = "give the photographs the names that it has, if their order is another"
    return (Finding("warning", "lights-by-order", message, remedy),)


def matched(listed: Sequence[str], names: Sequence[str], source: str) -> Array:
    """(N,) for each photograph its line in a list: by name, else by order where counts agree.

    Of names only the last part counts, without ending, small or capital.

    >>> matched(["C:\\\\x\\\\B.NEF", "a.nef"], ["a.png", "b.png"], "lights.lp").tolist()
    [1, 0]
    """
    if by_order(listed, names):
        return np.arange(len(names))
    stems = [_stem(name) for name in listed]
    wanted = [_stem(name) for name in names]
    missing = [name for name, stem in zip(names, wanted, strict=True) if stem not in stems]
    if missing:
        raise CaptureError(
            "photographs without a light",
            source=source,
            seen=f"{len(listed)} lights, {len(names)} photographs; none for "
            + ", ".join(map(printable, missing[:3])),
            needed="a line for each photograph, by its name",
            remedy="add the lines, or move these photographs away",
        )
    twice = sorted(
        {name for name, stem in zip(names, wanted, strict=True) if stems.count(stem) > 1}
    )
    if twice:
        raise CaptureError(
            "two lights for a photograph",
            source=source,
            seen=printable(twice[0]),
            needed="one",
            remedy="keep one of the two lines",
        )
    return np.array([stems.index(stem) for stem in wanted])


def _stem(name: str) -> str:
    last = name.replace("\\", "/").split("/")[-1].strip().casefold()
    return last.rsplit(".", 1)[0] if "." in last[1:] else last

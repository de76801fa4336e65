"""Texts of other programs to tables: JSON, YAML, XML, and what programs print.

Nothing is evaluated; no anchor or entity of YAML or XML is followed.
"""

from __future__ import annotations

import codecs
import json
import math
import re
from collections.abc import Iterator
from functools import cache
from typing import Any, NoReturn

import numpy as np

from rakelight.errors import CaptureError, parsing
from rakelight.model import Floats

NUMBER = r"[-+]?(?:[0-9]{1,30}\.?[0-9]{0,30}|\.[0-9]{1,30})(?:[eE][-+]?[0-9]{1,3})?"
"""A number, as a regular expression."""

_NUMBER = re.compile(NUMBER)
_NOT_PLAIN = re.compile("[^a-z0-9]")

MAX_TABLE_BYTES = 100_000
"""Of a text that is searched: the parser of YAML takes a second for it."""

Table = dict[str, Any]
"""Names, and what the file has under them."""

_MAX_ENUMERATED_BYTES = 300_000  # of a camera with a hundred sizes, three times as long as they are
# Names of the model of distortion, librealsense's Viewer's spelling among them.
_MODEL = re.compile(r"dist(?:or[ts]ion)?_?model|distor[ts]ion", re.IGNORECASE)
_LONGEST_ROW = 16  # numbers in a line after its name: those of a matrix, 4 x 4


def text_of(data: bytes) -> str | None:
    """The text of a file: UTF-8, or UTF-16 with its mark; None where it is neither.

    PowerShell's > writes UTF-16.

    >>> text_of("fx".encode("utf-16")), text_of(b"fx"), text_of(b"\\xff")
    ('fx', 'fx', None)
    """
    wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        return data.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError:
        return None


def contents(text: str, source: str) -> Iterator[Any]:
    """What a text may hold, by each format that it may be of, the likeliest first.

    Raises CaptureError where it looks like JSON and is none.
    """
    start = text.lstrip()[:1]
    if start == "{":
        with parsing(source, "not valid JSON", CaptureError):
            yield json_of(text, source)
    elif start == "<":
        yield _agisoft(text, source) or _xml(text)
    else:
        yield _yaml(text, source)
        yield from (table(text) for table in (_printed, _enumerated, _pairs))


def json_of(text: str | bytes, source: str) -> Any:
    """What a JSON text holds; raises what its parser does.

    And CaptureError where a name has two values: the parser takes the last.

    >>> json_of('{"fx": 500, "fx": 525}', "camera.json")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: camera.json: key 'fx' is there twice (seen 500 and 525). Fix: ...
    """

    def table(pairs: list[tuple[str, Any]]) -> Table:
        made: Table = {}
        for key, value in pairs:
            if made.setdefault(key, value) != value:
                _refuse_twice(source, key, made[key], value)
        return made

    return json.loads(text, object_pairs_hook=table)


def _refuse_twice(source: str, key: str, first: object, second: object) -> NoReturn:
    plain = all(isinstance(value, str | int | float) for value in (first, second))
    raise CaptureError(
        f"key {key!r} is there twice",
        source=source,
        seen=f"{first} and {second}" if plain else "two tables or lists",
        remedy="keep one of them",
    )


class _TwiceError(Exception):
    """A name of a YAML text has two values; the arguments are name, first and second."""


@cache
def _yaml_loader() -> type[Any]:
    import yaml

    class Loader(yaml.SafeLoader):  # type: ignore[misc, name-defined, unused-ignore]
        """Of plain values; cv::FileStorage's matrices are tables."""

        def compose_node(self, parent: Any, index: Any) -> Any:
            if self.check_event(yaml.AliasEvent):
                raise yaml.YAMLError("an alias")
            return super().compose_node(parent, index)

        def construct_mapping(self, node: Any, deep: bool = False) -> Any:
            values: Table = {}
            for name, value in ((str(key.value), value.value) for key, value in node.value):
                if values.setdefault(name, value) != value:
                    raise _TwiceError(name, values[name], value)
            return super().construct_mapping(node, deep)

    Loader.add_multi_constructor(
        "tag:yaml.org,2002:opencv-",
        lambda loader, _, node: loader.construct_mapping(node, deep=True),
    )
    return Loader


def _yaml(text: str, source: str) -> Any:
    """The first document; None where it is none, as any text may be.

    Raises CaptureError where a name has two values in a file that is YAML by its own name.
    """
    import yaml

    if len(text) > MAX_TABLE_BYTES:
        return None
    # cv::FileStorage writes "%YAML:1.0", which is no directive.
    text = re.sub(r"\A\s*%YAML[: ].*\n", "", text)
    try:
        return next(yaml.load_all(text, _yaml_loader()), None)
    except _TwiceError as twice:
        if source.lower().endswith((".yaml", ".yml")):
            _refuse_twice(source, *twice.args)
        return None
    except Exception:
        return None


def _printed(text: str) -> Table:
    """What librealsense prints of a camera, or of several; empty where the text holds no such.

    >>> _printed("[ 640x480  p[320 240]  f[500 501]  Brown Conrady [0 0 0 0 0] ]")["ppx"]
    '320'
    """
    found = re.finditer(
        rf"(\d{{1,5}})x(\d{{1,5}}) +p\[({NUMBER}) ({NUMBER})\] +f\[({NUMBER}) ({NUMBER})\]"
        r" +([\w ]{1,40}?) *\[([^\]]{1,200})\]",
        text[:MAX_TABLE_BYTES],
    )
    names = ("width", "height", "ppx", "ppy", "fx", "fy", "model")
    tables: Table = {}
    for i, match in enumerate(found):
        *values, coefficients = match.groups()
        before = text[text.rfind("\n", 0, match.start()) + 1 : match.start()]
        key = f"{'depth' if 'depth' in before.lower() else ''} {i}"
        tables[key] = {**dict(zip(names, values, strict=True)), "coeffs": coefficients.split()}
    return next(iter(tables.values())) if list(tables) == [" 0"] else tables


def _enumerated(text: str) -> Table:
    """What `rs-enumerate-devices -c` prints: color, depth, each by its sizes, and depth_to_color.

    >>> _enumerated('Intrinsic of "Color" / 640x480 / {RGB8}\\n  PPX: 320.5\\n')
    {'color': {'640x480 0': {'width': '640', 'height': '480', 'PPX': '320.5', 'Coeffs': []}}}
    """
    found: dict[str, Table] = {}
    starts = r"^ *(?=Intrinsic of|Extrinsic from|Motion Intrinsic)"
    blocks = re.split(starts, text[:_MAX_ENUMERATED_BYTES], flags=re.M)
    for i, block in enumerate(blocks[1:]):
        name = re.match(r"Intrinsic of \"(Color|Depth)\" / (\d{1,5})x(\d{1,5}) ", block)
        if name is not None:
            lines = re.findall(r"^ *(\w{1,20}):(.{1,200})$", block, re.M)
            table: Table = {key: value.strip() for key, value in lines}
            table["Coeffs"] = table.get("Coeffs", "").split()
            if "Distortion" in table:
                table["model"] = table.pop("Distortion")
            size = {"width": name[2], "height": name[3]}
            cameras = found.setdefault(name[1].lower(), {})
            cameras[f"{name[2]}x{name[3]} {i}"] = {**size, **table}
        elif re.match(r"Extrinsic from \"Depth\"\s+To\s+\"Color\"", block):
            numbers = re.findall(rf"(?<![\w.]){NUMBER}(?![\w.])", block)
            if len(numbers) == 12:
                rows = [numbers[at : at + 3] for at in (0, 3, 6)]
                found["depth_to_color"] = {"rotation": rows, "translation": numbers[9:]}
    return found


def _pairs(text: str) -> Table:
    """The names and numbers of lines such as `fx = 500`, or of a row of names over one of numbers.

    Of a name with the numbers of a vector or matrix, a list; of the model of distortion its words.
    Empty where a name has two values.

    >>> _pairs("fx = 500  # pixels"), _pairs("of a D455\\nDistorsion,Inverse Brown Conrady")
    ({'fx': '500'}, {'Distorsion': 'Inverse Brown Conrady'})
    """
    lines = text[:MAX_TABLE_BYTES].splitlines()
    rows = [row for line in lines if (row := re.findall(r"[^\s,;=:]+", line.split("#")[0]))]
    if len(rows) == 2 and len(rows[0]) == len(rows[1]) > 2:
        rows = [list(pair) for pair in zip(*rows, strict=True)]
    pairs: Table = {}
    for name, *words in rows:
        if not 0 < len(words) <= _LONGEST_ROW:
            continue
        numbers = all(_NUMBER.fullmatch(word) for word in words)
        if numbers or _MODEL.fullmatch(name):
            value = words if numbers and len(words) > 1 else " ".join(words)
            if pairs.setdefault(name, value) != value:
                return {}
    return pairs


def _xml(text: str) -> Any:
    """The matrices, numbers and lists of numbers of cv::FileStorage's XML."""
    matrix = re.compile(
        r"<(\w{1,60}) type_id=\"opencv-matrix\">\s*<rows>(\d{1,3})</rows>\s*"
        r"<cols>(\d{1,3})</cols>\s*<dt>\w{1,3}</dt>\s*<data>([^<]*)</data>"
    )
    numbers = {
        name: words[0] if len(words) == 1 else words
        for name, body in re.findall(r"<(\w{1,60})>([-+.0-9eE\s]{1,1000})</", text)
        if (words := body.split()) and all(_NUMBER.fullmatch(word) for word in words)
    }
    matrices = {
        m[1]: {"rows": int(m[2]), "cols": int(m[3]), "data": re.findall(NUMBER, m[4])}
        for m in matrix.finditer(text)
    }
    return numbers | matrices


def _agisoft(text: str, source: str) -> Table:
    """The camera of an XML file of PhotoScan or Metashape; empty where it is no such file.

    The principal point is given from the middle of the image, the first pixel's centre is at
    (0.5, 0.5), and p1 and p2 are exchanged against OpenCV's (Metashape's manual, camera models).
    Raises CaptureError for a model that OpenCV's is not.
    """
    found: Table = {}
    for i, after in enumerate(text.split("<calibration")[1:]):
        block = after.partition("</calibration>")[0]
        stated = dict(re.findall(rf"<(\w{{1,20}})>\s*({NUMBER})\s*</", block))
        stated |= dict(re.findall(r"\b(width|height)=\"(\d{1,6})\"", block))
        if not {"f", "width", "height"} <= stated.keys():
            continue
        numbers = {key: float(value) for key, value in stated.items()}
        others = [key for key in ("b2", "k4", "p3", "p4") if numbers.get(key)]
        if others or re.search(r"fisheye|spherical|cylindrical", block):
            raise CaptureError(
                "this camera model is not read",
                source=source,
                seen=", ".join(others) or "another projection",
                needed="a frame camera with f, cx, cy, b1, k1, k2, k3, p1, p2",
                remedy="switch the others off, and align the photographs again",
            )
        f, width, height = (numbers[key] for key in ("f", "width", "height"))
        lens = {key: numbers.get(key, 0.0) for key in ("k1", "k2", "k3")}
        lens |= {"p1": numbers.get("p2", 0.0), "p2": numbers.get("p1", 0.0)}
        found[f"{i} {re.search('adjusted', block[:100]) is not None}"] = {
            "width": width, "height": height, "fx": f + numbers.get("b1", 0.0), "fy": f,
            "cx": width / 2 + numbers.get("cx", 0.0) - 0.5,
            "cy": height / 2 + numbers.get("cy", 0.0) - 0.5,
            **(lens if any(lens.values()) else {}),
        }  # fmt: skip
    adjusted = {key: table for key, table in found.items() if key.endswith("True")}
    return adjusted or found


# ---- names and numbers in tables


def plain_key(key: object) -> str:
    """A name by its small letters and digits alone."""
    return _NOT_PLAIN.sub("", str(key).lower())


def plain_table(content: Table) -> Table:
    """The table with names of small letters and digits alone."""
    return {plain_key(key): value for key, value in content.items()}


def numbers_alone(text: str) -> list[str]:
    """The numbers that a text is, without comments; none where there is anything else in it.

    >>> numbers_alone("[1, 2.5]  # pixels"), numbers_alone("fx 1")
    (['1', '2.5'], [])
    """
    lines = (line.split("#")[0] for line in text.splitlines())
    words = re.sub(r"[\s,;\[\]()]+", " ", " ".join(lines)).split()
    return words if all(_NUMBER.fullmatch(word) for word in words) else []


def number_of(value: Any) -> float | None:
    """Of a number, or of text that is one: PyYAML takes 1e3 for text."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, bool) or not isinstance(value, (int, str)):
        return None
    return float(value) if _NUMBER.fullmatch(str(value)) else None


def numbers_of(value: Any, source: str = "", name: str = "") -> Floats | None:
    """A list of numbers, of rows, or a matrix with rows, cols and data; None for anything else."""
    shape: Any = None
    if isinstance(value, dict):
        inner = plain_table(value)
        shape, value = (inner.get("rows"), inner.get("cols")), inner.get("data")
    if not isinstance(value, list) or not value:
        return None
    rows = value if isinstance(value[0], list) else [value]
    read = [[number_of(each) for each in row] for row in rows if isinstance(row, list)]
    if len({len(row) for row in read}) != 1 or any(None in row for row in read):
        return None
    numbers = np.array(read, np.float64)
    if shape is None or None in shape:
        return numbers if len(rows) > 1 else numbers[0]
    if numbers.size != shape[0] * shape[1]:
        raise CaptureError(
            f"matrix {name!r} is damaged",
            source=source,
            seen=f"{numbers.size} numbers",
            needed=f"{shape[0]} x {shape[1]}",
            remedy="copy or export the file again",
        )
    return numbers.reshape(shape)

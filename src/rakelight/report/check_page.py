"""The page of a check: one self-contained file that asks for nothing, written with care."""

from __future__ import annotations

import os
import secrets
from base64 import b64encode
from hashlib import sha256
from math import radians, sin
from pathlib import Path, PurePath
from typing import Any

import cv2
import numpy as np
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from rakelight.capture.images import encode_jpeg
from rakelight.checkup.report import CheckReport
from rakelight.errors import OutputExistsError, check_is, printable
from rakelight.export.pictures import object_window
from rakelight.export.summary import program_version
from rakelight.files import clear_errors, write_bytes
from rakelight.model import Array, Capture, Encoding
from rakelight.prepare.linear import srgb, to_linear
from rakelight.report.page import page_text, shown

# Longest side of a photograph's picture, pixels.
THUMBNAIL_PX = 320
# The last line of a page of ours: the SHA-256 of all before it.
SEAL = b"<!-- rakelight check, sha256 "
SEAL_BYTES = len(SEAL) + 64 + len(b" -->\n")


def check_html(report: CheckReport, capture: Capture) -> bytes:
    """The page of a report about that capture, as UTF-8 HTML; its last line seals it.

    >>> from rakelight.model import Camera
    >>> capture = Capture(np.zeros((1, 6, 8, 3), np.uint8), np.ones((1, 6, 8), np.float32),
    ...                   np.ones((6, 8), bool), Camera(8, 6, 10.0, 10.0, 3.5, 2.5))
    >>> b"not usable" in check_html(CheckReport("good", "good", (), (), "multi-light"), capture)
    False
    """
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, finalize=shown,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    style = page_text("page.css") + page_text("check.css")
    digest = b64encode(sha256(style.encode()).digest()).decode()
    page = environment.from_string(page_text("check.html")).render(
        policy=f"default-src 'none'; style-src 'sha256-{digest}'; img-src data:; "
        "base-uri 'none'; form-action 'none'",
        style=Markup(style),
        title=PurePath(printable(report.source)).name or printable(report.source) or "capture",
        version=program_version(),
        report=report,
        warnings=[finding for finding in report.findings if finding.severity == "warning"],
        notes=[finding for finding in report.findings if finding.severity != "warning"],
        photographs=_photographs(report, capture),
        lights=_dots(report),
        coming=[
            {"x": 100 * float(each.direction[0]), "y": 100 * float(each.direction[1]),
             "words": each.words, "gain": each.gain}
            for each in report.next_lights
        ],
        rings=[(tilt, 100 * sin(radians(tilt))) for tilt in (30, 60, 90)],
    )  # fmt: skip
    text = page.encode("utf-8", "backslashreplace")
    return text + SEAL + sha256(text).hexdigest().encode() + b" -->\n"


def _photographs(report: CheckReport, capture: Capture) -> list[dict[str, Any]]:
    rows = []
    for check, facts, photograph in zip(
        report.photographs, report.as_dict()["photographs"], capture.photographs, strict=False
    ):
        picture = thumbnail(photograph[object_window(capture.mask)], capture.encoding)
        data = b64encode(encode_jpeg(picture)).decode("ascii")
        rows.append(
            {
                **facts,
                "marks": check.marks,
                "uri": Markup("data:image/jpeg;base64,{}").format(Markup(data)),
                "height": picture.shape[0],
                "width": picture.shape[1],
            }
        )
    return rows


def thumbnail(photograph: Array, encoding: Encoding) -> Array:
    """(h, w, 3) uint8 sRGB of a photograph (H, W, 3), its longer side at most `THUMBNAIL_PX`.

    >>> thumbnail(np.full((400, 640, 3), 65535, np.uint16), "linear").shape
    (200, 320, 3)
    """
    height, width = photograph.shape[:2]
    factor = min(THUMBNAIL_PX / max(height, width), 1.0)
    size = max(round(width * factor), 1), max(round(height * factor), 1)
    small = cv2.resize(photograph, size, interpolation=cv2.INTER_AREA)
    return np.rint(255 * srgb(to_linear(small, encoding))).astype(np.uint8)


def _dots(report: CheckReport) -> list[dict[str, Any]]:
    """The lights on the plot, whose rim has the radius 100."""
    return [
        {
            "name": each.name,
            "x": 100 * float(each.light[0]),
            "y": 100 * float(each.light[1]),
            "tilt": round(float(np.degrees(np.arccos(np.clip(-each.light[2], -1, 1))))),
            "marked": bool(each.marks),
            "behind": float(each.light[2]) > 0,
        }
        for each in report.photographs
        if each.light is not None
    ]


def require_free_page(file: Path, *, overwrite: bool = False) -> None:
    """Raise OutputExistsError where something stands at `file` that may not be replaced.

    Replaced is, with `overwrite`, a page of a check that was not changed since; nothing else.
    """
    source = str(file)
    with clear_errors(source, "cannot be written"):
        if not (file.exists() or file.is_symlink()):
            return
        if not overwrite:
            remedy = "choose another name, or --overwrite"
            raise OutputExistsError("the file exists", source=source, remedy=remedy)
        if file.is_symlink() or not file.is_file() or not _is_ours(file):
            raise OutputExistsError(
                "what was not written by rakelight, or was changed since, is not overwritten",
                source=source,
                needed="the page of an earlier check",
                remedy="move your file away, or choose another name",
            )


def _is_ours(file: Path) -> bool:
    content = file.read_bytes()
    text, seal = content[:-SEAL_BYTES], content[-SEAL_BYTES:]
    return seal == SEAL + sha256(text).hexdigest().encode() + b" -->\n"


def write_page(file: Path, page: bytes, *, overwrite: bool = False) -> None:
    """Write a page whole or not at all; see `require_free_page` for what may be replaced.

    Raises MachineError where the disk is full or may not be written to.

    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as scratch:
    ...     write_page(Path(scratch) / "check.html", b"<p>good</p>")
    ...     (Path(scratch) / "check.html").read_bytes()
    b'<p>good</p>'
    """
    check_is(page, bytes, "page", "give what check_html returned")
    require_free_page(file, overwrite=overwrite)
    partial = file.with_name(f".{file.name}.rakelight-{secrets.token_hex(4)}.partial")
    try:
        write_bytes(partial, page)
        with clear_errors(str(file), "cannot be written"):
            with partial.open("rb+") as written:
                os.fsync(written.fileno())
            require_free_page(file, overwrite=overwrite)
            partial.replace(file)
    finally:
        partial.unlink(missing_ok=True)

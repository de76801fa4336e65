"""The page of a check: one self-contained file that asks for nothing, written with care."""

from __future__ import annotations

from math import radians, sin
from pathlib import PurePath
from typing import Any

import cv2
import numpy as np

from rakelight.checkup.report import CheckReport
from rakelight.errors import printable, rounded
from rakelight.model import Array, Capture, Encoding
from rakelight.pictures.shown import object_window
from rakelight.prepare.linear import srgb, to_linear
from rakelight.report.pictures import jpeg_address
from rakelight.report.sealed import require_free_page, sealed, write_page
from rakelight.report.template import page_text, rendered

__all__ = ["check_html", "require_free_page", "thumbnail", "write_page"]

# Longest side of a photograph's picture, pixels.
THUMBNAIL_PX = 320


def check_html(report: CheckReport, capture: Capture) -> bytes:
    """The page of a report about that capture, as UTF-8 HTML; its last line seals it.

    >>> from rakelight.model import Camera
    >>> capture = Capture(np.zeros((1, 6, 8, 3), np.uint8), np.ones((1, 6, 8), np.float32),
    ...                   np.ones((6, 8), bool), Camera(8, 6, 10.0, 10.0, 3.5, 2.5))
    >>> b"not usable" in check_html(CheckReport("good", "good", (), (), "multi-light"), capture)
    False
    """
    page = rendered(
        page_text("check.html"),
        style=page_text("page.css") + page_text("check.css"),
        title=PurePath(printable(report.source)).name or printable(report.source) or "capture",
        report=report,
        rounded=rounded,
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
    return sealed(page, "check")


def _photographs(report: CheckReport, capture: Capture) -> list[dict[str, Any]]:
    rows = []
    for check, facts, photograph in zip(
        report.photographs, report.as_dict()["photographs"], capture.photographs, strict=False
    ):
        picture = thumbnail(photograph[object_window(capture.mask)], capture.encoding)
        rows.append(
            {
                **facts,
                "marks": check.marks,
                "uri": jpeg_address(picture),
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

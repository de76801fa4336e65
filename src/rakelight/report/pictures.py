"""The pictures of a report: for browsers without WebGL, for paper, and for a first look."""

from __future__ import annotations

from base64 import b64encode
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from markupsafe import Markup

from rakelight.capture.images import encode_jpeg
from rakelight.metrics import (
    DEPTH_RANGE_MM,
    NORMAL_RANGE_DEG,
    depth_error_map_mm,
    normal_error_map_deg,
)
from rakelight.model import Array, Floats, Truth
from rakelight.pictures.clay import shaded
from rakelight.pictures.colors import (
    albedo_picture,
    color_errors,
    confidence_picture,
    normals_picture,
)
from rakelight.pictures.montage import BACKGROUND
from rakelight.pictures.shown import object_window, shown_at
from rakelight.report.encoded_maps import Maps

# Depth (H, W) in metres and normals (H, W, 3).
Surface: TypeAlias = tuple[Floats, Floats]

LONGEST_PX = 1000  # side of a picture of the report


@dataclass(frozen=True, slots=True)
class ReportPicture:
    """A picture with its title, what it shows in words, and its address as data."""

    title: str
    caption: str
    width: int
    height: int
    uri: Markup


def result_pictures(maps: Maps) -> list[ReportPicture]:
    """Before, after, albedo, normals and confidence."""
    prepared, mask = np.isfinite(maps.before_m), np.isfinite(maps.after_m)
    return [
        _picture("Before", "The prepared depth as clay, lamp low at the upper left",
                 shaded(maps.before, prepared)),
        _picture("After", "The refined depth as clay, under the same lamp",
                 shaded(maps.after, mask)),
        _picture("Albedo", "The paint: what is left when light and shade are taken away",
                 albedo_picture(maps.albedo, mask)),
        _picture("Normals", "Red: to the right, green: up, blue: to the viewer",
                 normals_picture(maps.after, mask)),
        _picture("Confidence", "Yellow: the photographs settle the slope; blue: they leave it open",
                 confidence_picture(maps.confidence, mask)),
    ]  # fmt: skip


def truth_pictures(before: Surface, after: Surface, truth: Truth) -> list[ReportPicture]:
    """Error maps of the depth and the normals before and after."""
    window = object_window(truth.mask)
    mask = truth.mask[window][..., None]
    pictures = []
    for when, (depth_m, normals) in (("before", before), ("after", after)):
        for title, errors, largest, unit in (
            ("Depth error", depth_error_map_mm(depth_m, truth.depth, truth.mask),
             DEPTH_RANGE_MM, "mm"),
            ("Normal error", normal_error_map_deg(normals, truth.normals, truth.mask),
             NORMAL_RANGE_DEG, "degrees"),
        ):  # fmt: skip
            picture = np.where(mask, color_errors(errors[window], largest), BACKGROUND)
            caption = f"Blue: none, dark red: {largest:g} {unit} or more"
            pictures.append(_picture(f"{title} {when}", caption, picture.astype(np.uint8)))
    return pictures


def _picture(title: str, caption: str, picture: Array) -> ReportPicture:
    factor = -(-max(picture.shape[:2]) // LONGEST_PX)
    picture = np.rint(shown_at(picture, factor)).astype(np.uint8)
    height, width = picture.shape[:2]
    return ReportPicture(title, caption, width, height, jpeg_address(picture))


def jpeg_address(picture: Array) -> Markup:
    """The data: address of a picture (H, W[, 3]) uint8 as JPEG."""
    data = b64encode(encode_jpeg(picture)).decode("ascii")
    return Markup("data:image/jpeg;base64,{}").format(Markup(data))

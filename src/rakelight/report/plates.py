"""The pictures of a report: for browsers without WebGL, for paper, and for a first look."""

from __future__ import annotations

from base64 import b64encode
from dataclasses import dataclass

import numpy as np

from rakelight.capture.images import encode_jpeg
from rakelight.export.pictures import (
    albedo_picture,
    clay_pair,
    confidence_picture,
    normals_picture,
    object_window,
)
from rakelight.geometry.grid import area_mean
from rakelight.metrics import color_errors, depth_error_map_mm, normal_error_map_deg
from rakelight.model import Array, Result, Truth

LONGEST_SIDE = 1000
# As in `rakelight eval`: a fixed range keeps the maps of several results comparable.
DEPTH_RANGE_MM, NORMAL_RANGE_DEG = 5.0, 30.0


@dataclass(frozen=True, slots=True)
class Plate:
    """A picture with its title, what it shows in words, and its address as data."""

    title: str
    caption: str
    width: int
    height: int
    uri: str


def result_plates(result: Result) -> list[Plate]:
    """Before, after, albedo, normals and confidence."""
    before, after = clay_pair(result)
    return [
        _plate("Before", "The prepared depth as clay, lamp low at the upper left", before),
        _plate("After", "The refined depth as clay, under the same lamp", after),
        _plate("Albedo", "The paint: what is left when light and shade are taken away",
               albedo_picture(result)),
        _plate("Normals", "Red: to the right, green: up, blue: to the viewer",
               normals_picture(result)),
        _plate("Confidence", "Yellow: the photographs settle the slope; blue: they leave it open",
               confidence_picture(result)),
    ]  # fmt: skip


def truth_plates(result: Result, truth: Truth) -> list[Plate]:
    """Error maps of the refined depth and its normals."""
    window = object_window(truth.mask)
    depth = depth_error_map_mm(result.depth, truth.depth, truth.mask)[window]
    normals = normal_error_map_deg(result.normals, truth.normals, truth.mask)[window]
    return [
        _plate("Depth error", f"Blue: none, dark red: {DEPTH_RANGE_MM:g} mm or more",
               color_errors(depth, DEPTH_RANGE_MM)),
        _plate("Normal error", f"Blue: none, dark red: {NORMAL_RANGE_DEG:g} degrees or more",
               color_errors(normals, NORMAL_RANGE_DEG)),
    ]  # fmt: skip


def _plate(title: str, caption: str, picture: Array) -> Plate:
    factor = -(-max(picture.shape[:2]) // LONGEST_SIDE)
    if factor > 1:
        height, width = (side // factor * factor for side in picture.shape[:2])
        picture = np.rint(area_mean(picture[:height, :width], factor)).astype(np.uint8)
    uri = "data:image/jpeg;base64," + b64encode(encode_jpeg(picture)).decode("ascii")
    return Plate(title, caption, picture.shape[1], picture.shape[0], uri)

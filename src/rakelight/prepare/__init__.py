"""A capture made ready for a method: one grid, linear photographs, filled and denoised depth.

The steps of the paper's 3.1, each in its own file: robust average of the depth maps, without flying
pixels and registered to the colour camera; inpainting of small holes; bilateral denoising;
upsampling to the output resolution.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from numbers import Integral
from typing import Literal

import numpy as np

from rakelight.errors import CaptureError, InputError
from rakelight.files import in_threads
from rakelight.geometry.camera import focal_px
from rakelight.geometry.grid import Links, area_mean, bounding_window, row_strips, surface_links
from rakelight.model import (
    SATURATED,
    Array,
    Camera,
    Capture,
    Encoding,
    Finding,
    Floats,
    GivenLights,
    Mask,
    selected,
)
from rakelight.prepare.background import beside_the_object
from rakelight.prepare.denoise import bilateral
from rakelight.prepare.holes import hole_findings, thin_finding, unseen, within_reach
from rakelight.prepare.inpaint import inpaint
from rakelight.prepare.linear import srgb, to_linear, usable
from rakelight.prepare.sensor import (
    SensorDepth,
    SensorGrid,
    check_sizes,
    no_depth,
    sensed,
    sensor_shape,
)
from rakelight.prepare.upsample import upsample
from rakelight.scratch import release

Scale = Literal["auto"] | int

# Rows of the small image that are averaged at a time: their linear light takes megabytes, that of a
# whole large photograph hundreds.
STRIP_ROWS = 64


@dataclass(frozen=True)
class Prepared:
    """What a method works on: the object's window of a capture at the output resolution.

    photographs : (N, h, w, 3) uint8 or uint16, encoded as `encoding` says
    mask : (h, w) bool
    depth_m : (h, w) float64 prepared depth, metres; the object's continuation outside the mask
    sigma_m : (h, w) float64 noise of the sensor's depth at each pixel, metres
    measured : (h, w) bool, where the sensor saw the object (elsewhere the depth was filled)
    factor : output pixels per depth pixel, along each side; not always a whole number
    camera : of this window; `rows`, `columns` place it in `full_camera`'s image
    sensor : the measurements themselves at the sensor's resolution, with their noise and place
    lights : of the photographs, where they are known
    exposures : of the photographs, as in `Capture`
    numbers : of these photographs in the capture, from 0
    own_view : whether the depth was measured in the photographs' view; one of another camera was
        carried there, and its jumps may be pixels off
    """

    photographs: Array
    encoding: Encoding
    mask: Mask
    depth_m: Floats
    sigma_m: Floats
    measured: Mask
    factor: float
    camera: Camera
    full_camera: Camera
    rows: slice
    columns: slice
    sensor: SensorDepth
    names: tuple[str, ...] = ()
    source: str = ""
    findings: tuple[Finding, ...] = ()
    lights: GivenLights | None = None
    exposures: tuple[float, ...] = ()
    numbers: tuple[int, ...] = ()
    own_view: bool = True

    def __len__(self) -> int:
        return len(self.photographs)

    def select(self, photographs: Iterable[int]) -> Prepared:
        """The same with only these photographs (indices from 0)."""
        chosen = list(photographs)
        return replace(
            self,
            photographs=self.photographs[chosen],
            names=selected(self.names, chosen),
            lights=None if self.lights is None else self.lights.select(chosen),
            exposures=selected(self.exposures, chosen),
            numbers=selected(self.numbers, chosen),
        )

    def pixels(self, photograph: int) -> tuple[Floats, Mask]:
        """Linear light (P, 3) of one photograph on the mask, and which values are usable."""
        values = self.photographs[photograph].reshape(-1, 3).take(np.flatnonzero(self.mask), axis=0)
        return to_linear(values, self.encoding), usable(values)

    def marked(self, confidence: Floats) -> Floats:
        """Confidence (h, w), halved where only the photographs carry the depth."""
        return np.where(self.measured, confidence, confidence / 2)

    def embed(self, window: Floats, outside: float) -> Floats:
        """An image (h, w[, C]) of the window, masked, in the full image (H, W[, C]), float32."""
        shape = (*self.full_camera.shape, *window.shape[2:])
        full = np.full(shape, outside, dtype=np.float32)
        inside = self.mask.reshape(*self.mask.shape, *[1] * (window.ndim - 2))
        full[self.rows, self.columns] = np.where(inside, window, outside)
        return full


@dataclass(frozen=True, eq=False)
class PreparedView:
    """A capture made ready, whose windows at the output resolution are made when asked for.

    photographs : (N, H, W, 3) at the output resolution; mask : (H, W) the object
    smooth_m : (hs, ws) filled and denoised depth, metres; links : which of its pixels are on one
        surface; average_m, sigma_m : (hs, ws) the measurements and their noise; measured : (hs, ws)
    grid : how the sensor's pixels lie on the photographs'; camera : of the photographs
    own_view : as in `Prepared`
    """

    photographs: Array
    encoding: Encoding
    mask: Mask
    smooth_m: Floats
    links: Links
    average_m: Floats
    sigma_m: Floats
    measured: Mask
    grid: SensorGrid
    camera: Camera
    names: tuple[str, ...]
    source: str
    findings: tuple[Finding, ...]
    lights: GivenLights | None
    exposures: tuple[float, ...]
    own_view: bool

    @property
    def object_window(self) -> tuple[slice, slice]:
        """Rows and columns of the object, a pixel wider where there is one."""
        return bounding_window(self.mask, margin=1)

    @property
    def window_pixels(self) -> int:
        """How many pixels `object_window` has."""
        rows, columns = self.object_window
        return int((rows.stop - rows.start) * (columns.stop - columns.start))

    def window(
        self, rows: slice, columns: slice, photographs: Iterable[int] | None = None
    ) -> Prepared:
        """The window of these rows and columns; of some of the photographs only, if named."""
        part = (rows, columns)
        typical_sigma_m = float(np.median(self.sigma_m[self.measured]))
        everywhere_m = np.where(self.measured, self.sigma_m, typical_sigma_m)
        prepared = Prepared(
            photographs=self.photographs[:, rows, columns],
            encoding=self.encoding,
            mask=self.mask[part],
            depth_m=upsample(self.smooth_m, self.camera.shape, self.links, part),
            sigma_m=self.grid.nearest_upsample(everywhere_m, part),
            measured=self.grid.nearest_upsample(self.measured, part),
            sensor=self.grid.window(self.average_m, self.sigma_m, self.measured, rows, columns),
            factor=self.grid.factor,
            camera=self.camera.cropped(rows, columns),
            full_camera=self.camera,
            rows=rows,
            columns=columns,
            names=self.names,
            source=self.source,
            findings=self.findings,
            lights=self.lights,
            exposures=self.exposures,
            numbers=tuple(range(len(self.photographs))),
            own_view=self.own_view,
        )
        return prepared if photographs is None else prepared.select(photographs)


def prepare(capture: Capture, scale: Scale = "auto") -> Prepared:
    """The window, the photographs and the prepared depth of `capture`.

    scale : output resolution over the depth's, the nearest whole number; "auto" is the colour
        camera's resolution

    Raises InputError for a scale that the colour camera does not reach, CaptureError where the
    object has no depth.
    """
    view = prepared_view(capture, scale)
    return view.window(*view.object_window)


def prepared_view(capture: Capture, scale: Scale = "auto") -> PreparedView:
    """What `prepare` makes of a capture, for windows of it; raises the same errors."""
    check_sizes(capture)
    shrink = _shrink(SensorGrid(sensor_shape(capture), capture.camera.shape), scale)
    return shrunk_view(capture, shrink)


def shrunk_view(capture: Capture, shrink: int) -> PreparedView:
    """`prepared_view` at a resolution `shrink` times lower than the photographs'.

    shrink : a divisor of both sides
    """
    camera = capture.camera.scaled(1 / shrink)
    mask = _shrunk_mask(capture, shrink)
    photographs = capture.photographs if shrink == 1 else shrunk_photographs(capture, shrink)
    grid = SensorGrid(sensor_shape(capture), camera.shape)

    average, sigma = sensed(capture, capture.mask)
    sensor_mask = grid.touched(mask)
    measured = sensor_mask & np.isfinite(average)
    sensor = camera.resized(*grid.sensor[::-1])
    measured &= ~beside_the_object(
        average, sensor_mask, grid.covered(mask), sensor, shrink * grid.factor
    )
    if not measured.any():
        raise no_depth(capture)
    carried = within_reach(measured, sensor_mask)
    seen = mask & grid.nearest_upsample(carried)
    seen &= ~unseen(photographs, seen & ~grid.nearest_upsample(measured), round(grid.factor))
    findings = hole_findings(mask, seen, grid.nearest_upsample(measured)) + thin_finding(seen)

    filled = inpaint(np.where(measured, average, np.nan), carried)
    typical_m, typical_sigma_m = (
        float(np.median(image[use])) for image, use in ((filled, carried), (sigma, measured))
    )
    smooth = bilateral(filled, carried, typical_sigma_m, typical_m * grid.factor / focal_px(camera))
    return PreparedView(
        photographs=photographs,
        encoding=capture.encoding,
        mask=seen,
        smooth_m=smooth,
        links=surface_links(smooth, carried, sensor),
        average_m=average,
        sigma_m=sigma,
        measured=measured,
        grid=grid,
        camera=camera,
        names=capture.names,
        source=capture.source,
        findings=capture.findings + findings,
        lights=capture.lights,
        exposures=capture.exposures,
        own_view=capture.depth_camera is None,
    )


def coarsest_scale(capture: Capture) -> int:
    """The least scale that `prepare` takes: nearest to the depth's own resolution.

    Raises CaptureError where the capture's arrays do not fit each other.

    >>> capture = Capture(photographs=np.zeros((3, 6, 8, 3), np.uint8),
    ...                   depth_m=np.ones((1, 3, 4), np.float32), mask=np.ones((6, 8), bool),
    ...                   camera=Camera(8, 6, 10.0, 10.0, 3.5, 2.5))
    >>> coarsest_scale(capture)
    1
    """
    check_sizes(capture)
    return min(_scales(SensorGrid(sensor_shape(capture), capture.camera.shape)))


def _shrink(colour: SensorGrid, scale: Scale) -> int:
    """Colour pixels along each side of an output pixel."""
    if isinstance(scale, str) and scale == "auto":
        return 1
    scales = _scales(colour)
    possible = ", ".join(map(str, sorted(scales)))
    if not isinstance(scale, Integral) or isinstance(scale, bool):
        raise InputError(
            "no scale",
            source="scale",
            seen=f"{type(scale).__name__} {scale!r}",
            needed=f'a whole number, here one of {possible}, or "auto"',
        )
    if scale not in scales:
        raise InputError(
            "the colour camera does not have that resolution",
            source=f"scale {scale}",
            seen=f"colour {colour.factor:.4g} times the depth's resolution",
            needed=f"one of {possible}",
            remedy="leave the scale away for the colour camera's own resolution",
        )
    return scales[int(scale)]


def _scales(colour: SensorGrid) -> dict[int, int]:
    """Scale, the nearest whole number -> colour pixels along each side of an output pixel.

    Where the colour camera has a whole number of pixels per depth pixel, so has every output.
    """
    whole = colour.factor == round(colour.factor)
    scales: dict[int, int] = {}
    for shrink in range(1, max(round(colour.factor), 1) + 1):
        if any(side % shrink for side in colour.shape) or (whole and colour.factor % shrink):
            continue
        scales.setdefault(max(round(colour.factor / shrink), 1), shrink)
    return scales


def _shrunk_mask(capture: Capture, shrink: int) -> Mask:
    """The output pixels that the object covers whole; at least one, if it covers any pixel."""
    mask = capture.mask if shrink == 1 else area_mean(capture.mask, shrink) == 1
    if capture.mask.any() and not mask.any():
        raise CaptureError(
            "the mask holds no whole pixel of this scale",
            source=capture.source,
            seen=f"{np.count_nonzero(capture.mask)} pixels of the photographs",
            needed=f"a block of {shrink} x {shrink}",
            remedy="check the mask, or leave --scale away",
        )
    return mask


def shrunk_photographs(capture: Capture, shrink: int) -> Array:
    """The photographs averaged over blocks in linear light, as 16-bit values, encoded as they were.

    So black is the same at every scale.  A block with a saturated pixel stays saturated in that
    channel: its mean would be a lie.
    """
    white = np.iinfo(np.uint16).max
    height, width = (side // shrink for side in capture.mask.shape)
    small = np.empty((len(capture.photographs), height, width, 3), dtype=np.uint16)

    def shrink_one(i: int) -> None:
        for rows in row_strips(height, STRIP_ROWS):
            strip = capture.photographs[i, rows.start * shrink : rows.stop * shrink]
            mean = area_mean(to_linear(strip, capture.encoding), shrink)
            clipped = strip >= SATURATED * capture.white
            mean[area_mean(clipped, shrink) > 0] = 1.0
            code = srgb(mean) if capture.encoding == "srgb" else mean
            small[i, rows] = np.round(white * code)
        release(capture.photographs)

    in_threads(shrink_one, range(len(small)))
    return small


__all__ = [
    "Prepared",
    "Scale",
    "SensorDepth",
    "coarsest_scale",
    "prepare",
]

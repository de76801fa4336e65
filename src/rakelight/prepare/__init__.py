"""A capture made ready for a method: one grid, linear photographs, filled and denoised depth.

The steps of the paper's 3.1, each in its own file: robust average of the depth maps, inpainting,
bilateral denoising, upsampling to the output resolution.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rakelight.errors import CaptureError, InputError
from rakelight.geometry.grid import area_mean, bounding_window
from rakelight.model import Array, Camera, Capture, Encoding, Finding, Floats, Mask
from rakelight.prepare.average import noise_sigma, robust_average
from rakelight.prepare.denoise import bilateral
from rakelight.prepare.inpaint import inpaint
from rakelight.prepare.linear import SATURATED, to_linear, usable
from rakelight.prepare.upsample import coarse_mask, upsample

Scale = Literal["auto"] | int


@dataclass(frozen=True)
class Prepared:
    """What a method works on: the object's window of a capture at the output resolution.

    photographs : (N, h, w, 3) uint8 or uint16, encoded as `encoding` says
    mask : (h, w) bool
    depth_m : (h, w) float64 prepared depth, metres; the object's continuation outside the mask
    sigma_m : (h, w) float64 noise of the sensor's depth at each pixel, metres
    measured : (h, w) bool, where the sensor saw the object (elsewhere the depth was filled)
    factor : output pixels per depth pixel, along each side
    camera : of this window; `rows`, `columns` place it in `full_camera`'s image
    """

    photographs: Array
    encoding: Encoding
    mask: Mask
    depth_m: Floats
    sigma_m: Floats
    measured: Mask
    factor: int
    camera: Camera
    full_camera: Camera
    rows: slice
    columns: slice
    names: tuple[str, ...] = ()
    source: str = ""
    findings: tuple[Finding, ...] = ()

    def __len__(self) -> int:
        return len(self.photographs)

    def pixels(self, photograph: int) -> tuple[Floats, Mask]:
        """Linear light (P, 3) of one photograph on the mask, and which values are usable."""
        values = self.photographs[photograph][self.mask]
        return to_linear(values, self.encoding), usable(values)

    def embed(self, window: Floats, outside: float) -> Floats:
        """An image (h, w[, C]) of the window, masked, in the full image (H, W[, C]), float32."""
        shape = (*self.full_camera.shape, *window.shape[2:])
        full = np.full(shape, outside, dtype=np.float32)
        inside = self.mask.reshape(*self.mask.shape, *[1] * (window.ndim - 2))
        full[self.rows, self.columns] = np.where(inside, window, outside)
        return full


def prepare(capture: Capture, scale: Scale = "auto") -> Prepared:
    """The window, the photographs and the prepared depth of `capture`.

    scale : output resolution over the depth's; "auto" is the colour camera's resolution

    Raises InputError for a scale that the colour camera does not reach, CaptureError where the
    object has no depth.
    """
    if capture.depth_camera is not None or capture.depth_to_color is not None:
        raise CaptureError(
            "depth from a camera of its own cannot be registered to the colour camera yet",
            source=capture.source,
            seen="depth_intrinsics or depth_to_color",
            remedy="register the depth to the colour image and drop these tables",
        )
    step = _colour_per_depth_pixel(capture)
    factor = _output_factor(step, scale)
    shrink = step // factor
    camera = capture.camera.scaled(1 / shrink)
    mask = capture.mask if shrink == 1 else area_mean(capture.mask, shrink) == 1

    sensor_mask = coarse_mask(mask, factor)
    average = np.full(sensor_mask.shape, np.nan)
    if sensor_mask.any():
        window = bounding_window(sensor_mask)
        average[window] = robust_average(capture.depth_m[:, *window])
    measured = sensor_mask & np.isfinite(average)
    if not measured.any():
        raise CaptureError("no depth on the object", source=capture.source)
    filled = inpaint(average, sensor_mask)
    sigma = noise_sigma(np.where(sensor_mask, average, np.nan))
    typical_m = float(np.median(filled[sensor_mask]))
    smooth = bilateral(
        filled, sensor_mask, float(np.nanmedian(sigma)), typical_m * factor / camera.fx
    )
    rows, columns = bounding_window(mask, margin=1)
    photographs = capture.photographs
    encoding = capture.encoding
    if shrink > 1:
        photographs, encoding = _shrunk(capture, shrink), "linear"
    return Prepared(
        photographs=photographs[:, rows, columns],
        encoding=encoding,
        mask=mask[rows, columns],
        depth_m=upsample(smooth, factor)[rows, columns],
        sigma_m=_repeat(np.where(np.isfinite(sigma), sigma, np.nanmedian(sigma)), factor)[
            rows, columns
        ],
        measured=_repeat(measured, factor)[rows, columns],
        factor=factor,
        camera=camera.cropped(rows, columns),
        full_camera=camera,
        rows=rows,
        columns=columns,
        names=capture.names,
        source=capture.source,
        findings=capture.findings,
    )


def _colour_per_depth_pixel(capture: Capture) -> int:
    """How many colour pixels lie along each side of a depth pixel; checks the arrays' sizes."""
    height, width = size = capture.camera.shape
    step = width // capture.depth_m.shape[-1] or 1
    for name, seen, needed in (
        ("photographs", capture.photographs.shape[1:], (*size, 3)),
        ("mask", capture.mask.shape, size),
        ("depth_m", capture.depth_m.shape[1:], (height / step, width / step)),
    ):
        if seen != needed:
            raise CaptureError(
                f"{name} and colour camera are of different size",
                source=capture.source,
                seen=str(seen),
                needed=f"{needed}" if name != "depth_m" else f"a whole fraction of {size}",
            )
    return step


def _output_factor(step: int, scale: Scale) -> int:
    divisors = [d for d in range(1, step + 1) if step % d == 0]
    if scale == "auto":
        return step
    if scale not in divisors:
        raise InputError(
            "the colour camera does not have that resolution",
            source=f"scale {scale}",
            seen=f"colour {step} times the depth's resolution",
            needed=f"one of {', '.join(map(str, divisors))}",
            remedy="leave --scale away for the colour camera's own resolution",
        )
    return int(scale)


def _shrunk(capture: Capture, shrink: int) -> Array:
    """The photographs averaged over blocks in linear light, as linear 16-bit values.

    A block with a saturated pixel stays saturated in that channel: its mean would be a lie.
    """
    white = np.iinfo(np.uint16).max
    height, width = (side // shrink for side in capture.mask.shape)
    small = np.empty((len(capture.photographs), height, width, 3), dtype=np.uint16)
    for photograph, out in zip(capture.photographs, small, strict=True):
        mean = area_mean(to_linear(photograph, capture.encoding), shrink)
        clipped = photograph >= SATURATED * capture.white
        mean[area_mean(clipped, shrink) > 0] = 1.0
        out[...] = np.round(mean * white)
    return small


def _repeat(image: Array, factor: int) -> Array:
    return image.repeat(factor, axis=0).repeat(factor, axis=1)


__all__ = ["Prepared", "Scale", "prepare"]

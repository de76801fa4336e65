"""How sharp each photograph is: the width of its sharpest edges, in pixels.

A step that is blurred by a Gaussian of standard deviation b has at its middle a gradient
proportional to 1 / b.  Blurred once more, by u and by v > u, the ratio R of both gradients gives

    b^2 = (v^2 - R^2 u^2) / (R^2 - 1),    R^2 = (v^2 + b^2) / (u^2 + b^2)

whatever the height of the step (Zhuo & Sim, Pattern Recognition 44, 2011).  Light changes the
height of edges, not their width; edges of shadows are soft, so the sharpest ones count.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from rakelight.check.measured import Measured
from rakelight.errors import listed
from rakelight.geometry.grid import bounding_window
from rakelight.model import Array, Capture, Finding, Floats, Mask

# Standard deviations u and v of the two further blurs, pixels: u calms noise, v is well above it.
FINE_PX, COARSE_PX = 1.0, 2.0
# Side, pixels, of the window about the object's middle that is looked at, at the photographs' own
# resolution: enough edges, and quick.
SIDE_PX = 384
# Share of the window's pixels, those with the largest gradients, that count as edges; the quantile
# of their widths that is the photograph's (the sharpest, without the luckiest).
EDGES, SHARPEST = 0.02, 0.25
# Least number of edge pixels; largest width that can be measured.
FEWEST, WIDEST_PX = 30, 8.0
# Gradient over the largest value that is rounding of float32, not an edge.
ROUNDING = 1e-4
# A photograph is blurred whose edges are as many times as wide as the median photograph's, and as
# many pixels wider.
TIMES, WIDER_PX = 1.6, 0.8
# Width of the median photograph's edges up to which photographs are compared: softer ones are those
# of shading, which come and go with the light.
SHARP_PX = 1.6
# Width of the median photograph's edges, the object's outline among them, above which all are out
# of focus.  On 60 random captures (830 to 889, blurred by up to 1.5 pixels) it is 1.6 at most;
# blurred by 3 pixels more, it is larger than this on 58, by 4 on all.  Of 58 others (890 to 949,
# benchmarks/check_limits.py --seeds 890:950 --size 1.7 --geometry) none is said to be out of focus,
# 54 are when blurred by 3 pixels more, all by 4.
OUT_OF_FOCUS_PX = 2.0
# Pixels from the mask's border, inwards and outwards, within which the object's outline is looked
# for: masks may be a dozen pixels too small.
INWARDS_PX, OUTWARDS_PX = 4, 16


def edge_widths(capture: Capture) -> Floats:
    """(N,) standard deviation, pixels, of the blur of each photograph's sharpest edges.

    NaN where the object shows no edges.
    """
    inside = _inside(capture.mask)
    if not inside.any():
        return np.full(len(capture.photographs), np.nan)
    middle = tuple(_part((part.start + part.stop) // 2) for part in bounding_window(inside))
    return _widths(capture, inside, [middle])


def outline_widths(capture: Capture) -> Floats:
    """(N,) the same of the object's outline, which is sharp in focus whatever lies within.

    NaN where it does not stand out, or is not in the picture.
    """
    size = 2 * OUTWARDS_PX + 1
    grown = cv2.dilate(capture.mask.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
    band = grown & ~_inside(capture.mask)
    places = np.argwhere(band)
    if not len(places):
        return np.full(len(capture.photographs), np.nan)
    box = bounding_window(band)
    if max(part.stop - part.start for part in box) <= SIDE_PX:
        return _widths(capture, band, [box])
    # Of a larger object its outermost parts on all four sides.
    ends = [places[each.argmin()] for each in (*places.T, *-places.T)]
    return _widths(capture, band, [(_part(row, 2), _part(column, 2)) for row, column in ends])


def _part(middle: int, parts: int = 1) -> slice:
    """The rows or columns of a window of `SIDE_PX` over that number of parts."""
    half = SIDE_PX // (2 * parts)
    return slice(max(int(middle) - half, 0), int(middle) + half)


def _inside(mask: Mask) -> Mask:
    """The mask (h, w) without a band along its border."""
    size = 2 * INWARDS_PX + 1
    return np.asarray(cv2.erode(mask.astype(np.uint8), np.ones((size, size), np.uint8)) > 0)


def _widths(capture: Capture, where: Mask, windows: Sequence[tuple[slice, ...]]) -> Floats:
    """(N,) width of each photograph's edges at the pixels `where` (h, w) in these windows."""
    widths = []
    for photograph in capture.photographs:
        parts = [_gradients_at(photograph[window], where[window]) for window in windows]
        brightest = max(float(photograph[window].max(initial=0)) for window in windows)
        widths.append(_width(np.concatenate(parts, axis=1), brightest))
    return np.array(widths)


def edge_width(photograph: Array, mask: Mask) -> float:
    """Standard deviation, pixels, of the blur of the sharpest edges inside a mask (h, w).

    photograph : (h, w, 3) as stored

    >>> step = np.zeros((60, 60, 3), np.uint8); step[:, 30:] = 200
    >>> blurred = cv2.GaussianBlur(step, (0, 0), 3)
    >>> everywhere = np.ones((60, 60), bool)
    >>> round(edge_width(step, everywhere)), round(edge_width(blurred, everywhere))
    (1, 3)
    """
    return _width(_gradients_at(photograph, mask), float(photograph.max(initial=0)))


def _gradients_at(photograph: Array, mask: Mask) -> Floats:
    """(2, P) gradients after both blurs at the mask's pixels."""
    grey = cv2.cvtColor(photograph, cv2.COLOR_RGB2GRAY).astype(np.float32)
    blurred = (cv2.GaussianBlur(grey, (0, 0), sigma) for sigma in (FINE_PX, COARSE_PX))
    return np.stack([_gradients(each)[mask] for each in blurred])


def _width(gradients: Floats, brightest: float) -> float:
    """The width of edges of which these (2, P) are the gradients after both blurs.

    brightest : the largest value of the photograph
    """
    fine, coarse = gradients
    count = int(EDGES * fine.size)
    if count < FEWEST:
        return float("nan")
    largest = np.argpartition(fine, -count)[-count:]
    if fine[largest].min() <= ROUNDING * brightest:
        return float("nan")
    square = np.maximum((fine[largest] / np.maximum(coarse[largest], 1e-9)) ** 2, 1 + 1e-6)
    widths = np.sqrt(
        np.clip((COARSE_PX**2 - square * FINE_PX**2) / (square - 1), 0.0, WIDEST_PX**2)
    )
    return float(np.quantile(widths, SHARPEST))


def _gradients(image: Array) -> Floats:
    """(h, w) length of the gradient."""
    return np.asarray(np.hypot(cv2.Sobel(image, -1, 1, 0), cv2.Sobel(image, -1, 0, 1)))


def blurred_ones(widths: Floats) -> Mask:
    """(N,) which photographs are blurred beside the others, by their edges' widths (N,).

    >>> blurred_ones(np.array([1.0, 1.1, 0.9, 4.0])).tolist()
    [False, False, False, True]
    """
    measured = widths[np.isfinite(widths)]
    if measured.size < 3:
        return np.zeros(len(widths), dtype=bool)
    typical = float(np.median(measured))
    if typical > SHARP_PX:
        return np.zeros(len(widths), dtype=bool)
    return np.nan_to_num(widths) > max(TIMES * typical, typical + WIDER_PX)


def sharpness_findings(measured: Measured) -> tuple[Finding, ...]:
    """Warnings about photographs blurred beside the others, and where all are out of focus."""
    widths = measured(edge_widths)
    which = blurred_ones(widths)
    typical = _median(widths)
    findings = []
    if which.any():
        message = (
            f"blurred: {listed(measured.names, which)}, edges up to {widths[which].max():.1f} "
            f"pixels wide where the others' are {typical:.1f}"
        )
        remedy = "take these again with the camera fixed and the focus locked"
        findings.append(Finding("warning", "blurred", message, remedy))
    # Soft shading has no sharp edge inside, but the outline is one.  Where none is seen nothing is
    # said: what fills the picture may be smooth.
    outlines = measured(outline_widths)
    sharpest = _median(np.fmin(widths, outlines))
    if sharpest > OUT_OF_FOCUS_PX and np.isfinite(outlines).any():
        message = f"out of focus: the object's edges are {sharpest:.1f} pixels wide"
        remedy = "focus on the object and lock the focus, or use the photographs at half the size"
        findings.append(Finding("warning", "out-of-focus", message, remedy))
    return tuple(findings)


def _median(widths: Floats) -> float:
    """The median of the widths that are known; 0 where none is."""
    return float(np.nanmedian(widths)) if np.isfinite(widths).any() else 0.0

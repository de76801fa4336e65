"""How sharp each photograph is: the width of its edges in pixels, and beside the others.

A step that is blurred by a Gaussian of standard deviation b has at its middle a gradient
proportional to 1 / b.  Blurred once more, by u and by v > u, the ratio R of both gradients gives

    b^2 = (v^2 - R^2 u^2) / (R^2 - 1),    R^2 = (v^2 + b^2) / (u^2 + b^2)

whatever the height of the step (Zhuo & Sim, Pattern Recognition 44, 2011).  Edges of shading are
soft, so the sharpest ones count.

Which edges those are changes with the light, so widths do not tell a blurred photograph from the
others.  What the others make of it does (others.py): their combination that is the photograph's at
low frequencies has the same edges, of paint, outline and relief.  Between the blurs u and v a step
blurred by b has the energy

    E(b) = 2 sqrt((u^2 + v^2) / 2 + b^2) - sqrt(u^2 + b^2) - sqrt(v^2 + b^2)

up to its squared height.  A photograph has at least as much as the combination, more by its noise
and by what the others do not explain, unless it is blurred.  Highlights move with the light: those
of the others are in the combination and not in the photograph.  So each part of the image counts by
the share of the combination that the photograph shows at low frequencies, where a blur changes
little.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from rakelight.check.evidence import FEWEST as FEWEST_BLOCKS
from rakelight.check.evidence import LIKELY, block_of, log_likelihood_ratio
from rakelight.check.measured import Measured
from rakelight.check.others import TINY, band, combination
from rakelight.errors import listed
from rakelight.geometry.grid import bounding_window
from rakelight.geometry.masks import dilate
from rakelight.model import SATURATED, Array, Capture, Finding, Floats, Mask
from rakelight.prepare.linear import to_linear

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
# Standard deviation, pixels, of the blur between which and `COARSE_PX` photographs are matched: a
# blur that counts changes little there.
MATCHED_PX = 6.0
# Least blur that is told, pixels: sharp edges, 0.8 pixels wide, are then 1.6 times as wide.
LEAST_BLUR_PX = 1.0
# Fewest photographs: three lights that explain a fourth.
FEWEST_PHOTOGRAPHS = 4
# Largest share of the photographs that are saturated at a pixel that is looked at.
SATURATED_THERE = 0.1
# Pixels around saturated ones that are left out: blurs carry the edges of clipping there.
AROUND_SATURATED_PX = 4
# Pixels around the mask that are looked at, for the outline.
OUTLINE_PX = 2
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
    middle = _middle_window(capture.mask)
    if middle is None:
        return np.full(len(capture.photographs), np.nan)
    return _widths(capture, _inside(capture.mask), [middle])


def outline_widths(capture: Capture) -> Floats:
    """(N,) the same of the object's outline, which is sharp in focus whatever lies within.

    NaN where it does not stand out, or is not in the picture.
    """
    border = dilate(capture.mask, OUTWARDS_PX) & ~_inside(capture.mask)
    places = np.argwhere(border)
    if not len(places):
        return np.full(len(capture.photographs), np.nan)
    box = bounding_window(border)
    if max(part.stop - part.start for part in box) <= SIDE_PX:
        return _widths(capture, border, [box])
    # Of a larger object its outermost parts on all four sides.
    ends = [places[each.argmin()] for each in (*places.T, *-places.T)]
    return _widths(capture, border, [(_part(row, 2), _part(column, 2)) for row, column in ends])


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


def added_blur(capture: Capture) -> tuple[Floats, Mask]:
    """(N,) by how many pixels each photograph is blurred beside the others, and (N,) which are.

    NaN where too few photographs, or too little of the object, tell.
    """
    count = len(capture.photographs)
    unknown = np.full(count, np.nan), np.zeros(count, dtype=bool)
    window = _middle_window(capture.mask)
    if window is None or count < FEWEST_PHOTOGRAPHS:
        return unknown
    here = (slice(None), *window)
    saturated = np.asarray((capture.photographs[here] >= SATURATED * capture.white).any(axis=-1))
    where = dilate(capture.mask, OUTLINE_PX)[window] & (saturated.mean(axis=0) <= SATURATED_THERE)
    if np.count_nonzero(where) < FEWEST * FEWEST_BLOCKS:
        return unknown
    fine, coarse = [], []
    for photograph in capture.photographs[here]:
        light = np.asarray(to_linear(photograph, capture.encoding).mean(axis=-1), np.float32)
        fine.append(band(light, FINE_PX, COARSE_PX)[where])
        coarse.append(band(light, COARSE_PX, MATCHED_PX)[where])
    detail = np.stack([fine, coarse])
    products, block = detail[1] @ detail[1].T, block_of(where)
    blur_px, evidence = np.full(count, np.nan), np.full(count, -np.inf)
    for i in range(count):
        good = ~dilate(saturated[i], AROUND_SATURATED_PX)[where]
        others = combination(products, i) @ detail
        found = _blur_beside(detail[:, i, good], others[:, good], block[good])
        if found is not None:
            blur_px[i], evidence[i] = found
    return blur_px, evidence - float(np.log(count)) >= LIKELY  # any of so many may look blurred


def _blur_beside(image: Floats, others: Floats, block: Array) -> tuple[float, float] | None:
    """The blur in pixels by which an image has less fine energy than the others have for it.

    And the evidence, in blocks (P,), that it is `LEAST_BLUR_PX` or more; None where too few tell.

    image, others : (2, P) its detail, and that of the combination of the others: fine, and coarse
    """
    own, expected, shared, coarse = (
        np.asarray(np.bincount(block, each), np.float64)
        for each in (image[0] ** 2, others[0] ** 2, image[1] * others[1], others[1] ** 2)
    )
    expected *= np.clip(shared / np.maximum(coarse, TINY), 0, 1)  # the share that it shows
    seen = (np.bincount(block) >= FEWEST) & (own > 0) & (expected > 0)
    if np.count_nonzero(seen) < FEWEST_BLOCKS:
        return None
    own, expected = own[seen], expected[seen]
    least = np.log(_step_energy(0.0) / _step_energy(LEAST_BLUR_PX))
    evidence = log_likelihood_ratio(np.log(expected / own) - least, expected)
    return _blur_px(float(expected.sum() / own.sum())), evidence


def _middle_window(mask: Mask) -> tuple[slice, ...] | None:
    """The window about the middle of the object; None without an object."""
    inside = _inside(mask)
    if not inside.any():
        return None
    return tuple(_part((part.start + part.stop) // 2) for part in bounding_window(inside))


def _step_energy(blur_px: float) -> float:
    """E(b): that of a step blurred by so many pixels, between both blurs."""
    fine, coarse = FINE_PX**2, COARSE_PX**2
    middle = 2 * np.sqrt((fine + coarse) / 2 + blur_px**2)
    return float(middle - np.sqrt(fine + blur_px**2) - np.sqrt(coarse + blur_px**2))


def _blur_px(ratio: float) -> float:
    """The blur of a step that divides its energy by `ratio`.

    >>> round(_blur_px(_step_energy(0) / _step_energy(1.5)), 1)
    1.5
    """
    blurs = np.linspace(0, WIDEST_PX, 81)
    ratios = [_step_energy(0.0) / _step_energy(blur) for blur in blurs]
    return float(np.interp(ratio, ratios, blurs))


def sharpness_findings(measured: Measured) -> tuple[Finding, ...]:
    """Warnings about photographs blurred beside the others, and where all are out of focus."""
    widths = measured(edge_widths)
    blur_px, which = measured(added_blur)
    findings = []
    if which.any():
        message = (
            f"blurred: {listed(measured.names, which)}, the same edges by up to "
            f"{blur_px[which].max():.1f} pixels softer than in the others"
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

"""How the object's outline in the depth lies on that of its mask.

The mask is drawn on the photographs; the depth map ends, or jumps, where the object does.  Of a
registered depth map the outline lies on the mask's, or all around it a little outside or inside.
Of one that is shifted it lies outside on one side and inside on the other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from rakelight.model import Capture, Floats, Mask
from rakelight.prepare.sensor import SensorGrid, sensed
from rakelight.prepare.surfaces import surfaces

# Least shift, depth pixels, and least excess over the distance of the outlines all around.
LEAST_PX, LEAST_BEYOND_PX = 2.0, 1.5
# Least shift in standard errors, and least fraction of the outlines' distances that it explains.
ERRORS, EXPLAINED = 5.0, 0.55
# Error of an outline, depth pixels, and the length along it over which errors are correlated.
OUTLINE_PX, CORRELATION_PX = 0.5, 10.0
# Least pixels of an outline; pixels by which the depth is continued beyond the image.
FEWEST, AROUND_PX = 40, 40
# Largest fraction of the shifted outline out of the depth map, where it is compared with nothing
# but that continuation: at most 0.10 of true shifts by a tenth of the object, 0.38 and more of fits
# that went astray (draws 3000 to 3059, depth 1 to 16 times as coarse).
OUT_OF_MAP = 0.25


@dataclass(frozen=True, slots=True)
class Displacement:
    """How the object's outline in the depth lies on that of its mask, in depth pixels.

    shift : (2,) right and down; error : its standard error
    beyond : how far it lies outside all around
    sigma, unshifted_sigma : robust standard deviation of the distances, with and without shift
    """

    shift: Floats
    error: float
    beyond: float
    sigma: float
    unshifted_sigma: float

    @property
    def length(self) -> float:
        """Of the shift."""
        return float(np.hypot(*self.shift))

    @property
    def explained(self) -> float:
        """Fraction of the distances between the outlines that the shift explains."""
        return 1 - self.sigma / self.unshifted_sigma

    @property
    def plain(self) -> bool:
        """Whether the shift is one beyond doubt."""
        least = max(LEAST_PX, abs(self.beyond) + LEAST_BEYOND_PX, ERRORS * self.error)
        return self.length >= least and self.explained >= EXPLAINED


def outline_shift(capture: Capture) -> tuple[Displacement | None, float, float]:
    """How the object's outline in the depth lies on the mask's; None where none is to compare.

    And photograph pixels per depth pixel, and the object's width, the root of its area, in depth
    pixels.
    """
    seen, factor = seen_by_sensor(capture)
    size = seen.shape[::-1]
    share = cv2.resize(capture.mask.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return displacement(share >= 0.5, seen), factor, float(np.sqrt(share.sum()))


def seen_by_sensor(capture: Capture) -> tuple[Mask, float]:
    """(hs, ws) where the depth shows the object, holes filled, and photograph pixels per pixel.

    These are the surfaces that lie in the mask for the most part, and the one most seen there.
    """
    from scipy.ndimage import binary_fill_holes

    depth, _ = sensed(replace(capture, depth_m=capture.depth_m[:1]))
    grid = SensorGrid(depth.shape, capture.camera.shape)
    number, count = surfaces(depth, capture.camera.resized(*depth.shape[::-1]))
    measured = number >= 0
    inside = np.bincount(number[measured & grid.touched(capture.mask)], minlength=count)
    own = inside >= 0.5 * np.bincount(number[measured], minlength=count)
    own[inside == inside.max(initial=0)] = True
    return np.asarray(binary_fill_holes(measured & np.append(own, False)[number])), grid.factor


def displacement(mask: Mask, seen: Mask) -> Displacement | None:
    """How the outline of `seen` (h, w) lies on the mask's; None where they cannot be compared.

    Robust least squares over the mask's outline: the signed distances from there to that of
    `seen` are the same all around once the mask is shifted.

    >>> mask = np.zeros((60, 80), dtype=bool)
    >>> mask[20:40, 20:50] = True
    >>> displacement(mask, np.roll(mask, (3, 5), axis=(0, 1))).shift.round(1).tolist()
    [5.0, 3.0]
    """
    from scipy.ndimage import map_coordinates
    from scipy.optimize import least_squares

    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    at = np.concatenate([np.empty((0, 2)), *(line[:, 0] for line in outlines)])
    # Where the image ends is no outline.
    at = at[((at > 1) & (at < np.array(mask.shape[::-1]) - 2)).all(axis=1)]
    if len(at) < FEWEST or not seen.any() or seen.all():
        return None
    inward = _signed_distance(np.pad(seen, AROUND_PX, mode="edge"))

    def distances(shift: Floats) -> Floats:
        where = (at + shift + AROUND_PX).T[::-1]
        return np.asarray(map_coordinates(inward, where, order=1, mode="nearest"))

    def slopes(x: Floats) -> Floats:
        steps = 0.5 * np.eye(2)
        along = [distances(x[:2] + step) - distances(x[:2] - step) for step in steps]
        return np.stack([*along, -np.ones(len(at))], axis=-1)

    def residuals(x: Floats) -> Floats:
        return np.asarray(distances(x[:2]) - x[2])

    # A start at the shift of the centroids as well: narrow parts have local minima.
    whole = np.array([np.mean(np.nonzero(part), axis=1)[::-1] for part in (mask, seen)])
    starts = np.zeros(3), np.append(whole[1] - whole[0], 0.0)
    fits = [least_squares(residuals, start, slopes, loss="soft_l1") for start in starts]
    x = min(fits, key=lambda fit: fit.cost).x
    there = at + x[:2]
    if ((there < 0) | (there > np.array(seen.shape[::-1]) - 1)).any(axis=1).mean() > OUT_OF_MAP:
        return None
    sigma = _robust_sigma(residuals(x))
    inliers = slopes(x)[np.abs(residuals(x)) < 3 * sigma]
    variance = CORRELATION_PX * sigma**2 * np.linalg.pinv(inliers.T @ inliers).diagonal()
    error = float(np.sqrt(variance[:2].max()))
    return Displacement(x[:2], error, float(x[2]), sigma, _robust_sigma(distances(np.zeros(2))))


def _robust_sigma(distances: Floats) -> float:
    """Robust standard deviation, at least the error of an outline."""
    deviation = np.abs(distances - np.median(distances))
    return max(float(np.quantile(deviation, 0.68)), OUTLINE_PX)


def _signed_distance(mask: Mask) -> Floats:
    """(h, w) pixels to the mask's border, positive inside."""
    inside, outside = (
        cv2.distanceTransform(side.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        for side in (mask, ~mask)
    )
    return np.asarray(np.where(mask, inside - 0.5, 0.5 - outside))

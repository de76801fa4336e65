"""How far photographs are shifted against one another, whatever their lights are.

Photographs of a matte object explain one another (others.py).  A small shift d of one of them, I,
changes it by  d . grad I,  of which the others explain little.  So the shifts are those that leave
least unexplained:

    min over d  sum_i || I_i(x + d_i) - best combination of the others ||^2

by Gauss-Newton steps of all photographs at once, from coarse pictures to fine ones, as images of
low rank are aligned (Peng et al. 2012).  A shift of all photographs alike is left open.
"""

from __future__ import annotations

import cv2
import numpy as np

from rakelight.check.others import COMPONENTS, TINY, band, combinations
from rakelight.model import Array, Floats, Mask

# Standard deviations of the two blurs between which photographs are compared, pixels: of shifts of
# half a pixel finer detail says most.
FINE_PX, COARSE_PX = 1.0, 4.0
# Levels of half the resolution each, and the least side, pixels, of a level that is halved: shifts
# up to four times `COARSE_PX` are found.
LEVELS, LEAST_SIDE_PX = 3, 40
# Most steps at a level; the longest step, pixels, for the linear model holds within the finer blur;
# and a step after which a level ends.
STEPS, LONGEST_PX, SHORTEST_PX = 12, FINE_PX, 0.03
# Share of a step that is made: two photographs under like lights explain each other, and would both
# take the other's place.
SHARE = 2 / 3
# Fewest photographs: of two neither is known to have moved.
FEWEST = 3
# Fewest pixels on which photographs are compared, and about the most that a step is found from.
FEWEST_PIXELS, MOST_PIXELS = 500, 40_000
# Share of a photograph's squared gradient that is added to what the others leave of it: in
# directions in which they leave nothing but rounding a photograph does not move.
ROUNDING = 1e-6


def shifts_among(pictures: list[Array], where: Mask) -> Floats | None:
    """(N, 2) shifts, pixels right and down, of N pictures (h, w) against their median position.

    where : (h, w) the pixels that are compared.  Each picture has detail.  None where pixels or
    pictures are too few.
    """
    if len(pictures) < FEWEST:
        return None
    levels = [(pictures, where)]
    while len(levels) < LEVELS and min(levels[-1][1].shape) >= LEAST_SIDE_PX:
        levels.append(halved(*levels[-1]))
    # Half of the others at most: what one that moved leaves in their combination would stay there.
    components = min(COMPONENTS, (len(pictures) - 1) // 2)
    shifts, every = np.zeros((len(pictures), 2)), np.ones((len(pictures), 1), dtype=bool)
    for k in reversed(range(len(levels))):
        pictures, seen = levels[k]
        here = aligned(details(pictures), seen, shifts / 2**k, every, components)
        shifts = 2**k * (here - np.median(here, axis=0))
    return shifts if np.count_nonzero(within(where, shifts)) >= FEWEST_PIXELS else None


def details(pictures: list[Array]) -> list[Array]:
    """The detail of pictures (h, w) by which they are compared."""
    return [band(each, FINE_PX, COARSE_PX) for each in pictures]


def aligned(
    bands: list[Array], where: Mask, shifts: Floats, which: Mask, components: int = COMPONENTS
) -> Floats:
    """Shifts (N, 2) after Gauss-Newton steps of those that `which` names.

    bands : `details` of N pictures
    which : (N, 1) bool; the others keep their shifts
    components : how many principal components of the others explain a picture
    """
    for _ in range(STEPS):
        there = within(where, shifts)
        if np.count_nonzero(there) < FEWEST_PIXELS:
            break
        step = which * steps(moved_back(bands, shifts), there, components)
        shifts = shifts + step
        if np.abs(step).max() < SHORTEST_PX:
            break
    return shifts


def halved(pictures: list[Array], where: Mask) -> tuple[list[Array], Mask]:
    """Pictures and pixels (h, w) at half the resolution."""
    size = where.shape[1] // 2, where.shape[0] // 2
    inside = cv2.resize(where.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    means = [cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in pictures]
    return means, np.asarray(inside > 0)


def within(where: Mask, shifts: Floats) -> Mask:
    """The pixels `where` (h, w) that pictures moved by these shifts (N, 2) all have."""
    border = int(np.ceil(np.abs(shifts).max())) + round(2 * FINE_PX)
    there = np.zeros_like(where)
    there[border:-border, border:-border] = where[border:-border, border:-border]
    return there


def moved_back(pictures: list[Array], shifts: Floats) -> list[Array]:
    """The pictures (h, w), each moved back by its shift (N, 2), pixels right and down."""
    return [
        cv2.warpAffine(
            picture, np.array([[1.0, 0.0, -right], [0.0, 1.0, -down]]), picture.shape[::-1],
            flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE,
        )
        for picture, (right, down) in zip(pictures, shifts, strict=True)
    ]  # fmt: skip


def steps(pictures: list[Array], there: Mask, components: int) -> Floats:
    """(N, 2) Gauss-Newton steps of the shifts of N pictures (h, w), from the pixels `there`.

    All that is needed of the pictures I_i, each over its own root mean square, and of their
    gradients are inner products: of what the others leave of I_i and of its gradient as well.
    """
    chosen = np.flatnonzero(there)
    chosen = chosen[:: -(-len(chosen) // MOST_PIXELS)]
    images = np.stack([each.ravel()[chosen] for each in pictures])
    size = np.sqrt((images**2).mean(axis=1, keepdims=True)) + TINY
    gradients = np.stack([
        [cv2.Sobel(each, cv2.CV_32F, 1 - axis, axis, scale=1 / 8).ravel()[chosen]
         for each in pictures]
        for axis in (0, 1)
    ])  # fmt: skip
    images, gradients = images / size, gradients / size
    products = (images @ images.T).astype(np.float64)
    along = (gradients @ images.T).astype(np.float64)  # [axis, i, j] of gradient i and image j
    own = np.einsum("aip,bip->iab", gradients, gradients).astype(np.float64)
    found = np.zeros((len(pictures), 2))
    for i in range(len(pictures)):
        wanted = np.column_stack([products[:, i], along[0, i], along[1, i]])
        explained = combinations(products, wanted, i, components).T @ wanted
        right = along[:, i, i] - explained[1:, 0]
        matrix = own[i] - explained[1:, 1:]
        matrix += ROUNDING * np.trace(own[i]) * np.eye(2)
        found[i] = -np.linalg.solve(matrix, right)
    found *= SHARE
    length = np.hypot(*found.T)[:, None]
    return np.asarray(found * np.minimum(1.0, LONGEST_PX / np.maximum(length, TINY)))

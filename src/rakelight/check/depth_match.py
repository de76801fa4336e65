"""Whether the depth shows what the photographs show, and whether it does so a little beside them.

As in `depth_orientation`, the principal components of the photographs' relative shading explain the
depth's slopes by a linear combination.

Slopes that go with the shading are about as large as the shading: its logarithm changes by the
tangent of the angle between light and view times a slope.  A sensor's errors add slopes of their
own, and take away none.  So depth belongs to other photographs where the slopes that go with the
shading are far smaller than the shading.  Near lights shade even a flat page, by a smooth field,
so a polynomial of second degree is taken from the shading first; and both are blurred to the
sensor's pixels.  What chance explains of slopes is none of it: each block of pixels is predicted
from the others.

Shifted, other slopes lie on the pixels, so residuals are compared in units of what there is to
explain.  The sums that a fit needs are correlations of two images, which Fourier transforms give
for all shifts at once.  Squares of the components explain shadows, too: without them the lit sides
of one bar are taken for those of the next.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.check.depth_orientation import (
    COVERED,
    EXPLAINED,
    depth_seen,
    fit_of,
    slopes,
    turned,
    unexplained,
)
from rakelight.check.evidence import LIKELY, block_of
from rakelight.check.measured import Measured
from rakelight.check.shading import RelativeShading, relative_shading
from rakelight.geometry.blur import blurred
from rakelight.model import Capture, Finding, Floats, Mask

# Largest mean square of the slopes that go with the shading over the shading's own, for depth that
# belongs to other photographs.  Of some 180 random captures (of 0 to 99 and 500 to 699) with enough
# shading the least is 0.20; of planes in the place of their depth it is mostly below 0.01.  Of 60
# others (benchmarks/checks.py, 4000 to 4059) one has 0.12: its depth errors hide all relief.
UNRELATED = 0.15
# Standard errors that are added to what blocks of pixels say of it: with none 3 of these captures
# would be below, with one 2.
ERRORS = 2.0
# Least mean square of the shading, logarithmic: 10 %.  Flat pages with highlights under lamps as
# near as half their width have up to 0.006.
SHADED = 0.01
# Longest shift that is tried, as a fraction of the square root of the object's area.
FARTHEST = 0.2
# Least shift, pixels of the small grid: the depth is smoothed over as many.
LEAST_PX = 3.0
REMEDY = (
    "check that depth and photographs are of one scene and view, and not mirrored, cropped or "
    "scaled one without the other"
)


@dataclass(frozen=True, slots=True)
class Shift:
    """Where the depth's slopes fit the photographs best.

    shift : (2,) right and down, by which the depth lies off that place, pixels of the photographs
    as_it_is, there : part of the slopes' variance that is explained
    evidence : log-likelihood ratio of that place to the depth as it is
    """

    shift: Floats
    as_it_is: float
    there: float
    evidence: float


@dataclass(frozen=True, slots=True)
class Match:
    """How the depth goes with the photographs' shading.

    shift : None where the depth does not seem to lie beside the photographs
    slope, shade : largest mean square of its slopes that may go with the shading, and that of the
        logarithm of the shading
    """

    shift: Shift | None
    slope: float
    shade: float


def depth_unrelated(measured: Measured) -> tuple[Finding, ...]:
    """A warning where the depth shows nothing of what the photographs show."""
    match = measured(matched)
    if match is None or match.shift is not None or measured(turned) is not None:
        return ()
    if match.shade < SHADED or not match.slope < UNRELATED * match.shade:
        return ()
    varies, sloping = np.sqrt(match.shade), np.degrees(np.sqrt(max(match.slope, 0.0)))
    message = (
        f"depth and photographs do not belong together: the shading varies by {varies:.0%} over "
        f"the object, the depth's slopes along with it by {sloping:.1f} degrees at most"
    )
    return (Finding("warning", "depth-unrelated", message, REMEDY),)


def matched(capture: Capture) -> Match | None:
    """How depth and photographs go together; None where there is too little of one of them."""
    shading = relative_shading(capture)
    if shading is None:
        return None
    depth_m = depth_seen(capture)
    sloping = slopes(depth_m, shading, capture)
    where = np.asarray(shading.seen & np.isfinite(sloping).all(axis=-1))
    if np.count_nonzero(where) <= COVERED * np.count_nonzero(shading.seen):
        return None
    depth_px = capture.mask.shape[0] / depth_m.shape[0] / shading.step
    slope, shade = _common(shading, sloping, where, depth_px)
    return Match(_shift(shading, sloping, where), slope, shade)


def _common(
    shading: RelativeShading, sloping: Floats, where: Mask, depth_px: float
) -> tuple[float, float]:
    """`Match.slope` and `Match.shade`; slopes (h, w, 2) of a sensor with pixels of that size."""
    more_px = float(np.sqrt(max(depth_px**2 - shading.sigma_px**2, 0.0)))
    deviations = np.sqrt(shading.variances[: len(shading.components)])
    images = [*(shading.components * deviations[:, None, None]), *np.moveaxis(sloping, -1, 0)]
    if more_px > 0:
        images = [blurred(np.where(where, each, 0.0), more_px, where) for each in images]
    values = np.stack([each[where] for each in images], axis=-1)
    values -= values.mean(axis=0)
    shade, slope = values[:, :-2], values[:, -2:]
    gains = predicted(shade, slope, where)
    common = float(gains.sum() + ERRORS * np.sqrt(len(gains)) * gains.std(ddof=1))
    return common / len(shade), float(unexplained(shade, _smooth(where)).mean())


def predicted(shade: Floats, slope: Floats, where: Mask) -> Floats:
    """(B,) by how much the squares of each block's errors fall as its shading is known.

    shade, slope : (P, K), (P, 2) over the pixels `where` (h, w)

    A block's slopes are predicted by a linear map from the other blocks.  The sum over all is the
    sum of squares that shading explains, without what chance explains.
    """
    block = block_of(where)
    order = np.argsort(block, kind="stable")
    starts = np.flatnonzero(np.diff(block[order], prepend=-1))
    known, wanted = np.column_stack([np.ones(len(shade)), shade])[order], slope[order]
    squares = np.add.reduceat(known[:, :, None] * known[:, None, :], starts)
    products = np.add.reduceat(known[:, :, None] * wanted[:, None, :], starts)
    rest, along = squares.sum(axis=0) - squares, products.sum(axis=0) - products
    maps = np.linalg.pinv(rest, hermitian=True) @ along
    means = along[:, :1] / np.maximum(rest[:, :1, :1], 1.0)
    number = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(known)))
    mapped = np.einsum("pk,pkj->pj", known, maps[number])
    gain = (wanted - means[number, 0]) ** 2 - (wanted - mapped) ** 2
    return np.asarray(np.add.reduceat(gain.sum(axis=1), starts))


def _smooth(where: Mask) -> Floats:
    """(5, P) polynomials of second degree over the pixels `where` (h, w), without a constant."""
    y, x = (each / max(each.max(), 1) for each in np.nonzero(where))
    return np.stack([x, y, x * x, x * y, y * y])


def _shift(shading: RelativeShading, sloping: Floats, where: Mask) -> Shift | None:
    """Where slopes (h, w, 2) fit the shading best, if it is not where they are."""
    first = shading.components
    pairs = [first[i] * first[j] for i in range(len(first)) for j in range(i, len(first))]
    regressors = np.concatenate([first, pairs])
    farthest_px = int(FARTHEST * np.sqrt(np.count_nonzero(shading.seen)))
    gain = shift_gains(regressors, np.where(where[..., None], sloping, 0.0), where, farthest_px)
    down, right = (int(each) - farthest_px for each in np.unravel_index(gain.argmax(), gain.shape))
    if np.hypot(down, right) < LEAST_PX:
        return None
    fit = fit_of("", sloping, _moved(sloping, down, right), regressors, shading.seen)
    least = LIKELY + np.log(np.count_nonzero(np.isfinite(gain)))  # the best of so many
    if fit is None or fit.turned < EXPLAINED or fit.evidence < least:
        return None
    off = -shading.step * np.array([right, down], dtype=np.float64)
    return Shift(off, fit.as_it_is, fit.turned, fit.evidence)


def _moved(image: Floats, down: int, right: int) -> Floats:
    """An image (h, w, ...) moved by whole pixels, NaN where it was not."""
    height, width = image.shape[:2]
    moved = np.full_like(image, np.nan)
    to, of = (
        (slice(max(sign * down, 0), height + min(sign * down, 0)),
         slice(max(sign * right, 0), width + min(sign * right, 0)))
        for sign in (1, -1)
    )  # fmt: skip
    moved[to] = image[of]
    return moved


def shift_gains(regressors: Floats, sloping: Floats, where: Mask, farthest_px: int) -> Floats:
    """Log-likelihood ratios of slopes moved to those as they are, over single pixels.

    regressors : (K, h, w); sloping : (h, w, 2), 0 off `where` (h, w)

    (2 F + 1, 2 F + 1) of moves down and right, F being `farthest_px`; -inf beyond that distance,
    and where too few pixels have both.  Errors of neighbours are taken as independent: it ranks
    moves, and no more.

    >>> rng = np.random.default_rng(0)
    >>> sloping = rng.normal(size=(60, 60, 2))
    >>> shade = np.moveaxis(np.roll(sloping, (4, -7), axis=(0, 1)), -1, 0)
    >>> gain = shift_gains(shade, sloping, np.ones((60, 60), bool), 10)
    >>> [int(each) - 10 for each in np.unravel_index(gain.argmax(), gain.shape)]
    [4, -7]
    """
    from scipy import fft

    size = [fft.next_fast_len(side + farthest_px, real=True) for side in where.shape]
    moves = np.arange(-farthest_px, farthest_px + 1)
    chosen = np.ix_(moves % size[0], moves % size[1])

    def sums(fixed: Floats, moved: Floats) -> Floats:
        """(..., moves, moves) sums of products of images, one of which is moved."""
        product = fft.rfft2(fixed, size) * np.conj(fft.rfft2(moved, size))
        return np.asarray(fft.irfft2(product, size)[..., *chosen])

    inside = where.astype(np.float64)
    slope = np.moveaxis(sloping - sloping[where].mean(axis=0), -1, 0) * inside
    basis = np.concatenate([inside[None], regressors * inside])
    count = len(basis)
    i, j = np.triu_indices(count)
    squares = np.empty((count, count, len(moves), len(moves)))
    squares[i, j] = squares[j, i] = sums(basis[i] * basis[j], inside)
    matrix = np.moveaxis(squares, (0, 1), (-2, -1))
    along = np.moveaxis(np.stack([sums(basis, each) for each in slope]), (0, 1), (-1, -2))
    pixels = np.maximum(matrix[..., 0, 0], 1.0)
    power = sums(inside, (slope**2).sum(axis=0))
    there = power - (along[..., 0, :] ** 2).sum(axis=-1) / pixels
    trace = np.trace(matrix, axis1=-2, axis2=-1)[..., None, None]
    solved = np.linalg.solve(matrix + 1e-9 * trace * np.eye(count) + 1e-9 * np.eye(count), along)
    left = power - (along * solved).sum(axis=(-2, -1))

    left_here = np.zeros(where.shape)
    left_here[where] = unexplained(slope[:, where].T, regressors[:, where])
    here = sums((slope**2).sum(axis=0), inside)
    here -= sum(sums(each, inside) ** 2 for each in slope) / pixels
    tiny = 1e-9 * float((slope**2).sum())
    before = np.maximum(sums(left_here, inside), tiny) / np.maximum(here, tiny)
    after = np.maximum(left, tiny) / np.maximum(there, tiny)
    enough = matrix[..., 0, 0] > COVERED * np.count_nonzero(where)
    enough &= np.hypot(moves[:, None], moves) <= farthest_px
    return np.where(enough, pixels * np.log(before / after), -np.inf)

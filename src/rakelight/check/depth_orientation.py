"""Whether the depth lies on the photographs the right way round.

Slopes of a surface determine its brightness under each light, so the principal components of the
photographs' relative shading (`relative_shading`) explain the depth's slopes, by a linear
combination, whatever the lights are.  The slopes that they leave unexplained are compared for the
depth as it is and turned or mirrored in every way that fits the image, as likelihoods of Gaussian
residuals.  Neither of the two models holds the other, and both miss shadows, near lights and the
sensor's own correlated errors, so the variance of their log-likelihood ratio is that between
blocks of pixels (Vuong 1989); an object that looks the same when turned gives a small one.
Reversed relief is explained as well: of that see `inside_out`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rakelight.check.depth_shift import Displacement, outline_shift
from rakelight.check.evidence import LIKELY, SURELY, log_likelihood_ratio
from rakelight.check.measured import Measured
from rakelight.check.shading import RelativeShading, relative_shading
from rakelight.errors import CaptureError
from rakelight.geometry.blur import blurred
from rakelight.geometry.derivatives import gradient_image
from rakelight.geometry.normals import normals_from_gradient
from rakelight.model import Array, Capture, Finding, Floats, Mask
from rakelight.prepare.sensor import sensed

# Turns come first: cameras are turned more often than pictures are mirrored, and of two that fit
# an object that looks the same in a mirror the first is named.
TURNS: dict[str, Callable[[Array], Array]] = {
    "turned by 180 degrees": lambda image: image[::-1, ::-1],
    "turned by 90 degrees clockwise": lambda image: np.rot90(image, -1),
    "turned by 90 degrees anticlockwise": lambda image: np.rot90(image),
    "mirrored left to right": lambda image: image[:, ::-1],
    "mirrored top to bottom": lambda image: image[::-1],
    "mirrored along a diagonal": lambda image: image.T,
    "mirrored along the other diagonal": lambda image: image[::-1, ::-1].T,
}
# Difference of the advantage, see below, up to which two turns fit alike.
ALIKE = 0.1
# Blocks along the object's side.  Errors of depth sensors are correlated over up to a third of the
# object in random captures; 4 blocks find a tenth less than 6, with 8 a ring counts as turned
# (draws 3000 to 3099).
BLOCKS = 6
# Least fraction of the turned slopes' variance that the photographs explain.
EXPLAINED = 0.25
# Least fraction of the pixels that the turned depth covers, too.
COVERED = 0.25


@dataclass(frozen=True, slots=True)
class Fit:
    """How well photographs and depth agree: as it is, and turned, over the pixels that both cover.

    turn : a name in `TURNS`; as_it_is, turned : part of the slopes' variance that is explained
    evidence : log-likelihood ratio of the turned depth to the depth as it is
    """

    turn: str
    as_it_is: float
    turned: float
    evidence: float

    @property
    def advantage(self) -> float:
        """Logarithm of the unexplained variance as it is over that of the turned depth."""
        return float(np.log(max(1 - self.as_it_is, 1e-9) / max(1 - self.turned, 1e-9)))


def depth_orientation(measured: Measured) -> tuple[Finding, ...]:
    """A warning where the depth seems turned or mirrored against the photographs.

    Raises CaptureError, which names the turn that fits, where that is beyond doubt.
    """
    capture = measured.capture
    fits = orientation_fits(capture)
    most = max((fit.advantage for fit in fits), default=-np.inf)
    best = next((fit for fit in fits if fit.advantage > most - ALIKE), None)
    if best is None or best.turned < EXPLAINED:
        return ()
    evidence = best.evidence - float(np.log(len(fits)))  # the best of so many
    if evidence < LIKELY or fits_moved_back(capture, measured(outline_shift)[0], best):
        return ()
    what = "the depth does not lie on the photographs the way it is turned"
    seen = (
        f"slopes explained by the photographs to {best.as_it_is:.0%} as it is, to "
        f"{best.turned:.0%} {best.turn}"
    )
    remedy = f"give the depth {best.turn} (or the photographs and the mask the other way)"
    if evidence >= SURELY:
        raise CaptureError(what, source=capture.source, seen=seen, remedy=remedy)
    return (Finding("warning", "depth-turned", f"{what}: {seen}", remedy),)


def orientation_fits(capture: Capture) -> list[Fit]:
    """The fit of each turn that the shape of the depth map allows; none without evidence."""
    shading = relative_shading(capture)
    if shading is None:
        return []
    depth_m, _ = sensed(replace(capture, depth_m=capture.depth_m[:1]))
    as_it_is = slopes(depth_m, shading, capture)
    measured = shading.seen & np.isfinite(as_it_is).all(axis=-1)
    fits = []
    for name, turn in TURNS.items():
        if turn(depth_m).shape != depth_m.shape:
            continue
        turned = slopes(turn(depth_m), shading, capture)
        both = measured & np.isfinite(turned).all(axis=-1)
        if np.count_nonzero(both) > COVERED * np.count_nonzero(measured):
            components = shading.components[:, both]
            squares = [unexplained(each[both], components) for each in (as_it_is, turned)]
            before, after = (
                1 - float(left.sum()) / total(each[both])
                for left, each in zip(squares, (as_it_is, turned), strict=True)
            )
            fits.append(Fit(name, before, after, evidence(squares[0], squares[1], both)))
    return fits


def fits_moved_back(capture: Capture, shift: Displacement | None, turned: Fit) -> bool:
    """Whether the depth fits better where its outline lies on the mask's: it is only shifted."""
    shading = relative_shading(capture)
    if shift is None or not shift.plain or shading is None:
        return False
    depth_m, _ = sensed(replace(capture, depth_m=capture.depth_m[:1]))
    right, down = np.rint(shift.shift).astype(int)
    moved = slopes(np.roll(depth_m, (-down, -right), axis=(0, 1)), shading, capture)
    both = shading.seen & np.isfinite(moved).all(axis=-1)
    left = unexplained(moved[both], shading.components[:, both])
    return 1 - float(left.sum()) / total(moved[both]) > turned.turned


def evidence(as_it_is: Floats, turned: Floats, both: Mask) -> float:
    """Log-likelihood ratio of squared residuals (P,) `turned` to `as_it_is`, over pixels (h, w).

    Per pixel that of two Gaussians of two dimensions, each with its own variance.
    """
    rows, columns = np.nonzero(both)
    side = max(float(np.sqrt(len(rows))) / BLOCKS, 1.0)
    number = (rows // side) * both.shape[1] + columns // side
    _, block = np.unique(number, return_inverse=True)
    means = [max(float(each.mean()), np.finfo(float).tiny) for each in (as_it_is, turned)]
    ratio = as_it_is / means[0] - turned / means[1] + np.log(means[0] / means[1])
    pixels = np.bincount(block).astype(np.float64)
    return log_likelihood_ratio(np.bincount(block, ratio) / pixels, pixels)


def slopes(depth_m: Floats, shading: RelativeShading, capture: Capture) -> Floats:
    """(h, w, 2) the normals' x and y of a depth map (hs, ws), smoothed, on the shading's grid.

    NaN where the depth is not measured.
    """
    height, width = capture.mask.shape
    rows = np.arange(shading.rows.start, shading.rows.stop, shading.step)
    columns = np.arange(shading.columns.start, shading.columns.stop, shading.step)
    small = depth_m[
        np.ix_((rows * depth_m.shape[0]) // height, (columns * depth_m.shape[1]) // width)
    ]
    measured = shading.seen & (np.nan_to_num(small) > 0)
    log_depth = blurred(np.log(np.where(measured, small, 1.0)), shading.sigma_px, measured)
    gradient = gradient_image(log_depth, measured)
    normals, _ = normals_from_gradient(gradient[..., 0], gradient[..., 1], shading.camera)
    return np.where(measured[..., None], normals[..., :2], np.nan)


def unexplained(slopes: Floats, components: Floats) -> Floats:
    """(P,) squared residual of slopes (P, 2) that no linear map of components (K, P) explains.

    >>> ramp = np.linspace(-1, 1, 50)
    >>> left = unexplained(np.stack([ramp, -ramp], axis=-1), (2 * ramp + 1)[None])
    >>> bool(left.max() < 1e-12)
    True
    """
    regressors = np.vstack([np.ones(len(slopes)), components]).T
    off = slopes - slopes.mean(axis=0)
    left = off - regressors @ np.linalg.lstsq(regressors, off, rcond=None)[0]
    return np.asarray((left**2).sum(axis=1))


def total(slopes: Floats) -> float:
    """Sum of squares of slopes (P, 2) about their mean."""
    return max(float(((slopes - slopes.mean(axis=0)) ** 2).sum()), np.finfo(float).tiny)

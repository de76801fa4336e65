"""Whether the depth lies on the photographs the right way round.

Slopes of a surface determine its brightness under each light, so the principal components of the
photographs' relative shading (`relative_shading`) explain the depth's slopes, by a linear
combination, whatever the lights are.  The slopes that they leave unexplained are compared for the
depth as it is and turned or mirrored in every way that fits the image, as likelihoods of Gaussian
residuals.  Turned, other slopes lie on the pixels that are well exposed, so residuals are taken in
units of what there is to explain: else flat parts of the depth would always fit.  Neither of the
two models holds the other, and both miss shadows, near lights and the sensor's own correlated
errors, so the variance of their log-likelihood ratio is that between blocks of pixels (Vuong 1989);
an object that looks the same when turned gives a small one.  Reversed relief is explained as well:
of that see `inside_out`.

Of an object off the image's middle the outline tells, too: turned depth lies beside the mask as if
it were shifted, and turned back on it.  Shifted depth would do so only by chance, where an object
that looks the same when turned is shifted by just twice its distance from the middle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rakelight.check.evidence import LIKELY, SURELY, evidence_in_blocks
from rakelight.check.measured import Measured
from rakelight.check.outline import LEAST_PX, outline_shift
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
    found, capture = measured(turned), measured.capture
    if found is None:
        return ()
    best, surely = found
    what = "the depth does not lie on the photographs the way it is turned"
    seen = (
        f"slopes explained by the photographs to {best.as_it_is:.0%} as it is, to "
        f"{best.turned:.0%} {best.turn}"
    )
    remedy = f"give the depth {best.turn} (or the photographs and the mask the other way)"
    if surely:
        raise CaptureError(what, source=capture.source, seen=seen, remedy=remedy)
    return (Finding("warning", "depth-turned", f"{what}: {seen}", remedy),)


def turned(capture: Capture) -> tuple[Fit, bool] | None:
    """How the depth is turned, and whether that is beyond doubt; None where it does not seem so."""
    shading, depth_m = relative_shading(capture), depth_seen(capture)
    if shading is None:
        return None
    fits = _fits(depth_m, shading, capture)
    if not any(fit.advantage > 0 for fit in fits):
        return None
    shift = outline_shift(capture)[0]
    moved_m = None
    if shift is not None and shift.plain:
        right, down = np.rint(shift.shift).astype(int)
        moved_m = np.roll(depth_m, (-down, -right), axis=(0, 1))
        on_mask = [fit for fit in fits if fit.advantage > 0 and _on_mask(capture, depth_m, fit)]
        best = _best(on_mask)
        if best is not None:
            beside = _fit(best.turn, moved_m, TURNS[best.turn](depth_m), shading, capture)
            if beside is None or beside.evidence > -LIKELY:
                return best, True
    best = _best(fits)
    evidence = -np.inf if best is None else best.evidence - np.log(len(fits))  # the best of so many
    if best is None or evidence < LIKELY:
        return None
    if moved_m is None:
        return best, bool(evidence >= SURELY)
    beside = _fit(best.turn, moved_m, TURNS[best.turn](depth_m), shading, capture)
    if beside is not None and beside.as_it_is > beside.turned:
        return None
    return best, True  # where it is it does not lie on the mask either


def _best(fits: list[Fit]) -> Fit | None:
    """The turn that fits best, of two alike the first; None where none explains the slopes."""
    most = max((fit.advantage for fit in fits), default=-np.inf)
    best = next((fit for fit in fits if fit.advantage > most - ALIKE), None)
    return None if best is None or best.turned < EXPLAINED else best


def _on_mask(capture: Capture, depth_m: Floats, fit: Fit) -> bool:
    """Whether the outline of the turned depth lies on the mask's."""
    turned_m = np.nan_to_num(TURNS[fit.turn](depth_m))[None]
    height, width = turned_m.shape[1:]
    # The depth is on the photographs' view already: a camera of its own is now theirs, resized.
    own = None if capture.depth_camera is None else capture.camera.resized(width, height)
    there = replace(capture, depth_m=turned_m, depth_camera=own, depth_to_color=None)
    found = outline_shift(there)[0]
    return found is not None and found.length < LEAST_PX


def depth_seen(capture: Capture) -> Floats:
    """(hs, ws) the first depth map, metres, before the colour camera."""
    return sensed(replace(capture, depth_m=capture.depth_m[:1]))[0]


def orientation_fits(capture: Capture) -> list[Fit]:
    """The fit of each turn that the shape of the depth map allows; none without evidence."""
    shading = relative_shading(capture)
    return [] if shading is None else _fits(depth_seen(capture), shading, capture)


def _fits(depth_m: Floats, shading: RelativeShading, capture: Capture) -> list[Fit]:
    """The fit of each turn that the shape of a depth map (hs, ws) allows; none without evidence."""
    fits = [
        _fit(name, depth_m, turn(depth_m), shading, capture)
        for name, turn in TURNS.items()
        if turn(depth_m).shape == depth_m.shape
    ]
    return [fit for fit in fits if fit is not None]


def _fit(
    turn: str, as_it_is_m: Floats, turned_m: Floats, shading: RelativeShading, capture: Capture
) -> Fit | None:
    """The fit of two depth maps (hs, ws); None where they have too little in common."""
    both = slopes(as_it_is_m, shading, capture), slopes(turned_m, shading, capture)
    return fit_of(turn, *both, shading.components, shading.seen)


def fit_of(
    turn: str, as_it_is: Floats, turned: Floats, regressors: Floats, seen: Mask
) -> Fit | None:
    """The fit of two maps of slopes (h, w, 2), NaN = none, by regressors (K, h, w) where `seen`.

    None where they have too little in common.
    """
    both = as_it_is, turned
    where = seen & np.isfinite(both[0]).all(axis=-1)
    fewest = COVERED * np.count_nonzero(where)
    where &= np.isfinite(both[1]).all(axis=-1)
    if np.count_nonzero(where) <= fewest:
        return None
    components = regressors[:, where]
    left = [unexplained(each[where], components) / total(each[where]) for each in both]
    before, after = (1 - float(each.sum()) for each in left)
    return Fit(turn, before, after, evidence(left[0], left[1], where))


def evidence(as_it_is: Floats, turned: Floats, both: Mask) -> float:
    """Log-likelihood ratio of squared residuals (P,) `turned` to `as_it_is`, over pixels (h, w).

    Per pixel that of two Gaussians of two dimensions, each with its own variance.
    """
    means = [max(float(each.mean()), np.finfo(float).tiny) for each in (as_it_is, turned)]
    ratio = as_it_is / means[0] - turned / means[1] + np.log(means[0] / means[1])
    return evidence_in_blocks(ratio, both)


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
    """(P,) squared residual of slopes (P, M) that no linear map of components (K, P) explains.

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

"""Whether the depth lies on the photographs the right way round.

Slopes of a surface determine its brightness under each light, so the principal components of the
photographs' relative shading (`relative_shading`) explain the depth's slopes, by a linear
combination, whatever the lights are.  The fraction of the slopes' variance that they explain is
compared for the depth as it is and turned or mirrored in every way that fits the image.  Reversed
relief is explained as well: of that see `inside_out`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rakelight.check.shading import RelativeShading, relative_shading
from rakelight.errors import CaptureError
from rakelight.geometry.blur import blurred
from rakelight.geometry.derivatives import gradient_image
from rakelight.geometry.normals import normals_from_gradient
from rakelight.model import Array, Capture, Finding, Floats
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
# Difference of the evidence, see below, up to which two turns fit alike.
ALIKE = 0.1
# Evidence for a warning, and beyond doubt.
LIKELY, SURELY = 0.15, 0.25
# Least fraction of the turned slopes' variance that the photographs explain.
EXPLAINED = 0.25
# Least fraction of the pixels that the turned depth covers, too.
COVERED = 0.25


@dataclass(frozen=True, slots=True)
class Fit:
    """How well photographs and depth agree: as it is, and turned, over the pixels that both cover.

    turn : a name in `TURNS`; as_it_is, turned : part of the slopes' variance that is explained
    """

    turn: str
    as_it_is: float
    turned: float

    @property
    def evidence(self) -> float:
        """Logarithm of the unexplained variance as it is over that of the turned depth."""
        return float(np.log(max(1 - self.as_it_is, 1e-9) / max(1 - self.turned, 1e-9)))


def depth_orientation(capture: Capture) -> tuple[Finding, ...]:
    """A warning where the depth seems turned or mirrored against the photographs.

    Raises CaptureError, which names the turn that fits, where that is beyond doubt.
    """
    fits = orientation_fits(capture)
    most = max((fit.evidence for fit in fits), default=-np.inf)
    best = next((fit for fit in fits if fit.evidence > most - ALIKE), None)
    if best is None or best.evidence < LIKELY or best.turned < EXPLAINED:
        return ()
    what = "the depth does not lie on the photographs the way it is turned"
    seen = (
        f"slopes explained by the photographs to {best.as_it_is:.0%} as it is, to "
        f"{best.turned:.0%} {best.turn}"
    )
    remedy = f"give the depth {best.turn} (or the photographs and the mask the other way)"
    if best.evidence >= SURELY:
        raise CaptureError(what, source=capture.source, seen=seen, remedy=remedy)
    return (Finding("warning", "depth-turned", f"{what}: {seen}", remedy),)


def orientation_fits(capture: Capture) -> list[Fit]:
    """The fit of each turn that the shape of the depth map allows; none without evidence."""
    shading = relative_shading(capture)
    if shading is None:
        return []
    depth_m, _ = sensed(replace(capture, depth_m=capture.depth_m[:1]))
    as_it_is = slopes(depth_m, shading, capture)
    known = shading.seen & np.isfinite(as_it_is).all(axis=-1)
    fits = []
    for name, turn in TURNS.items():
        if turn(depth_m).shape != depth_m.shape:
            continue
        turned = slopes(turn(depth_m), shading, capture)
        both = known & np.isfinite(turned).all(axis=-1)
        if np.count_nonzero(both) > COVERED * np.count_nonzero(known):
            parts = (
                explained(each[both], shading.components[:, both]) for each in (as_it_is, turned)
            )
            fits.append(Fit(name, *parts))
    return fits


def slopes(depth_m: Floats, shading: RelativeShading, capture: Capture) -> Floats:
    """(h, w, 2) the normals' x and y of a depth map (hs, ws), smoothed, on the shading's grid.

    NaN where the depth is not known.
    """
    height, width = capture.mask.shape
    rows = np.arange(shading.rows.start, shading.rows.stop, shading.step)
    columns = np.arange(shading.columns.start, shading.columns.stop, shading.step)
    small = depth_m[
        np.ix_((rows * depth_m.shape[0]) // height, (columns * depth_m.shape[1]) // width)
    ]
    known = shading.seen & (np.nan_to_num(small) > 0)
    log_depth = blurred(np.log(np.where(known, small, 1.0)), shading.sigma_px, known)
    gradient = gradient_image(log_depth, known)
    normals, _ = normals_from_gradient(gradient[..., 0], gradient[..., 1], shading.camera)
    return np.where(known[..., None], normals[..., :2], np.nan)


def explained(slopes: Floats, components: Floats) -> float:
    """Part of the variance of slopes (P, 2) that a linear map of components (K, P) explains.

    >>> ramp = np.linspace(-1, 1, 50)
    >>> round(explained(np.stack([ramp, -ramp], axis=-1), (2 * ramp + 1)[None]), 6)
    1.0
    """
    regressors = np.vstack([np.ones(len(slopes)), components]).T
    off = slopes - slopes.mean(axis=0)
    left = off - regressors @ np.linalg.lstsq(regressors, off, rcond=None)[0]
    return 1 - float((left**2).sum()) / max(float((off**2).sum()), np.finfo(float).tiny)

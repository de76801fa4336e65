"""Lens distortion: where on the image plane a lens shows a point, and back.

In normalised coordinates: x = X/Z, y = Y/Z of a point are where a lens without distortion shows it.

Brown (1966) and Conrady (1919), as OpenCV has them; f(r) = (1 + k1 r^2 + k2 r^4 + k3 r^6) /
(1 + k4 r^2 + k5 r^4 + k6 r^6):

    x' = f x + 2 p1 x y + p2 (r^2 + 2 x^2)        y' = f y + p1 (r^2 + 2 y^2) + 2 p2 x y

librealsense's inverse Brown-Conrady: the same with f x and f y in the place of x and y, but not of
r, in the last two terms.  Kannala & Brandt (2006), theta = atan(r):

    x' = x/r theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)        y' as well
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.geometry.grid import outline
from rakelight.model import Camera, Distortion, Floats, Mask

# Tangent of the largest angle from the optical axis that is looked at, 84 degrees: an image
# without distortion that showed more would be twenty focal lengths wide.
STEEPEST_RAY = 10.0
# Points of the table of radii; its steps are 1/2000 focal length.
_TABLE = 20_001
# Newton's method: most steps, the residual to stop at, and the largest that counts as solved.  It
# takes 3 to 6 steps where the lens model is far from its fold.
_STEPS, _SMALL, SOLVED = 50, 1e-14, 1e-10


def distort(x: Floats, y: Floats, distortion: Distortion) -> tuple[Floats, Floats]:
    """Where a lens shows the points x, y: normalised coordinates, arrays of one shape.

    NaN beyond the range in which the model is monotone, and beyond `STEEPEST_RAY`.

    >>> lens = Distortion("brown-conrady", [0.1, 0.0, 0.0, 0.0])
    >>> there = distort(np.array([0.5]), np.array([0.0]), lens)
    >>> there[0].tolist(), there[1].tolist()
    ([0.5125], [0.0])
    """
    x, y = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
    found = _evaluated(x, y, distortion)
    with np.errstate(invalid="ignore"):
        valid = np.hypot(x, y) <= _Range.of(distortion).radius
        valid &= found.determinant > 0
    return np.where(valid, found.x, np.nan), np.where(valid, found.y, np.nan)


def undistort(x: Floats, y: Floats, distortion: Distortion) -> tuple[Floats, Floats]:
    """The points that a lens shows at x, y: the inverse of `distort`, to 1e-10.

    NaN where there is no such point in the range in which the model is monotone.

    >>> lens = Distortion("kannala-brandt", [0.05, -0.01, 0.0, 0.0])
    >>> back = undistort(*distort(np.array([0.5]), np.array([-2.0]), lens), lens)
    >>> back[0].round(9).tolist(), back[1].round(9).tolist()
    ([0.5], [-2.0])
    """
    x, y = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
    shape, goal_x, goal_y = x.shape, x.ravel(), y.ravel()
    reach = _Range.of(distortion)
    # From the radial terms alone, by a table; the tangential ones are small.
    distance = np.hypot(goal_x, goal_y)
    begin = np.interp(distance, reach.distorted, reach.radii) / np.maximum(distance, 1e-300)
    u, v = begin * goal_x, begin * goal_y
    error = np.full(u.shape, np.inf)
    todo = np.flatnonzero(np.isfinite(distance))
    factor = np.ones(u.shape)
    step_u, step_v = np.zeros(u.shape), np.zeros(u.shape)
    for _ in range(_STEPS):
        try_u, try_v = u[todo] + factor[todo] * step_u[todo], v[todo] + factor[todo] * step_v[todo]
        found = _evaluated(try_u, try_v, distortion)
        off_x, off_y = goal_x[todo] - found.x, goal_y[todo] - found.y
        size = np.hypot(off_x, off_y)
        better = size < error[todo]
        factor[todo] = np.where(better, 1.0, factor[todo] / 2)
        use = todo[better]
        u[use], v[use], error[use] = try_u[better], try_v[better], size[better]
        with np.errstate(all="ignore"):
            step_u[use], step_v[use] = (each[better] for each in found.solved(off_x, off_y))
        todo = todo[(error[todo] > _SMALL * (1 + distance[todo])) & (factor[todo] > 1e-3)]
        if not todo.size:
            break
    found = _evaluated(u, v, distortion)
    with np.errstate(invalid="ignore"):
        valid = (error <= SOLVED) & (found.determinant > 0)
        valid &= np.hypot(u, v) <= reach.radius * (1 + SOLVED)
    u, v = np.where(valid, u, np.nan), np.where(valid, v, np.nan)
    return u.reshape(shape), v.reshape(shape)


def to_rays(u: Floats, v: Floats, camera: Camera) -> tuple[Floats, Floats]:
    """X/Z and Y/Z of what a camera shows at the pixels (u, v), through its lens.

    >>> x, y = to_rays(np.array([3.0]), np.array([1.0]), Camera(5, 3, 10.0, 10.0, 2.0, 1.0))
    >>> x.tolist(), y.tolist()
    ([0.1], [0.0])
    """
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    return (x, y) if camera.distortion is None else undistort(x, y, camera.distortion)


def to_pixels(x: Floats, y: Floats, camera: Camera) -> tuple[Floats, Floats]:
    """The pixels (u, v) at which a camera shows rays of X/Z = x and Y/Z = y: `to_rays`' inverse.

    >>> u, v = to_pixels(np.array([0.1]), np.array([0.0]), Camera(5, 3, 10.0, 10.0, 2.0, 1.0))
    >>> u.tolist(), v.tolist()
    ([3.0], [1.0])
    """
    if camera.distortion is not None:
        x, y = distort(x, y, camera.distortion)
    return camera.fx * x + camera.cx, camera.fy * y + camera.cy


def corner_px(camera: Camera) -> tuple[float, float]:
    """How far the image's farthest corner is from the principal point, pixels across and along.

    >>> corner_px(Camera(8, 6, 20.0, 20.0, 4.0, 2.0))
    (4.5, 3.5)
    """
    across = max(camera.cx, camera.width - 1 - camera.cx)
    along = max(camera.cy, camera.height - 1 - camera.cy)
    return across + 0.5, along + 0.5  # from its middle to the edge of a pixel


def corner_stretch(camera: Camera) -> float:
    """How many times as far out a lens shows the farthest corner as an image without distortion.

    By the radial terms; where the lens model folds before the corner, at the fold, 1 if it does so
    at once.  Below 1 for the barrel distortion of wide lenses.

    >>> lens = Distortion("brown-conrady", [1.0, 0.0, 0.0, 0.0])
    >>> round(corner_stretch(Camera(400, 300, 400.0, 400.0, 200.0, 150.0, lens)), 2)
    1.25
    """
    if camera.distortion is None:
        return 1.0
    across, along = corner_px(camera)
    reach = _Range.of(camera.distortion)
    shown = min(float(np.hypot(across / camera.fx, along / camera.fy)), float(reach.distorted[-1]))
    without = float(np.interp(shown, reach.distorted, reach.radii))
    return shown / without if without > 0 else 1.0


def fold_px(camera: Camera, among: Mask | None = None) -> float | None:
    """How far from the principal point, pixels, the lens model folds inside the image, or None.

    among : (H, W) the pixels that count, all when None

    Beyond its fold a model shows further points nearer to the middle again: it is not that of the
    lens there.

    >>> lens = Distortion("brown-conrady", [-0.5, 0.0, 0.0, 0.0])
    >>> round(fold_px(Camera(400, 300, 200.0, 200.0, 199.5, 149.5, lens)))
    109
    >>> fold_px(Camera(400, 300, 500.0, 500.0, 199.5, 149.5, lens)) is None
    True
    """
    if camera.distortion is None:
        return None
    # What lies beyond the fold goes on outwards, so an outline has of it what the inside has.
    v, u = np.nonzero(outline(np.ones(camera.shape, bool) if among is None else among))
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    distance = np.hypot(x, y)
    reach = _Range.of(camera.distortion)
    lost = np.isnan(undistort(x, y, camera.distortion)[0]) & (distance < reach.distorted[-1])
    lost |= distance >= reach.fold
    if not lost.any():
        return None
    first = min(float(distance[lost].min()), reach.fold)
    return first * float(np.sqrt(camera.fx * camera.fy))


@dataclass(frozen=True, slots=True)
class _Evaluated:
    """Distorted points and the derivatives of x and y along both axes."""

    x: Floats
    y: Floats
    xx: Floats
    xy: Floats
    yx: Floats
    yy: Floats

    @property
    def determinant(self) -> Floats:
        with np.errstate(all="ignore"):
            return np.asarray(self.xx * self.yy - self.xy * self.yx)

    def solved(self, a: Floats, b: Floats) -> tuple[Floats, Floats]:
        """The step that changes the distorted points by a and b."""
        d = self.determinant
        return (self.yy * a - self.xy * b) / d, (self.xx * b - self.yx * a) / d


def _evaluated(x: Floats, y: Floats, distortion: Distortion) -> _Evaluated:
    """The formulas of this file's docstring, anywhere."""
    with np.errstate(all="ignore"):
        r2 = x * x + y * y
        f, slope = _radial(r2, distortion)
        a, b = f * x, f * y
        xx, yy = f + 2 * slope * x * x, f + 2 * slope * y * y
        xy = 2 * slope * x * y
        if distortion.model == "kannala-brandt":
            return _Evaluated(a, b, xx, xy, xy, yy)
        p1, p2 = distortion.coefficients[2:4]
        inverse = distortion.model == "inverse-brown-conrady"
        s, t = (a, b) if inverse else (x, y)
        # Derivatives of the tangential terms with s, t and r^2; then of s and t with x and y.
        x_s, x_t, y_s, y_t = (
            2 * p1 * t + 4 * p2 * s,
            2 * p1 * s,
            2 * p2 * t,
            4 * p1 * t + 2 * p2 * s,
        )
        s_x, s_y, t_y = (xx, xy, yy) if inverse else (1.0, 0.0, 1.0)
        return _Evaluated(
            a + 2 * p1 * s * t + p2 * (r2 + 2 * s * s),
            b + p1 * (r2 + 2 * t * t) + 2 * p2 * s * t,
            xx + x_s * s_x + x_t * s_y + 2 * p2 * x,
            xy + x_s * s_y + x_t * t_y + 2 * p2 * y,
            xy + y_s * s_x + y_t * s_y + 2 * p1 * x,
            yy + y_s * s_y + y_t * t_y + 2 * p1 * y,
        )


def _radial(r2: Floats, distortion: Distortion) -> tuple[Floats, Floats]:
    """f, the distorted radius over the radius, and its derivative with r^2."""
    k = distortion.coefficients
    if distortion.model == "kannala-brandt":
        r = np.sqrt(r2)
        theta = np.arctan(r)
        square = theta * theta
        series = 1 + square * (k[0] + square * (k[1] + square * (k[2] + square * k[3])))
        along = 1 + square * (
            3 * k[0] + square * (5 * k[1] + square * (7 * k[2] + square * 9 * k[3]))
        )
        near = r < 1e-4
        f = np.where(near, 1 + (k[0] - 1 / 3) * r2, theta * series / np.where(near, 1, r))
        # d(theta series)/dr = along / (1 + r^2) = f + 2 r^2 df/dr^2
        slope = (along / (1 + r2) - f) / np.where(near, 1, 2 * r2)
        return f, np.where(near, k[0] - 1 / 3, slope)
    k1, k2, _, _, k3, k4, k5, k6 = (*k, *[0.0] * (8 - len(k)))
    top = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    bottom = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    rise = k1 + r2 * (2 * k2 + r2 * 3 * k3)
    fall = k4 + r2 * (2 * k5 + r2 * 3 * k6)
    f = top / bottom
    return f, (rise - f * fall) / bottom


@dataclass(frozen=True, slots=True)
class _Range:
    """Where the radial terms are monotone.

    radii, distorted : a table of radii without and with distortion, both increasing
    fold : the distorted radius at which the model folds, infinite where it does not
    """

    radii: Floats
    distorted: Floats
    fold: float

    @property
    def radius(self) -> float:
        """The largest, without distortion."""
        return float(self.radii[-1])

    @classmethod
    def of(cls, distortion: Distortion) -> _Range:
        radii = np.linspace(0, STEEPEST_RAY, _TABLE)
        distorted, sound = _along(radii, distortion)
        if not sound.all():
            last = int(np.argmin(sound)) - 1
            fine = np.linspace(radii[last], radii[last + 1], 1001)
            radii = np.append(radii[: last + 1], fine[_along(fine, distortion)[1]][-1])
            distorted = _along(radii, distortion)[0]
            return cls(radii, distorted, float(distorted[-1]))
        fold = np.inf
        if distortion.model == "kannala-brandt":
            theta = np.linspace(np.arctan(STEEPEST_RAY), np.pi, 1000)
            with np.errstate(all="ignore"):
                shown = theta * np.polyval([*distortion.coefficients[::-1], 1.0], theta**2)
                folded = np.diff(shown) <= 0
            if folded.any():
                fold = float(shown[int(np.argmax(folded))])
        return cls(radii, distorted, fold)


def _along(radii: Floats, distortion: Distortion) -> tuple[Floats, Floats]:
    """Distorted radii, and whether the model is still sound there: it increases, without a pole.

    At the first of the radii it is.
    """
    with np.errstate(all="ignore"):
        f, slope = _radial(radii**2, distortion)
        distorted = f * radii
        sound = (f + 2 * slope * radii**2 > 0) & (f > 0) & np.isfinite(distorted)
        sound[1:] &= np.diff(distorted) > 0
    sound[0] = True  # also of coefficients that overflow
    return distorted, np.logical_and.accumulate(sound)

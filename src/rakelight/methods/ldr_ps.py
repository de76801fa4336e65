"""LDR-PS: shape and lights from the photographs alone, by local diffuse reflectance maxima.

Favaro and Papadhimitri, "A closed-form solution to uncalibrated photometric stereo via diffuse
maxima" (CVPR 2012).  Distant lights on a Lambertian surface give image values of rank three,

    I_ix = s_i . b_x,        s = A^-T l (light),   b = A rho n (scaled normal)             (1)

for any invertible A.  That the normals belong to one surface fixes A up to the generalised
bas-relief transformation, three numbers (mu, nu, lambda),

    rho n = G^T b,   l = G^-1 s,   G = [[1, 0, 0], [0, 1, 0], [mu, nu, lambda]]           (2)

and where a photograph is locally brightest and the albedo even, the normal points to the light:

    n || l   <=>   (G G^T b) x s = 0,   linear in mu, nu and mu^2 + nu^2 + lambda^2       (3)

Only the distance at the end is the depth sensor's.  It is the paper's figure 8: the shape without
a depth prior.  Ambient light and highlights are not in the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rakelight.errors import MethodError
from rakelight.geometry.camera import pixel_rays
from rakelight.geometry.fill import nearest_fill
from rakelight.geometry.grid import has_gradient, mean_gradient
from rakelight.geometry.normals import normal_derivatives, towards_camera
from rakelight.methods.base import (
    Estimate,
    Method,
    brightest,
    photometric_confidence,
    require_options,
    require_photographs,
    require_types,
    scatter,
)
from rakelight.model import Array, Camera, Finding, Floats, Lights, Mask, Progress, ProgressCallback
from rakelight.photometry.forward import least_squares_albedo
from rakelight.prepare import Prepared
from rakelight.solve import assemble, solve
from rakelight.solve.robust import SMALLEST_NOISE

# Pixels in the sample that the lights are estimated from; more only take longer.
LIGHT_PIXELS = 20_000
# Standard deviation, pixels, of the blur of normals before differences, and of photographs before
# maxima.
SMOOTH_PX = 1.5
# Half the side, pixels, of the window in which a maximum is the brightest; one that stays within
# half of that from light to light is a change of albedo.
APART_PX = 10
# Largest angle, degrees, between normal and light at a maximum that agrees with a G.
AGREE_DEG = 6.0
# Random pairs of maxima that are tried (RANSAC), and iterations of reweighted least squares.
PAIRS = 1000
ROBUST_ROUNDS = 12
# Least -n . ray of a pixel whose slope is used, about 85 degrees.
GRAZING = 0.08
# Weight of a slope that was filled in.
UNKNOWN = 1e-3


@dataclass(frozen=True, slots=True)
class LdrPs:
    """What can be set; a good result needs none of it.

    max_iterations : rounds of lights and scaled normals in turn, where values are missing
    tolerance : the rounds end when one lowers the sum of squares by less than this fraction
    shadow : a value below this fraction of the pixel's brightest is a shadow, and missing
    min_photographs : fewer are refused
    """

    max_iterations: int = 60
    tolerance: float = 1e-4
    shadow: float = 0.2
    min_photographs: int = 4

    def __post_init__(self) -> None:
        require_types(self)
        require_options(
            self,
            max_iterations=(self.max_iterations >= 1, "at least 1"),
            tolerance=(0 <= self.tolerance < np.inf, "at least 0"),
            shadow=(0 <= self.shadow < 1, "at least 0 and below 1"),
            min_photographs=(self.min_photographs >= 4, "at least 4"),
        )


@dataclass(frozen=True, slots=True)
class Factors:
    """lights (N, 3) and scaled normals (P, 3) whose products are the photographs' values."""

    lights: Floats
    normals: Floats
    energy: tuple[float, ...] = ()

    def changed(self, A: Floats) -> Factors:
        """(1): the same products, with normals A b."""
        return Factors(self.lights @ np.linalg.inv(A), self.normals @ A.T, self.energy)


def ldr_ps(prepared: Prepared, options: LdrPs, progress: ProgressCallback) -> Estimate:
    """Uncalibrated photometric stereo by local diffuse reflectance maxima.

    Raises MethodError for fewer photographs than `options.min_photographs`.
    """
    require_photographs(prepared, "ldr-ps", options.min_photographs, for_the_scale=True)
    camera, mask = prepared.camera, prepared.mask
    values, lit = grey_photographs(prepared, options.shadow)
    determined = scatter(lit.sum(axis=0) >= 3, mask) > 0
    if not has_gradient(determined).any():
        raise too_little_lit(prepared.source)
    progress(Progress("factorise"))
    factors = factorise(values, lit, options)
    factors = factors.changed(integrable_basis(factors.normals, mask, determined, camera))
    progress(Progress("diffuse maxima"))
    where, lamp = diffuse_maxima(values, lit, mask)
    smooth = smoothed(scatter(factors.normals, mask), determined)[mask]
    G, agreeing = bas_relief(smooth[where], factors.lights, lamp)
    factors = upright(factors.changed(G.T), mask, camera)

    length = np.linalg.norm(factors.normals, axis=1, keepdims=True)
    normals = scatter(factors.normals / np.maximum(length, np.finfo(float).tiny), mask)
    progress(Progress("integrate"))
    determined &= towards_camera(normals, camera) > GRAZING
    if not determined.any():
        raise too_little_lit(prepared.source)
    log_depth = integrated(normals, determined, mask, camera)
    log_depth += np.median((np.log(prepared.depth_m) - log_depth)[mask & prepared.measured])
    albedo, gain = estimated_albedo(prepared, factors, lit, normals[mask])
    return Estimate(
        log_depth=log_depth,
        albedo=scatter(albedo, mask),
        confidence=confidence(factors, values, lit, normals, mask, camera),
        lights=Lights(gain * factors.lights[:, None], np.zeros((len(prepared), 1))),
        energy=factors.energy,
        converged=settled(factors.energy, options.tolerance),
        findings=(_finding(len(where), int(agreeing.sum())),),
    )


def too_little_lit(source: str) -> MethodError:
    """The error where hardly a normal is determined."""
    return MethodError(
        "too little of the object is lit often enough for ldr-ps",
        source=source,
        seen="hardly a pixel that is bright in 3 photographs",
        remedy="change the exposure, or move the lamp less far to the side",
    )


# ---- (1) rank three


def grey_photographs(prepared: Prepared, shadow: float) -> tuple[Floats, Mask]:
    """Linear light (N, P), mean of the channels, and which of it is neither shadow nor clipped."""
    pixels = [prepared.pixels(i) for i in range(len(prepared))]
    values = np.stack([light.mean(axis=-1, dtype=np.float64) for light, _ in pixels])
    usable = np.stack([fine.all(axis=-1) for _, fine in pixels])
    brightest = np.max(np.where(usable, values, 0.0), axis=0)
    return values, usable & (values > shadow * brightest)


def factorise(values: Floats, lit: Mask, options: LdrPs) -> Factors:
    """Lights and scaled normals that explain the lit values by least squares, each in turn.

    The start is the best rank-three approximation of all the values, missing or not.
    """
    count = values.shape[1]
    some = np.unique(np.linspace(0, count - 1, min(count, LIGHT_PIXELS)).astype(int))
    seen, W = values[:, some], lit[:, some].astype(np.float64)
    # Its lights are singular vectors of the values, which are eigenvectors of a small matrix.
    lights = np.linalg.eigh(seen @ seen.T)[1][:, -3:]
    energy: list[float] = []
    for _ in range(options.max_iterations):
        normals = least_squares(lights, seen, W)
        energy.append(float((W * (seen - lights @ normals.T) ** 2).sum()))
        if settled(energy, options.tolerance):
            break
        lights = least_squares(normals, seen.T, W.T)
    normals = least_squares(lights, values, lit.astype(np.float64))
    # Orthonormal over the pixels, for conditioning only.
    dilated, axes = np.linalg.eigh(normals.T @ normals / count)
    whiten = axes / np.sqrt(np.maximum(dilated, 1e-12 * dilated[-1]))
    return Factors(lights, normals, tuple(energy)).changed(whiten.T)


def settled(energy: Sequence[float], tolerance: float) -> bool:
    """Whether the last round has lowered the energy by next to nothing."""
    return len(energy) > 1 and energy[-2] - energy[-1] <= tolerance * energy[-1]


def least_squares(factors: Floats, values: Floats, weights: Floats) -> Floats:
    """(P, 3) x with factors (N, 3) x_p = values (N, P), weights (N, P); 0 where underdetermined.

    >>> factors = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]])
    >>> x = np.array([[1.0, 2.0, 3.0]])
    >>> least_squares(factors, factors @ x.T, np.array([[1.0], [1], [0], [1]])).round(6).tolist()
    [[1.0, 2.0, 3.0]]
    """
    outer = (factors[:, :, None] * factors[:, None, :]).reshape(len(factors), 9)
    hessian = (weights.T @ outer).reshape(-1, 3, 3)
    right = (weights * values).T @ factors
    scale = np.trace(hessian, axis1=1, axis2=2)
    hessian += (1e-9 * scale + np.finfo(float).tiny)[:, None, None] * np.eye(3)
    solved = np.linalg.solve(hessian, right[..., None])[..., 0]
    return np.where((weights > 0).sum(axis=0)[:, None] >= 3, solved, 0.0)


# ---- up to (2): one surface has these normals


def integrable_basis(normals: Floats, mask: Mask, determined: Mask, camera: Camera) -> Floats:
    """A (3, 3), up to bas-relief, that makes A b the normals of a surface in perspective.

    With a = A b and the ray r = (x/fx, y/fy, 1), the gradient of log depth is
    -(a_1/fx, a_2/fy) / (a . r), and that it has no curl is linear in the cofactors of A:

        fx (a_2 x a_3).w_u - fy (a_1 x a_3).w_v = (a_1 x a_2).(x w_u + y w_v),      w = b x db

    a_i being the rows.  The right side, which parallel rays lack (Yuille and Snow, 1997), is
    faint: it is left out, and noise would only make of it a bas-relief of its own.
    """
    field = smoothed(scatter(normals, mask), determined)
    inner = has_gradient(determined)
    gradients = [mean_gradient(field[..., k], determined) for k in range(3)]
    along_u, along_v = (np.stack([g[axis] for g in gradients], axis=-1)[inner] for axis in (0, 1))
    w_u, w_v = np.cross(field[inner], along_u), np.cross(field[inner], along_v)
    rows = np.concatenate([camera.fx * w_u, -camera.fy * w_v], axis=1)
    weight = np.ones(len(rows))
    for _ in range(ROBUST_ROUNDS):  # edges, where the average mixes two surfaces, are outvoted
        cofactors = np.linalg.eigh((rows * weight[:, None]).T @ rows)[1][:, 0]
        residual = rows @ cofactors
        weight = 1 / (1 + (residual / (1.5 * np.median(np.abs(residual)) + 1e-30)) ** 2)
    c23, c13 = cofactors[:3], cofactors[3:6]
    a_3 = np.cross(c13, c23)
    if np.linalg.norm(a_3) < 1e-9:  # a plane: its normals say nothing
        return np.eye(3)
    a_3 /= np.sqrt(np.linalg.norm(a_3))  # about as long as the others, for conditioning only
    A = np.stack([np.cross(a_3, c13), np.cross(a_3, c23), (a_3 @ a_3) * a_3])
    return np.asarray(A / (a_3 @ a_3))


def smoothed(field: Floats, determined: Mask) -> Floats:
    """Directions of a field (h, w, 3) averaged over `SMOOTH_PX` where `determined`, unit length."""
    from scipy.ndimage import gaussian_filter

    length = np.linalg.norm(field, axis=-1, keepdims=True)
    unit = np.where(determined[..., None], field / np.maximum(length, np.finfo(float).tiny), 0.0)
    mean = gaussian_filter(unit, (SMOOTH_PX, SMOOTH_PX, 0))
    return np.asarray(mean / np.maximum(np.linalg.norm(mean, axis=-1, keepdims=True), 1e-12))


# ---- (3) bas-relief from the maxima


def diffuse_maxima(values: Floats, lit: Mask, mask: Mask) -> tuple[Array, Array]:
    """Pixels (K,) of the P and photographs (K,) where a photograph is locally brightest.

    Maxima at the border of the lit pixels, and those that most lights share, are left out.
    """
    from scipy.ndimage import binary_erosion, gaussian_filter, maximum_filter

    maxima = []
    for image, seen in zip(values, lit, strict=True):
        inside = scatter(seen, mask) > 0
        share = gaussian_filter(inside.astype(float), SMOOTH_PX)
        smooth = gaussian_filter(scatter(image * seen, mask), SMOOTH_PX) / np.maximum(share, 1e-6)
        smooth = np.where(inside, smooth, 0.0)
        highest = smooth == maximum_filter(smooth, 2 * APART_PX + 1)
        maxima.append(highest & binary_erosion(inside, iterations=APART_PX))
    dilated = [maximum_filter(each, 2 * (APART_PX // 2) + 1) for each in maxima]
    still = np.sum(dilated, axis=0) > len(values) / 2
    found = np.stack([(each & ~still)[mask] for each in maxima])
    lamp, where = np.nonzero(found)
    return where, lamp


def bas_relief(normals: Floats, lights: Floats, lamp: Array) -> tuple[Floats, Mask]:
    """G (3, 3) of (2) from scaled normals (K, 3) that face lights (N, 3), and who agrees (K,).

    lamp : (K,) which of the lights each normal faces

    Changes of albedo make false maxima, which agree with no common G: of the G of many pairs the
    one that most maxima agree with is taken (RANSAC), and fitted to those by (3), reweighted.
    """
    rng = np.random.default_rng(0)
    count, each = len(normals), np.arange(len(normals))
    share = np.bincount(lamp, minlength=len(lights)) / max(count, 1)
    best: Floats = np.eye(3)
    angle, score = np.full(count, np.inf), 0.0
    for _ in range(PAIRS if count >= 2 else 0):
        pair = rng.choice(count, 2, replace=False)
        G = _fitted(normals[pair], lights[lamp[pair]], np.ones(2))
        if G is not None:
            angles = _angles(G, normals, lights)
            agree = angles < AGREE_DEG
            # A G that brings all normals and lights together makes everything agree: the agreement
            # with the other maxima's lights is subtracted.
            now = float(agree[each, lamp].sum() - (agree @ share).sum())
            if now > score:
                best, angle, score = G, angles[each, lamp], now
    for _ in range(ROBUST_ROUNDS):
        agreeing = angle < AGREE_DEG
        length = np.linalg.norm(normals[agreeing] @ best @ best.T, axis=1)
        weight = 1 / (1 + (3 * angle[agreeing] / AGREE_DEG) ** 2)
        G = _fitted(normals[agreeing], lights[lamp[agreeing]], np.sqrt(weight) / length)
        if G is None:
            break
        best, angle = G, _angles(G, normals, lights)[each, lamp]
    return best, angle < AGREE_DEG


def _fitted(b: Floats, s: Floats, weight: Floats) -> Floats | None:
    """G from (3) by least squares, weights (K,); None where no real lambda fits.

    G G^T = [[1, 0, mu], [0, 1, nu], [mu, nu, kappa]].
    """
    if len(b) < 2:
        return None
    zero = np.zeros(len(b))
    columns = [  # G G^T b = first + mu, nu, kappa times the others
        np.stack([b[:, 0], b[:, 1], zero], axis=1),
        np.stack([b[:, 2], zero, b[:, 0]], axis=1),
        np.stack([zero, b[:, 2], b[:, 1]], axis=1),
        np.stack([zero, zero, b[:, 2]], axis=1),
    ]
    unit = s / np.linalg.norm(s, axis=1, keepdims=True) * weight[:, None]
    first, *others = (np.cross(column, unit).ravel() for column in columns)
    mu, nu, kappa = np.linalg.lstsq(np.stack(others, axis=1), -first, rcond=None)[0]
    square = kappa - mu**2 - nu**2
    if not square > 1e-12:
        return None
    return np.array([[1, 0, 0], [0, 1, 0], [mu, nu, np.sqrt(square)]])


def _angles(G: Floats, b: Floats, s: Floats) -> Floats:
    """(K, N) degrees between every normal and every lamp under G."""
    n, l = b @ G, s @ np.linalg.inv(G).T  # noqa: E741
    n = n / np.linalg.norm(n, axis=1, keepdims=True)
    l = l / np.linalg.norm(l, axis=1, keepdims=True)  # noqa: E741
    return np.asarray(np.degrees(np.arccos(np.clip(n @ l.T, -1, 1))))


def upright(factors: Factors, mask: Mask, camera: Camera) -> Factors:
    """The factors with normals that face the camera, of an object that bulges towards it.

    Both signs are open, and the second is the old riddle of the hollow face.  We take objects to
    be convex as a whole: their normals lean outwards from the middle.
    """
    x, y = (np.broadcast_to(side, mask.shape)[mask] for side in pixel_rays(camera))
    n = factors.normals
    facing = -np.sign(np.median(n @ [x.mean() / camera.fx, y.mean() / camera.fy, 1.0])) or 1.0
    unit = n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), np.finfo(float).tiny)
    outward = np.sum(unit[:, 0] * (x - x.mean()) + unit[:, 1] * (y - y.mean())) * facing
    lean = 1.0 if outward >= 0 else -1.0
    return factors.changed(facing * np.diag([lean, lean, 1.0]))


# ---- surface, albedo, confidence


def integrated(normals: Floats, determined: Mask, mask: Mask, camera: Camera) -> Floats:
    """Log depth (h, w), up to a constant, whose gradient fits the normals (h, w, 3).

    Under a Cauchy loss, so that gradients at depth jumps have little weight.

    determined : (h, w) where normals are, and face the camera by more than `GRAZING`
    Raises InputError where the solver does not find it: there is no other depth to fall back on.
    """
    facing = towards_camera(normals, camera)
    # f times the gradient, of the size of a slope; filled in where there is none.
    slope = normals[..., :2] / np.maximum(facing, GRAZING)[..., None]
    slope = np.stack([nearest_fill(slope[..., k], determined) for k in (0, 1)], axis=-1)
    target = slope / [camera.fx, camera.fy]
    # An error of the normal makes a larger one of the slope where that is large.
    base = np.where(determined, np.square(1 / (1 + np.square(slope).sum(axis=-1))), UNKNOWN)
    weight: Floats = base
    log_depth: Floats = np.zeros(mask.shape)
    anchor = np.zeros(mask.shape)
    anchor.flat[np.flatnonzero(mask)[0]] = 1.0  # fixes the distance, which is open, at one pixel
    for _ in range(ROBUST_ROUNDS):
        tensor: Floats = np.stack([weight, 0 * weight, weight], axis=-1)
        system = assemble(mask, tensor, weight[..., None] * target, anchor, 0 * anchor)
        log_depth = solve(system, start=log_depth, tolerance=1e-6).required("the surface")
        residual = np.stack(mean_gradient(log_depth, mask), axis=-1) - target
        squared_residual = base * (residual**2).sum(axis=-1)
        scale = 6 * np.median(squared_residual[determined])
        weight = base / (1 + squared_residual / np.maximum(scale, 1e-30))
    return log_depth


def estimated_albedo(
    prepared: Prepared, factors: Factors, lit: Mask, normals: Floats
) -> tuple[Floats, float]:
    """Albedo (P, 3), its 99th percentile 1, and the factor of the lights that goes with it."""
    shading = np.maximum(factors.lights @ normals.T, 0.0)
    photographs = (prepared.pixels(i) for i in range(len(lit)))
    albedo, _ = least_squares_albedo(
        (light, usable & seen[:, None], shade[:, None])
        for (light, usable), seen, shade in zip(photographs, lit, shading, strict=True)
    )
    gain = brightest(albedo)
    return albedo / gain, gain


def confidence(
    factors: Factors, values: Floats, lit: Mask, normals: Floats, mask: Mask, camera: Camera
) -> Floats:
    """(h, w) how well the photographs determine a normal, given the lights."""
    residual = np.where(lit, values - factors.lights @ factors.normals.T, 0.0)
    noise = max(float(np.sqrt((residual**2).sum() / max(lit.sum(), 1))), SMALLEST_NOISE)
    length = 1 / np.maximum(towards_camera(normals, camera), GRAZING)  # |m|, for m . ray = -1
    dn_dg = np.stack(normal_derivatives(normals, length, camera), axis=-1)[mask]
    weight = np.linalg.norm(factors.normals, axis=1) * lit
    uu, uv, vv = (
        np.einsum("ip,ip,ip->p", weight**2, *(factors.lights @ dn_dg[..., k].T for k in pair))
        for pair in ((0, 0), (0, 1), (1, 1))
    )
    tensor = scatter(np.stack([uu, uv, vv], axis=-1), mask)
    return np.where(mask, photometric_confidence(tensor, noise, length, camera), 0.0)


def _finding(maxima: int, agreeing: int) -> Finding:
    return Finding(
        "warning",
        "depth-not-used",
        f"the shape owes nothing to the depth sensor but its distance; its bas-relief is read from "
        f"{agreeing} of {maxima} diffuse maxima",
        "use multi-light for a metric shape",
    )


METHOD = Method("ldr-ps", ldr_ps, LdrPs, given_lights="find")

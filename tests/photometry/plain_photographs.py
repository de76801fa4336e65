"""One pass over the photographs in plain numpy: what the compiled kernels have to agree with.

Arrays are whole images, (N, h, w, 3) for N photographs, and derivatives are complex steps: with
i 1e-30 added to a variable the imaginary part over 1e-30 is the derivative, to the last digit.
"""

from dataclasses import dataclass

import numpy as np

TINY = 1e-30
ALBEDO_ROUNDS = 2
LEAST_ALBEDO = 1e-6


def decoded(photographs):
    """Linear light (N, h, w, 3), and which values count: usable, on a pixel with a normal."""
    values = photographs.values
    good = (values >= photographs.low) & (values <= photographs.high)
    return photographs.table[values].astype(float), good & photographs.active[..., None]


def length(x):
    """Euclidean length along the last axis, kept; analytic, so that complex steps pass."""
    return np.sqrt((x * x).sum(axis=-1, keepdims=True))


def m_of(gradient, camera):
    """(h, w, 3) the normals before they are normalised."""
    x = np.arange(camera.width)[None, :] - camera.cx
    y = np.arange(camera.height)[:, None] - camera.cy
    u, v = gradient[..., 0], gradient[..., 1]
    return np.stack([camera.fx * u, camera.fy * v, -(1 + x * u + y * v)], axis=-1)


def light_at(vector, inverse_distance, points, beam=(0.0, 0.0, 0.0)):
    """(h, w, 3) light vectors at each point, of a lamp towards `vector`, 1/inverse_distance away.

    The inverse square law of a lamp at P = u / k:  s(X) = |q| |P|^2 (P - X) / |P - X|^3, times the
    beam's  exp(b_x X_x + b_y X_y + w (u . X)^2).
    """
    size = length(vector)
    toward = vector / size - inverse_distance * points
    across = beam[0] * points[..., :1] + beam[1] * points[..., 1:2]
    along = (points * vector / size).sum(axis=-1, keepdims=True)
    return np.exp(across + beam[2] * along**2) * size * toward / length(toward) ** 3


def shading(
    photographs, gradient, points, vector, ambient, inverse_distance, beam, direction,
    lagged_length=None,
):  # fmt: skip
    """(N, h, w, 3) of lights vector, beam (N, C, 3), ambient, inverse_distance (N, C).

    direction : (3,) of the ambient light
    """
    m = m_of(gradient, photographs.camera)
    n = m / (length(m) if lagged_length is None else lagged_length)
    count, channels = ambient.shape
    images = []
    for i in range(count):
        for c in range(channels):
            s = light_at(vector[i, c], inverse_distance[i, c], points, beam[i, c])
            dot = (s * n).sum(axis=-1)
            around = ambient[i, c] * (1 + n @ direction)
            images.append(np.where(dot.real > 0, dot, 0) + around)
    stack = np.stack(images, axis=-1).reshape(*m.shape[:2], count, channels)
    return np.moveaxis(np.broadcast_to(stack, (*stack.shape[:3], 3)), 2, 0)


def highlight(
    photographs, gradient, points, vector, inverse_distance, beam, gloss, lagged_length=None
):
    """(N, h, w, 3) Blinn-Phong highlights |s| sum_e k_e (n . h)^e, exponents 8, 32 and 128."""
    camera, (count, channels) = photographs.camera, inverse_distance.shape
    m = m_of(gradient, camera)
    n = m / (length(m) if lagged_length is None else lagged_length)
    right, below = np.arange(camera.width) - camera.cx, np.arange(camera.height) - camera.cy
    rays = np.ones(m.shape)
    rays[..., 0], rays[..., 1] = right / camera.fx, below[:, None] / camera.fy
    view = -rays / length(rays)
    images = []
    for i in range(count):
        for c in range(channels):
            s = light_at(vector[i, c], inverse_distance[i, c], points, beam[i, c])
            halfway = s / length(s) + view
            cosine = (halfway / length(halfway) * n).sum(axis=-1)
            faces = ((s * n).sum(axis=-1).real > 0) & (cosine.real > 0)
            lobes = sum(k * cosine**e for k, e in zip(gloss, (8, 32, 128), strict=True))
            images.append(np.where(faces, length(s)[..., 0] * lobes, 0))
    stack = np.stack(images, axis=-1).reshape(*m.shape[:2], count, channels)
    return np.moveaxis(np.broadcast_to(stack, (*stack.shape[:3], 3)), 2, 0)


def highlight_of(photographs, surface, lights):
    """(N, h, w, 3) highlights of a Surface under LightParameters."""
    parts = lights.vector, lights.inverse_distance, lights.beams, lights.gloss
    return highlight(photographs, surface.gradient, surface.points, *parts)


def shading_of(photographs, surface, lights):
    """(N, h, w, 3) shading of a Surface under LightParameters."""
    return shading(photographs, surface.gradient, surface.points, *numbers(lights))


def numbers(lights):
    """Vector and beam (N, C, 3), ambient and inverse_distance (N, C), ambient_direction (3,)."""
    each = lights.vector, lights.ambient, lights.inverse_distance, lights.beams
    return *each, lights.ambient_direction


def shading_by_gradient(photographs, surface, lights, lagged):
    """(2, N, h, w, 3) of shading, of highlights: with the gradient of log depth."""
    fixed = length(m_of(surface.gradient, photographs.camera)) if lagged else None
    parts = lights.vector, lights.inverse_distance, lights.beams, lights.gloss
    derivatives = []
    for axis in (0, 1):
        moved = surface.gradient.astype(complex)
        moved[..., axis] += 1j * TINY
        a = shading(photographs, moved, surface.points, *numbers(lights), lagged_length=fixed)
        g = highlight(photographs, moved, surface.points, *parts, lagged_length=fixed)
        derivatives.append((a.imag / TINY, g.imag / TINY))
    return (np.stack(each) for each in zip(*derivatives, strict=True))


# Places in `numbers` of each light's: vector, inverse distance, beam, ambient.
EACH = [(0, 0), (0, 1), (0, 2), (2,), (3, 0), (3, 1), (3, 2), (1,)]


def shading_by_light(photographs, surface, lights, count, ambient_direction=False):
    """(K, N, h, w, 3) of shading, of highlights: with `count` numbers of each light; the gloss.

    Vector, [inverse distance, [beam,]] ambient.  With the gloss only where there is one.  Last, if
    `ambient_direction`, that of the ambient light.
    """
    derivatives = []
    for light in np.ndindex(lights.ambient.shape):
        for k in [*EACH[: count - 1], EACH[-1]]:
            moved = [array.astype(complex) for array in numbers(lights)]
            moved[k[0]][(*light, *k[1:])] += 1j * TINY
            a = shading(photographs, surface.gradient, surface.points, *moved)
            vector, _, inverse_distance, beam, _ = moved
            parts = surface.gradient, surface.points, vector, inverse_distance, beam, lights.gloss
            g = highlight(photographs, *parts)
            derivatives.append((a.imag / TINY, g.imag / TINY))
    vector, _, inverse_distance, beam, direction = numbers(lights)
    parts = surface.gradient, surface.points, vector, inverse_distance, beam
    for one in np.eye(3) if lights.gloss.any() else ():
        g = highlight(photographs, *parts, one)
        derivatives.append((np.zeros_like(g), g))
    for one in np.eye(3) if ambient_direction else ():
        turned = *numbers(lights)[:-1], direction + 1j * TINY * one
        a = shading(photographs, surface.gradient, surface.points, *turned)
        derivatives.append((a.imag / TINY, np.zeros(a.shape)))
    return (np.stack(each) for each in zip(*derivatives, strict=True))


def weights(residual, good, scale):
    """Cauchy weights (N, h, w, 3), 1 for plain least squares; 0 leaves a value out."""
    if np.all(scale == 0):
        return good.astype(float)
    return good / (1 + (residual / np.broadcast_to(scale, good.shape[1:3])[..., None]) ** 2)


def ratio(x, y):
    """x / y, 0 where y is nought."""
    return np.divide(x, y, out=np.zeros(np.broadcast(x, y).shape), where=y > 1e-12)


def fitted_albedo(image, good, a, scale, start):
    """Albedo (h, w, 3) that `a` gives `image` by (reweighted) least squares, and the weights."""
    rho, w = start, good.astype(float)
    for _ in range(ALBEDO_ROUNDS if np.any(scale > 0) else 1):
        w = good.astype(float) if rho is None else weights(rho * a - image, good, scale)
        squares = (w * a * a).sum(axis=0)
        rho = ratio((w * a * image).sum(axis=0), squares)
        rho = np.where(squares > 1e-12, np.maximum(rho, LEAST_ALBEDO), 0)
    return rho, w


def freed(derivative, a, w):
    """Derivatives (..., N, h, w, 3) of residuals, the albedo following: less their share along a.

    To the last digit what the weighted least squares fit of a new albedo takes up.
    """
    share = ratio((w * derivative * a).sum(axis=-4), (w * a * a).sum(axis=0))
    return derivative - share[..., None, :, :, :] * a


@dataclass
class Plain:
    """The fields of an Linearization; residuals, and those of one channel of every other pixel.

    light_slope, gloss_slope, ambient_direction_slope : None where they were not asked for
    """

    albedo: np.ndarray
    energy: float
    jtwj: np.ndarray
    rhs: np.ndarray
    residuals: np.ndarray
    counted: np.ndarray
    mean_abs_residual: np.ndarray
    light_slope: np.ndarray | None
    gloss_slope: np.ndarray | None
    ambient_direction_slope: np.ndarray | None


def one_channel(shape):
    """(h, w, 3) one channel of every other pixel, of each equally often."""
    row, column = np.indices(shape)
    return (row + column)[..., None] % 6 == 2 * np.arange(3)


def light_slopes(photographs, surface, lights, rho, residual, w):
    """Half the energy's derivatives: lights (N, C, 8), gloss (3,), ambient direction (3,)."""
    by_shading, by_highlight = shading_by_light(photographs, surface, lights, 8, True)
    turned = rho * by_shading + by_highlight
    turned = (w * turned * residual).sum(axis=(1, 2, 3, 4))
    own = 8 * lights.ambient.size
    gloss_slope = turned[own:-3] if lights.gloss.any() else np.zeros(3)
    return turned[:own].reshape(*lights.ambient.shape, 8), gloss_slope, turned[-3:]


def linearize(
    photographs, surface, lights, *, scale=0.0, start=None, lagged=False, project=True,
    with_light_slope=False,
):  # fmt: skip
    """Albedo, energy and depth terms of one pass: `Photographs.linearize`."""
    scale = np.asarray(scale, dtype=float)
    image, good = decoded(photographs)
    image = image - highlight_of(photographs, surface, lights)
    a = shading_of(photographs, surface, lights)
    rho, w = fitted_albedo(image, good, a, scale, start)
    residual = rho * a - image
    wide = np.broadcast_to(scale, good.shape[1:3])[..., None]
    loss = wide**2 * np.log1p((residual / wide) ** 2) if np.all(scale > 0) else residual**2

    by_shading, by_highlight = shading_by_gradient(photographs, surface, lights, lagged)
    J = rho * by_shading + by_highlight
    rhs = -(w * J * residual).sum(axis=(1, -1))
    if project:
        J = freed(J, a, w)
    pairs = ((0, 0), (0, 1), (1, 1))
    turned = None, None, None
    if with_light_slope:
        own = weights(residual, good, scale)
        turned = light_slopes(photographs, surface, lights, rho, residual, own)
    return Plain(
        albedo=rho,
        energy=float(loss[good].sum()),
        jtwj=np.stack([(w * J[k] * J[m]).sum(axis=(0, -1)) for k, m in pairs], axis=-1),
        rhs=np.moveaxis(rhs, 0, -1),
        residuals=residual[good],
        counted=residual[good & one_channel(photographs.mask.shape)],
        mean_abs_residual=ratio((abs(residual) * good).sum(axis=(0, -1)), good.sum(axis=(0, -1))),
        light_slope=turned[0],
        gloss_slope=turned[1],
        ambient_direction_slope=turned[2],
    )


def light_terms(
    photographs, surface, lights, albedo, *, scale=0.0, numbers=4, project=True, subsampling=1,
    mixed=False, ambient_direction=False,
):  # fmt: skip
    """Derivatives of half the energy with the lights: `Photographs.light_terms`."""
    image, good = decoded(photographs)
    image = image - highlight_of(photographs, surface, lights)
    thin = np.s_[::subsampling, ::subsampling]
    some = np.zeros(photographs.mask.shape, bool)
    some[thin] = True
    good = good & some[..., None]
    a = shading_of(photographs, surface, lights)
    residual = albedo * a - image
    w = weights(residual, good, np.asarray(scale, dtype=float))

    by_shading, by_highlight = shading_by_light(
        photographs, surface, lights, numbers, ambient_direction
    )
    B = albedo * by_shading + by_highlight
    by_shading, by_highlight = shading_by_gradient(photographs, surface, lights, lagged=False)
    J = albedo * by_shading + by_highlight
    slope = (w * B * residual).sum(axis=(1, 2, 3, 4))
    if project:
        B, J = freed(B, a, w), freed(J, a, w)
    rows = B.reshape(len(B), -1)
    hessian = (w.ravel() * rows) @ rows.T
    both = np.einsum("gnhwc,knhwc->hwgk", w * J, B)[thin]
    return hessian, slope, both if mixed else both[:0, :0]


def halved(photographs):
    """Values (N, ceil(h/2), ceil(w/2), 3) uint16 and mask of the photographs at half the size."""
    count, height, width, _ = photographs.values.shape
    values = np.zeros((count, -(-height // 2), -(-width // 2), 3), np.uint16)
    mask = np.zeros(values.shape[1:3], bool)
    for row, column in np.ndindex(height // 2, width // 2):
        block = np.s_[2 * row : 2 * row + 2, 2 * column : 2 * column + 2]
        mask[row, column] = photographs.mask[block].all()
        codes = photographs.values[:, *block].reshape(count, 4, 3)
        usable = (codes >= photographs.low) & (codes <= photographs.high)
        mean = np.rint(65535 * photographs.table[codes].astype(float).mean(axis=1))
        values[:, row, column] = np.where(usable.all(axis=1), np.clip(mean, 1, 65534), 0)
    return values, mask

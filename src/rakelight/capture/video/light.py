"""What light explains of the frames, and what does not fit: an arm, a hand, the lamp itself.

Pictures of a matte object under any light are sums of a few, three and a bit (Shashua 1997): a
basis is fitted robustly.  Shadows and highlights do not fit it either.  They lie between a
pixel's darkest value and its fit, or beyond the fit towards white, whatever the paint; and frames
under a similar light have them, too.  What stands before the object does neither.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from rakelight.capture.recording import evenly
from rakelight.capture.video.frames import Frames
from rakelight.model import MAD_TO_SIGMA, Array, Floats, Mask

# Pictures in the basis, and frames at least for each of them.
RANK, FRAMES_EACH = 5, 4
# Frames from which the basis is fitted; rounds of the fit.
BASIS_FRAMES, ROUNDS = 240, 8
# Least width of the robust weights, over a pixel's brightness.
NARROWEST = 0.02
# Longest side, pixels, of the pictures that are compared.
SIDE_PX = 48
# Linear light above which a pixel may hold saturated values.
BRIGHTEST = 0.9
# Least brightness of a pixel that a deviation is relative to, over the object's median.
FLOOR = 0.15
# Quantile of a pixel's values that is its shadow's.
DARKEST = 0.02
# Frames under a similar light that a frame is compared to: near in time, which may show the same
# arm, and others; what is near in time, frames.
NEAR, FAR, NEAR_FRAMES = 3, 9, 15
# Frames of the most similar light whose distance says how near in light others are.
ALIKE = 15
# How far beyond the range of their values a frame's may lie, over the range: where the light is
# like no other frame's, shadows and highlights are elsewhere.  With 2 and 0.1 for
# `judging.UNEXPLAINED` half as many good frames count as covered as with 0 and 0.2, and as many
# with an arm do (25 of the clips on which that was chosen).
RANGES = 2.0


@dataclass(frozen=True)
class Explained:
    """What N frames are by light alone.

    coefficients : (N, R) in an orthonormal basis: of two frames of equal brightness, the length of
        the difference is the rms difference of their pictures over the brightness
    unexplained : (N, h, w) what does not fit any light, over the pixel's brightness; 0 outside the
        object
    mask : (h, w) where the object is
    brightness : (N,) by which the frames were divided, linear light
    """

    coefficients: Floats
    unexplained: Floats
    mask: Mask
    brightness: Floats


def explained(frames: Frames) -> Explained:
    """The frames by light alone; `unexplained` is 0 where there are too few frames to tell."""
    pictures, mask = _compared(frames)
    values = pictures[:, mask]  # (N, P, 3)
    count = len(values)
    brightness = np.maximum(np.median(values, axis=(1, 2)), 1e-4).astype(np.float32)
    usable = values < BRIGHTEST
    darkest = np.quantile(values[evenly(count, BASIS_FRAMES)], DARKEST, axis=0).astype(np.float32)
    values = values / brightness[:, None, None]
    own = np.median(values[evenly(count, BASIS_FRAMES)], axis=0)
    own = np.maximum(own, FLOOR * (float(np.median(own)) or 1.0))  # 0 of mostly black pictures
    relative = (values / own).reshape(count, -1)
    rank = max(min(RANK, count // FRAMES_EACH), 1)
    use = usable.reshape(count, -1).astype(np.float32)
    coefficients, basis = _robust_basis(relative, use, rank)
    turn = np.asarray(np.linalg.qr(basis.T.astype(np.float64), mode="r")).T / np.sqrt(
        basis.shape[1]
    )
    lights = coefficients @ turn
    unexplained = np.zeros((count, *mask.shape), np.float32)
    if count >= FRAMES_EACH * RANK:
        grey = own.mean(axis=-1, keepdims=True)
        fit = (coefficients @ basis).reshape(values.shape) * own
        off = _off_light(values / grey, darkest / grey, fit / grey, brightness)
        off *= _unlike_others((values - fit) / grey, lights)
        unexplained[:, mask] = np.sqrt(off) * usable.all(axis=-1)
        unexplained = _smoothed(unexplained, mask)
    return Explained(lights, unexplained, mask, brightness)


def _compared(frames: Frames) -> tuple[Floats, Mask]:
    """(N, h, w, 3) pictures that are smaller again, and (h, w) the object in them."""
    height, width = frames.mask.shape
    ratio = min(1.0, SIDE_PX / max(height, width))
    size = max(round(ratio * width), 1), max(round(ratio * height), 1)

    def smaller(image: Floats) -> Floats:
        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))

    share = smaller(frames.mask.astype(np.float32))
    mask = share > min(0.9, 0.9 * float(share.max()))
    return np.stack([smaller(each) for each in frames.small]), mask


def _off_light(values: Floats, darkest: Floats, fit: Floats, brightness: Floats) -> Floats:
    """(N, P) how far values (N, P, 3) are from any that shadow or highlight makes of their fit.

    darkest : (P, 3) of all frames, before the frames were divided by their brightness (N,)
    """
    off = np.empty(values.shape[:2], np.float32)
    for k, (value, lit) in enumerate(zip(values, fit, strict=True)):
        dark = np.minimum(darkest / brightness[k], np.maximum(lit, 0))
        way = lit - dark
        length2 = np.maximum(np.einsum("pc,pc->p", way, way), 1e-6)
        fraction = np.clip(np.einsum("pc,pc->p", value - dark, way) / length2, 0, 1)
        in_shadow = np.linalg.norm(value - dark - fraction[:, None] * way, axis=-1)
        specular = np.maximum((value - lit).mean(axis=-1), 0)
        in_highlight = np.linalg.norm(value - lit - specular[:, None], axis=-1)
        off[k] = np.minimum(in_shadow, in_highlight)
    return off


def _unlike_others(residual: Floats, lights: Floats) -> Floats:
    """(N, P) how far residuals (N, P, 3) are from those of frames under a similar light.

    Of those the lowest and the highest do not count, nor does what `RANGES` allow.
    """
    off = np.empty(residual.shape[:2], np.float32)
    for k, own in enumerate(residual):
        alike = np.sort(residual[similar(lights, k, NEAR, FAR, NEAR_FRAMES)], axis=0)
        allowed = RANGES * (alike[-2] - alike[1])
        beyond = np.maximum(np.maximum(own - alike[-2], alike[1] - own) - allowed, 0)
        off[k] = np.linalg.norm(beyond, axis=-1) / np.sqrt(3)
    return off


def similar(lights: Floats, frame: int, near: int, far: int, near_frames: int) -> Array:
    """The frames whose light (N, R) is most like that of one: some near it in time, some not.

    Where there are too few of either, others make up for them: a light is not known from three.

    >>> similar(np.array([[0.0], [3], [1], [2]]), 0, 1, 2, 2).tolist()
    [1, 2, 3]
    >>> similar(np.array([[0.0], [3], [1], [2]]), 0, 1, 2, 9).tolist()
    [2, 3, 1]
    """
    order = np.argsort(np.linalg.norm(lights - lights[frame], axis=1), kind="stable")
    order = order[order != frame]
    beside = np.abs(order - frame) < near_frames
    some = np.concatenate([order[beside][:near], order[~beside][:far]])
    others = order[~np.isin(order, some)]
    return np.concatenate([some, others[: near + far - len(some)]])


def unlike(lights: Floats) -> Floats:
    """(N,) how far the light (N, R) of each frame is from the `ALIKE` most like it, their median.

    >>> unlike(np.array([[0.0], [0.1], [3.1]])).round(2).tolist()
    [1.6, 1.55, 3.05]
    """
    if len(lights) < 2:
        return np.zeros(len(lights))
    away = [
        np.median(np.linalg.norm(lights[similar(lights, i, 0, ALIKE, 1)] - lights[i], axis=1))
        for i in range(len(lights))
    ]
    return np.array(away)


def _smoothed(maps: Floats, mask: Mask) -> Floats:
    """(N, h, w) means of 3 x 3 pixels of the mask."""
    share = np.maximum(cv2.blur(mask.astype(np.float32), (3, 3)), 1e-6)
    return np.stack([np.where(mask, cv2.blur(each, (3, 3)) / share, 0) for each in maps])


def _robust_basis(values: Floats, usable: Floats, rank: int) -> tuple[Floats, Floats]:
    """Coefficients (N, R) and pictures (R, P) whose product is most of `values` (N, P).

    Reweighted least squares with the weights of Geman and McClure (1987), for frames and pixels in
    turn.  usable : (N, P) 1 or 0
    """
    some = evenly(len(values), BASIS_FRAMES)
    sample, use = values[some], usable[some]
    _, vectors = np.linalg.eigh((sample * use) @ (sample * use).T)
    basis = vectors[:, ::-1][:, :rank].T @ (sample * use) / np.sqrt(np.float32(len(sample)))
    weight, scale = use, 1.0
    for _ in range(ROUNDS):
        coefficients = _fitted(sample, basis, weight)
        off = np.abs(sample - coefficients @ basis)
        typical = float(np.median(off[use > 0])) if use.any() else 0.0
        scale = max(2 * MAD_TO_SIGMA * typical, NARROWEST, 0.6 * scale)
        weight = use / (1 + (off / scale) ** 2) ** 2
        basis = _fitted(sample.T, coefficients.T, weight.T).T
    weight = usable
    for _ in range(ROUNDS):
        coefficients = _fitted(values, basis, weight)
        weight = usable / (1 + (np.abs(values - coefficients @ basis) / scale) ** 2) ** 2
    return coefficients, basis


def _fitted(values: Floats, basis: Floats, weight: Floats) -> Floats:
    """(N, R) coefficients of each row of values (N, P) in a basis (R, P), with weights (N, P)."""
    rank = len(basis)
    products = (basis[:, None] * basis[None]).reshape(rank * rank, -1)
    normal = (weight @ products.T).reshape(-1, rank, rank).astype(np.float64)
    right = ((weight * values) @ basis.T).astype(np.float64)
    damping = 1e-6 * np.trace(normal, axis1=1, axis2=2) / rank + 1e-12
    normal += damping[:, None, None] * np.eye(rank)
    return np.asarray(np.linalg.solve(normal, right[..., None])[..., 0], np.float32)

"""Whether given lights are those of the photographs.

The prepared depth's normals are shaded twice: under the given lights, and under the distant lights
that explain the photographs best.  Both are given every light's intensity and ambient part and an
albedo.  A sensor smooths relief, and steeper lights make up for that, so the given ones may have
all slopes steeper by one factor.  The lights found have freedom besides, but no more than two
numbers of each photograph: where they explain more than twice the shading, and blocks of pixels
agree about it (`evidence`), the given ones are of another order, frame, unit or capture.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rakelight.capture.lights import too_far
from rakelight.check.depth_orientation import evidence
from rakelight.check.evidence import LIKELY
from rakelight.errors import listed
from rakelight.geometry.camera import back_project
from rakelight.model import Array, Finding, Floats, GivenLights, Lights, photograph_names
from rakelight.photometry.forward import arriving, least_squares_albedo, shadings
from rakelight.pipeline.held_back import Sample, lights_of, sampled
from rakelight.prepare import Prepared
from rakelight.solve.robust import ROUNDS

CODE = "given-lights-wrong"
# Factors of all slopes that are tried, the relief's over the prepared depth's.  With the first
# alone 4 of 120 right lists of lights are called wrong: of steps and bars, which sensors smooth.
STEEPER = (1.0, 1.5, 2.0, 3.0, 5.0, 8.0)
# Largest share of what lights found explain, that wrong ones explain.  Of 60 random captures (300
# to 359) none is warned of, neither with exact lights nor with 5 degrees of error; of 438 wrong
# lists of lights 345 are.  At 0.6 two of the 60 are (docs/results/random-captures.md).
MOST_EXPLAINED = 0.5
# Least share of it that lights explain whose mistake is mended.
MENDED_EXPLAINED = 0.8
# Pixels that are looked at: with 4000 as many lists of lights are called wrong.
PIXELS = 1500
# Angle, degrees, from the light found beyond which a light is named.
NAMED_DEG = 20.0
METRES = "they fit divided by 1000: positions are metres"
# What mistakes make of vectors (N, 3), and the advice that mends them.
MENDED: dict[str, Callable[[Floats], Floats]] = {
    "they fit with x turned round (x is right here)": lambda each: each * [-1, 1, 1],
    "they fit with y turned round (y is down here)": lambda each: each * [1, -1, 1],
    "they fit with x and y exchanged": lambda each: each[:, [1, 0, 2]],
    "they fit in reverse order": lambda each: each[::-1],
    METRES: lambda each: each / 1000,
}
REMEDY = (
    "check that they are of this capture and in the photographs' order, and their axes (x right, "
    "y down, z away from the camera)"
)


def wrong_lights(prepared: Prepared) -> tuple[Finding, ...]:
    """A warning where the given lights explain the photographs much worse than others do."""
    given = prepared.lights
    if given is None or len(prepared) < 3:
        return ()
    sample, normals = sampled(prepared, PIXELS)
    if not sample.good.any():
        return ()
    points_m = sample.of(back_project(prepared.depth_m, prepared.camera))
    flat = float(_unexplained(sample, np.ones((len(given), len(points_m)))).sum())
    lights = lights_of(sample, normals)
    free = _squares(sample, shadings(normals, points_m, lights))
    # Rivals, and what the given lights may leave unexplained beside them.
    rivals = [(free, flat - MOST_EXPLAINED * (flat - float(free.sum())))]
    object_m = float(np.linalg.norm(points_m.mean(axis=0)))
    if given.positions_m is not None and too_far(given.positions_m, object_m):
        nearer = _of_given(sample, normals, points_m, _mended(given, MENDED[METRES]))
        rivals.append((nearer, float(nearer.sum())))
    enough = min(most for _, most in rivals)
    before = _of_given(sample, normals, points_m, given, enough)
    where = np.zeros(prepared.mask.shape, dtype=bool)
    where.flat[sample.chosen] = True
    light = np.maximum((sample.good * sample.images**2).sum(axis=(0, 2)), np.finfo(float).tiny)
    if not any(
        before.sum() > most and evidence(before / light, rival / light, where) >= LIKELY
        for rival, most in rivals
    ):
        return ()
    fits = flat - MENDED_EXPLAINED * (flat - float(free.sum()))
    after = {
        float(_of_given(sample, normals, points_m, _mended(given, mended)).sum()): advice
        for advice, mended in MENDED.items()
        if advice != METRES or given.positions_m is not None
    }
    remedy = after[min(after)] if min(after) <= fits else REMEDY
    off_deg = angles_deg(_seen(given, points_m).direction[:, 0], lights.direction[:, 0])
    named = photograph_names(prepared.names, len(prepared))
    explained = [1 - float(each.sum()) / flat for each in (before, free)]
    message = (
        f"the given lights are not those of the photographs: they explain {explained[0]:.0%} of "
        f"the shading, lights found from it {explained[1]:.0%}, {np.median(off_deg):.0f} degrees "
        f"away (the median); those of {listed(named, off_deg > NAMED_DEG)}"
    )
    return (Finding("warning", CODE, message, remedy),)


def _mended(given: GivenLights, mended: Callable[[Floats], Floats]) -> GivenLights:
    if given.positions_m is None:
        return GivenLights(directions=mended(np.asarray(given.directions)))
    return GivenLights(positions_m=mended(given.positions_m))


def _seen(given: GivenLights, points_m: Floats) -> Lights:
    """Lights of intensity 1 at the middle of points (P, 3)."""
    middle_m = points_m.mean(axis=0)
    nothing = np.zeros((len(given), 1))
    if given.positions_m is None:
        return Lights(np.asarray(given.directions)[:, None], nothing)
    away = given.positions_m - middle_m
    length = np.maximum(np.linalg.norm(away, axis=1, keepdims=True), np.finfo(float).tiny)
    return Lights((away / length)[:, None], nothing, given.positions_m[:, None], middle_m)


def _of_given(
    sample: Sample, normals: Floats, points_m: Floats, given: GivenLights, enough: float = 0.0
) -> Floats:
    """(P,) squared error under given lights, of the slopes' factor that makes it least.

    enough : sum at which no further factor is tried
    """
    toward = arriving(_seen(given, points_m), points_m)[:, :, 0]
    best = np.full(len(points_m), np.inf)
    for steeper in STEEPER:
        steep = normals * [steeper, steeper, 1.0]
        steep /= np.linalg.norm(steep, axis=1, keepdims=True)
        cosine = np.maximum(np.einsum("npk,pk->np", toward, steep), 0)
        best = min(best, _unexplained(sample, cosine), key=lambda each: float(each.sum()))
        if best.sum() <= enough:
            break
    return best


def _unexplained(sample: Sample, cosine: Floats) -> Floats:
    """(P,) squared error of a sample whose lights have these cosines (N, P) at its pixels.

    The intensity and ambient part of every light and the albedo are those that fit best.
    """
    images, good = sample.images, sample.good
    albedo = np.sum(good * images, axis=0) / np.maximum(good.sum(axis=0), 1)
    shade: Floats = cosine[..., None]
    for _ in range(ROUNDS):
        squares = (good * albedo**2).sum(axis=2)
        products = (good * albedo * images).sum(axis=2)
        both = [_intensity(*each) for each in zip(cosine, squares, products, strict=True)]
        intensity, ambient = np.array(both).T[..., None]
        shade = (intensity * cosine + ambient)[..., None]
        albedo, _ = least_squares_albedo(zip(images, good, shade, strict=True))
    return _squares(sample, shade)


def _intensity(cosine: Floats, squares: Floats, products: Floats) -> tuple[float, float]:
    """Intensity and ambient part, neither negative, of a light with cosines (P,).

    squares, products : (P,) sums over channels of albedo^2, and of albedo times light
    """
    one, both, two = (float((squares * cosine**k).sum()) for k in (2, 1, 0))
    right, ambient_right = float(products @ cosine), float(products.sum())
    determinant = one * two - both**2
    if determinant > 1e-9 * one * two:
        intensity = (two * right - both * ambient_right) / determinant
        ambient = (one * ambient_right - both * right) / determinant
        if intensity >= 0 and ambient >= 0:
            return intensity, ambient
        if intensity < 0:
            return 0.0, ambient_right / two
    return right / max(one, np.finfo(float).tiny), 0.0


def _squares(sample: Sample, shade: Floats) -> Floats:
    """(P,) squared error of a sample with shading (N, P, C), summed over photographs, channels."""
    albedo, _ = least_squares_albedo(zip(sample.images, sample.good, shade, strict=True))
    return np.asarray((sample.good * (sample.images - albedo * shade) ** 2).sum(axis=(0, 2)))


def angles_deg(one: Floats, other: Floats) -> Array:
    """(...) degrees between unit vectors (..., 3)."""
    return np.asarray(np.degrees(np.arccos(np.clip((one * other).sum(axis=-1), -1, 1))))

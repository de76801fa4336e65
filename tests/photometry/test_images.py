"""The compiled passes over photographs: against plain numpy, against finite differences, laws."""

from dataclasses import replace

import numba
import numpy as np
import pytest

from rakelight.geometry.grid import has_gradient
from rakelight.jit import limited_threads
from rakelight.model import MAD_TO_SIGMA, Camera
from rakelight.photometry import _kernels
from rakelight.photometry.forward import arriving
from rakelight.photometry.images import LightParameters, Photographs, Surface
from rakelight.prepare.linear import linear_table, usable
from rakelight.solve.robust import CAUCHY, SMALLEST_NOISE, cauchy_scales
from tests.photometry import plain_photographs as plain

HEIGHT, WIDTH, COUNT = 11, 13, 5
CAMERA = Camera(WIDTH, HEIGHT, fx=30.0, fy=34.0, cx=5.5, cy=4.2)


def ragged(height=HEIGHT, width=WIDTH, seed=3):
    """A mask with holes, and with pixels that have no normal."""
    mask = np.random.default_rng(seed).random((height, width)) < 0.85
    mask[2] = False
    mask[0, :] = mask[1, :] = False
    mask[0, 3:8] = True
    return mask


def some_surface(height=HEIGHT, width=WIDTH, seed=0):
    """Slopes of up to a few times 45 degrees; points 10 cm across."""
    rng = np.random.default_rng(seed)
    gradient = 0.02 * rng.normal(size=(height, width, 2))
    row, column = np.mgrid[:height, :width]
    points = np.stack([column / width - 0.5, row / height - 0.5, rng.random(row.shape)], axis=-1)
    return Surface(gradient, 0.1 * points)


def some_lights(
    channels=1, near=False, seed=1, count=COUNT, gloss=(0.0, 0.0, 0.0), beam=False, uneven=False
):
    """Oblique enough for attached shadows; of one distance or all at infinity.

    Beams change the light by up to a third across the points.
    uneven : whether the ambient light comes from one side
    """
    rng = np.random.default_rng(seed)
    vector = rng.normal(size=(count, channels, 3)) * [0.35, 0.35, 0.1] - [0, 0, 0.5]
    ambient = rng.uniform(0.02, 0.12, (count, channels))
    inverse_distance = rng.uniform(0.5, 3, ambient.shape) if near else np.zeros_like(ambient)
    beams = rng.uniform([-5, -5, 20], [5, 5, 60], (*ambient.shape, 3)) if beam else None
    direction = np.array([-0.7, 0.2, -0.6]) if uneven else np.zeros(3)
    return LightParameters(vector, ambient, inverse_distance, np.array(gloss), beams, direction)


def seen(surface, lights, camera=CAMERA, seed=2):
    """Linear light (N, h, w, 3) that the model predicts for a random albedo, and the albedo."""
    dark = Photographs(
        np.zeros((len(lights.vector), *camera.shape, 3), np.uint16), np.zeros(65536, np.float32),
        0, 0, np.ones(camera.shape, bool), camera,
    )  # fmt: skip
    albedo = np.random.default_rng(seed).uniform(0.2, 0.9, (*camera.shape, 3))
    light = albedo * plain.shading_of(dark, surface, lights)
    return light + plain.highlight_of(dark, surface, lights), albedo


def taken(light, dtype=np.uint16, encoding="linear", mask=None, camera=CAMERA):
    """Photographs of linear light (N, h, w, 3), encoded and rounded to the values of `dtype`.

    In 16 bit, as methods hold all photographs: kernels would be compiled for another type.
    """
    table = linear_table(np.dtype(dtype), encoding)
    values = np.abs(np.searchsorted(table, np.clip(light, 0, 1), side="left"))
    values = np.minimum(values, len(table) - 1).astype(np.uint16)
    white = len(table) - 1
    low, high = int(0.004 * white) + 1, int(np.ceil(0.98 * white)) - 1
    return Photographs(values, table, low, high, ragged() if mask is None else mask, camera)


def faulty(lights, dtype=np.uint16, encoding="linear", noise=0.02):
    """Noisy photographs with a tenth of the values black or saturated, and a pixel all black."""
    surface = some_surface()
    light, _ = seen(surface, lights)
    rng = np.random.default_rng(4)
    light += noise * rng.standard_t(3, light.shape)
    light = np.where(rng.random(light.shape) < 0.1, rng.choice([0.0, 1.0], light.shape), light)
    light[:, 6, 6] = 0
    return taken(light, dtype, encoding), surface


KINDS = {
    "white": {},
    "near": {"near": True},
    "coloured": {"channels": 3},
    "coloured near": {"channels": 3, "near": True},
    "beam": {"beam": True},
    "coloured near beam": {"channels": 3, "near": True, "beam": True},
    "uneven": {"uneven": True},
    "coloured near uneven": {"channels": 3, "near": True, "uneven": True},
}
GLOSS = (0.1, 0.05, 0.2)
GLOSSY = {
    "glossy": {"gloss": GLOSS},
    "glossy near": {"gloss": GLOSS, "near": True},
    "glossy coloured near": {"gloss": GLOSS, "channels": 3, "near": True},
    "glossy near beam": {"gloss": GLOSS, "near": True, "beam": True},
    "glossy near uneven": {"gloss": GLOSS, "near": True, "uneven": True},
}
SCALES = {
    "plain": 0.0,
    "robust": np.random.default_rng(9).uniform(0.01, 0.1, (HEIGHT, WIDTH)),
}


@pytest.fixture(params=KINDS)
def lights(request):
    return some_lights(**KINDS[request.param])


@pytest.fixture(params=KINDS | GLOSSY)
def any_lights(request):
    return some_lights(**(KINDS | GLOSSY)[request.param])


def close(found, expected, glossy=False):
    """Equal to rounding, relative to the largest; light less a highlight has 24 bits."""
    worst = 3e-6 if glossy else 1e-8
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=worst * np.abs(expected).max())


# ---- against plain numpy


@pytest.mark.parametrize("project", [True, False])
@pytest.mark.parametrize("lagged", [True, False])
@pytest.mark.parametrize("scale", SCALES)
def test_linearize_is_the_plain_pass(any_lights, scale, lagged, project):
    lights, glossy = any_lights, any_lights.gloss.any()
    photographs, surface = faulty(lights)
    how = {"scale": SCALES[scale], "lagged": lagged, "project": project}
    found = photographs.linearize(surface, lights, **how)
    expected = plain.linearize(photographs, surface, lights, **how)
    close(found.albedo, expected.albedo, glossy)
    close(found.jtwj, expected.jtwj, glossy)
    close(found.rhs, expected.rhs, glossy)
    close(found.mean_abs_residual, expected.mean_abs_residual, glossy)
    rounding = 1e-6 if glossy else 1e-12
    assert found.energy == pytest.approx(expected.energy, rel=rounding)
    assert found.rms == pytest.approx(np.sqrt(np.mean(expected.residuals**2)), rel=rounding)
    assert found.observations == len(expected.residuals)
    # the histogram's bins are 0.5 / 1024 wide
    robust = MAD_TO_SIGMA * np.median(np.abs(expected.counted))
    assert found.noise_sigma == pytest.approx(robust, abs=MAD_TO_SIGMA * 0.5 / 1024)
    assert found.noise_sigma > 5 * MAD_TO_SIGMA * 0.5 / 1024


@pytest.mark.parametrize("scale", [0.03, SCALES["robust"]])
def test_linearize_goes_on_from_an_albedo(lights, scale):
    photographs, surface = faulty(lights)
    start = np.random.default_rng(5).uniform(0, 1, (HEIGHT, WIDTH, 3))
    before = start.copy()
    found = photographs.linearize(surface, lights, scale=scale, start=start)
    expected = plain.linearize(photographs, surface, lights, scale=scale, start=start)
    np.testing.assert_array_equal(start, before)
    close(found.albedo, expected.albedo)
    close(found.rhs, expected.rhs)
    other = photographs.linearize(surface, lights, scale=scale)
    assert np.abs(found.albedo - other.albedo).max() > 1e-4


@pytest.mark.parametrize(("dtype", "encoding"), [(np.uint8, "srgb"), (np.uint16, "srgb")])
def test_photographs_of_all_kinds(dtype, encoding):
    lights = some_lights()
    photographs, surface = faulty(lights, dtype, encoding)
    found = photographs.linearize(surface, lights, scale=0.03)
    expected = plain.linearize(photographs, surface, lights, scale=0.03)
    close(found.albedo, expected.albedo)
    close(found.jtwj, expected.jtwj)
    read = photographs.values.astype(dtype)
    assert found.observations == usable(read)[:, photographs.active].sum()
    mine = photographs.light_terms(surface, lights, found.albedo, scale=0.03, mixed=True)
    theirs = plain.light_terms(photographs, surface, lights, found.albedo, scale=0.03, mixed=True)
    for each, other in zip(mine, theirs, strict=True):
        close(each, other)


def test_maps_of_any_order_in_memory_are_taken_by_the_same_kernel():
    photographs, surface = faulty(some_lights())
    found = photographs.linearize(surface, some_lights())
    compiled = len(_kernels.linearize.dispatcher.signatures)
    turned = Surface(np.asfortranarray(surface.gradient), np.asfortranarray(surface.points))
    other = photographs.linearize(turned, some_lights())
    assert len(_kernels.linearize.dispatcher.signatures) == compiled
    np.testing.assert_array_equal(found.jtwj, other.jtwj)


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize(
    ("numbers", "mixed", "subsampling", "project"),
    [(4, False, 3, True), (5, True, 1, True), (4, True, 2, False), (8, True, 1, True)],
)
def test_light_terms_are_the_plain_ones(any_lights, scale, numbers, mixed, subsampling, project):
    lights, glossy = any_lights, any_lights.gloss.any()
    photographs, surface = faulty(lights)
    albedo = photographs.linearize(surface, lights, scale=SCALES[scale]).albedo
    how = {"scale": SCALES[scale], "numbers": numbers, "project": project}
    uneven = bool(lights.ambient_direction.any())
    how |= {"subsampling": subsampling, "mixed": mixed, "ambient_direction": uneven}
    found = photographs.light_terms(surface, lights, albedo, **how)
    expected = plain.light_terms(photographs, surface, lights, albedo, **how)
    for each, other in zip(found, expected, strict=True):
        assert each.shape == other.shape
        if each.size:
            close(each, other, glossy)


@pytest.mark.parametrize("scale", SCALES)
def test_lights_turn_as_in_the_plain_pass(any_lights, scale):
    lights, glossy = any_lights, any_lights.gloss.any()
    photographs, surface = faulty(lights)
    found = photographs.linearize(
        surface, lights, scale=SCALES[scale], with_light_slope=True, ambient_direction=True
    )
    expected = plain.linearize(
        photographs, surface, lights, scale=SCALES[scale], with_light_slope=True
    )
    close(found.light_slope, expected.light_slope, glossy)
    close(found.gloss_slope, expected.gloss_slope, glossy)
    close(found.ambient_direction_slope, expected.ambient_direction_slope, glossy)
    still = photographs.linearize(surface, lights, scale=SCALES[scale])
    assert still.light_slope is None
    assert still.ambient_direction_slope is None
    along = photographs.linearize(surface, lights, scale=SCALES[scale], with_light_slope=True)
    close(along.light_slope, expected.light_slope, glossy)
    assert (along.ambient_direction_slope is None) == (not lights.ambient_direction.any())
    assert still.energy == found.energy


@pytest.mark.parametrize("most", [1, 5, 20, 1000])
def test_some_are_those_of_a_stride(most):
    photographs, _ = faulty(some_lights())
    subsampling, active = photographs.subsampling(most), photographs.active
    expected = np.zeros_like(active)
    expected[::subsampling, ::subsampling] = active[::subsampling, ::subsampling]
    some = photographs.subsample(most)
    np.testing.assert_array_equal(some, expected)
    assert some.any()
    assert (subsampling == 1) == (most == 1000)


def test_a_stride_that_meets_no_pixel_is_none():
    mask = np.zeros((9, 9), bool)
    mask[1:3] = True
    light = np.full((2, 9, 9, 3), 0.5)
    photographs = taken(light, mask=mask, camera=replace(CAMERA, height=9, width=9))
    assert photographs.subsampling(1) == 1
    np.testing.assert_array_equal(photographs.subsample(1), mask)


@pytest.mark.parametrize(("dtype", "encoding"), [(np.uint8, "srgb"), (np.uint16, "linear")])
@pytest.mark.parametrize("shape", [(11, 13), (8, 6), (2, 2), (5, 1)])
def test_halved_is_the_mean_in_linear_light(dtype, encoding, shape):
    rng = np.random.default_rng(6)
    camera = replace(CAMERA, height=shape[0], width=shape[1])
    mask = rng.random(shape) < 0.9
    light = np.clip(rng.normal(0.5, 0.3, (3, *shape, 3)), 0, 1)
    photographs = taken(light, dtype, encoding, mask, camera)
    small = photographs.halved()
    values, small_mask = plain.halved(photographs)
    # a mean that lies between two values may fall to either
    assert np.abs(small.values.astype(int) - values).max() <= 1
    np.testing.assert_array_equal(small.values == 0, values == 0)
    np.testing.assert_array_equal(small.mask, small_mask)
    assert (small.camera.height, small.camera.width) == small.mask.shape
    used = (small.values >= small.low) & (small.values <= small.high)
    np.testing.assert_array_equal(used, values > 0)


def test_halved_sees_the_same_rays():
    small = taken(np.full((1, HEIGHT, WIDTH, 3), 0.5)).halved()
    for pixel, centre in ((0, 0.5), (3, 6.5)):
        ray = (
            (pixel - small.camera.cx) / small.camera.fx,
            (pixel - small.camera.cy) / small.camera.fy,
        )
        here = (centre - CAMERA.cx) / CAMERA.fx, (centre - CAMERA.cy) / CAMERA.fy
        assert ray == pytest.approx(here, rel=1e-12)


def test_halved_twice_as_light_is_halved_as_light():
    light = np.full((1, 4, 4, 3), 0.25)
    light[:, ::2] = 0.75
    mask, camera = np.ones((4, 4), bool), replace(CAMERA, height=4, width=4)
    small = taken(light, mask=mask, camera=camera).halved().halved()
    assert small.values.shape == (1, 1, 1, 3)
    np.testing.assert_allclose(small.values / 65535, 0.5, atol=2e-5)


# ---- against finite differences


def converged_albedo(photographs, surface, lights, scale):
    """The linearization with the albedo that the loss has at rest."""
    found = photographs.linearize(surface, lights, scale=scale)
    for _ in range(60):
        found = photographs.linearize(surface, lights, scale=scale, start=found.albedo)
    return found


@pytest.mark.parametrize("scale", [0.0, 0.05])
def test_vector_is_the_derivative_of_the_energy(lights, scale):
    photographs, surface = faulty(lights, noise=0.01)
    found = converged_albedo(photographs, surface, lights, scale)
    lag = photographs.linearize(surface, lights, scale=scale, start=found.albedo, lagged=True)
    direction = np.random.default_rng(7).normal(size=surface.gradient.shape)

    def energy(step):
        moved = replace(surface, gradient=surface.gradient + step * direction)
        return converged_albedo(photographs, moved, lights, scale).energy

    step = 1e-7
    slope = (energy(step) - energy(-step)) / (2 * step)
    assert -2 * (found.rhs * direction).sum() == pytest.approx(slope, rel=1e-5)
    assert -2 * (lag.rhs * direction).sum() != pytest.approx(slope, rel=1e-3)


@pytest.mark.parametrize("scale", [0.0, 0.05])
@pytest.mark.parametrize("numbers", [4, 5, 8])
def test_slope_is_the_derivative_of_half_the_energy(lights, scale, numbers):
    photographs, surface = faulty(lights, noise=0.01)
    found = converged_albedo(photographs, surface, lights, scale)
    _, slope, _ = photographs.light_terms(
        surface, lights, found.albedo, scale=scale, numbers=numbers, mixed=True
    )
    along = photographs.linearize(
        surface, lights, scale=scale, start=found.albedo, with_light_slope=True
    )
    shape, near = (*lights.ambient.shape, numbers), numbers > 4
    direction = np.random.default_rng(8).normal(size=shape)
    if near and not lights.inverse_distance.any():
        direction[..., 3] = np.abs(direction[..., 3])  # none is farther than infinity

    def energy(step):
        return converged_albedo(photographs, surface, moved(lights, step * direction), scale).energy

    step = 1e-6
    if near and not lights.inverse_distance.any():  # one-sided, second order
        difference = (-3 * energy(0) + 4 * energy(step) - energy(2 * step)) / (2 * step)
    else:
        difference = (energy(step) - energy(-step)) / (2 * step)
    assert 2 * (slope * direction.ravel()).sum() == pytest.approx(difference, rel=1e-5)
    if numbers == 8:
        slope = along.light_slope.ravel()
        assert 2 * (slope * direction.ravel()).sum() == pytest.approx(difference, rel=1e-5)


def moved(lights, step):
    """As LightParameters.moved, without its bounds."""
    inverse_distance = lights.inverse_distance + (step[..., 3] if step.shape[-1] > 4 else 0)
    return replace(
        lights, vector=lights.vector + step[..., :3], ambient=lights.ambient + step[..., -1],
        inverse_distance=inverse_distance,
        beam=lights.beams + step[..., 4:7] if step.shape[-1] > 5 else lights.beam,
    )  # fmt: skip


@pytest.mark.parametrize(
    "kind", ["white", "near", "coloured", "glossy near", "beam", "uneven", "glossy near uneven"]
)
def test_second_derivatives_are_exact_at_a_perfect_fit(kind):
    # Without residuals Gauss-Newton is Newton: with depth and lights moved together, the energy
    # is the quadratic form of tensor, mixed terms and Hessian, the albedo following.
    lights, surface = some_lights(**(KINDS | GLOSSY)[kind]), some_surface()
    light, _ = seen(surface, lights)
    lights = replace(lights, gloss=0.7 * lights.gloss)
    photographs = taken(0.7 * light, mask=np.ones((HEIGHT, WIDTH), bool))
    found = photographs.linearize(surface, lights)
    assert found.rms < 2e-5
    numbers = 8 if "beam" in kind else 5 if "near" in kind else 4
    hessian, _, mixed = photographs.light_terms(
        surface, lights, found.albedo, numbers=numbers, mixed=True,
        ambient_direction="uneven" in kind,
    )  # fmt: skip
    rng = np.random.default_rng(10)
    q = 3e-3 * rng.normal(size=(*lights.ambient.shape, numbers))
    q[..., 4 : numbers - 1] *= 30  # of b, 1/metre, and w, 1/metre^2
    q[..., -1] = np.abs(q[..., -1])
    k = np.append(q, 3e-3 * rng.normal(size=3)) if lights.gloss.any() else q.ravel()
    k = np.append(k, 3e-2 * rng.normal(size=3)) if "uneven" in kind else k
    g = 4e-4 * np.sign(mixed @ k)  # where the mixed term is large
    M = found.jtwj
    depth = M[..., 0] * g[..., 0] ** 2 + 2 * M[..., 1] * g[..., 0] * g[..., 1]
    depth = (depth + M[..., 2] * g[..., 1] ** 2).sum()
    light_part, both = k @ hessian @ k, 2 * (g * (mixed @ k)).sum()
    assert min(depth, light_part, both) > 0.1 * (depth + light_part)
    for s, t in ((1, 0), (0, 1), (1, 1), (1, -1)):
        there = replace(surface, gradient=surface.gradient + s * g)
        gloss = lights.gloss
        if gloss.any():
            gloss = gloss + t * k[q.size : q.size + 3]
        lamps = replace(moved(lights, t * q), gloss=gloss)
        if "uneven" in kind:
            lamps = replace(lamps, ambient_direction=lights.ambient_direction + t * k[-3:])
        energy = photographs.linearize(there, lamps).energy
        form = s * s * depth + s * t * both + t * t * light_part
        assert energy == pytest.approx(form, rel=0.03)


# ---- laws


@pytest.mark.parametrize("scale", [0.01, 0.05])
def test_reweighting_never_raises_the_energy(lights, scale):
    photographs, surface = faulty(lights)
    rng = np.random.default_rng(11)
    albedo = rng.uniform(0, 1, (HEIGHT, WIDTH, 3))
    image, good = plain.decoded(photographs)
    residual = albedo * plain.shading_of(photographs, surface, lights) - image
    energies = [scale**2 * np.log1p((residual[good] / scale) ** 2).sum()]
    for _ in range(8):
        found = photographs.linearize(surface, lights, scale=scale, start=albedo)
        energies.append(found.energy)
        albedo = found.albedo
    assert energies[1] < 0.9 * energies[0]
    assert (np.diff(energies) <= 1e-12 * energies[0]).all()


@pytest.mark.parametrize("scale", [0.0, 0.03])
def test_brighter_lights_and_a_darker_albedo_are_the_same(any_lights, scale):
    lights, glossy = any_lights, any_lights.gloss.any()
    photographs, surface = faulty(lights)
    start = np.full((HEIGHT, WIDTH, 3), 0.5)
    one = photographs.linearize(surface, lights, scale=scale, start=start)
    two = photographs.linearize(surface, lights.brighter(3.0), scale=scale, start=start / 3)
    assert two.energy == pytest.approx(one.energy, rel=1e-6 if glossy else 1e-11)
    close(two.albedo, one.darker(3.0).albedo, glossy)
    close(two.jtwj, one.jtwj, glossy)
    close(two.rhs, one.rhs, glossy)
    # and so the energy does not change along that direction
    hessian, slope, _ = photographs.light_terms(surface, lights, one.albedo)
    along = np.concatenate([lights.vector, lights.ambient[..., None]], axis=-1).ravel()
    if not lights.inverse_distance.any() and not glossy:
        assert np.abs(hessian @ along).max() < 1e-9 * np.abs(hessian).max()
    if not scale and not glossy:
        assert abs(slope @ along) < 1e-9 * np.abs(slope).max()


def test_a_pixel_only_counts_where_it_is_usable(lights):
    photographs, surface = faulty(lights)
    values = photographs.values.copy()
    bad = (values < photographs.low) | (values > photographs.high)
    assert bad.mean() > 0.05
    values[bad] = np.where(values[bad] > 30000, photographs.high + 1, photographs.low - 1)
    values[:, ~photographs.active] = 12345
    other = replace(photographs, values=values)
    one, two = (each.linearize(surface, lights, scale=0.03) for each in (photographs, other))
    for name in ("albedo", "energy", "jtwj", "rhs", "rms", "noise_sigma", "mean_abs_residual"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    black = (slice(None), 6, 6)
    assert bad[black].all()
    assert not one.albedo[6, 6].any()
    assert not one.jtwj[6, 6].any()
    assert one.mean_abs_residual[6, 6] == 0


def test_the_noise_is_never_nought(lights):
    surface = some_surface()
    exact = taken(seen(surface, lights)[0], mask=np.ones((HEIGHT, WIDTH), bool))
    assert SMALLEST_NOISE <= exact.linearize(surface, lights).noise_sigma < 1e-3
    none_usable = replace(exact, low=1, high=0).linearize(surface, lights)
    scales = cauchy_scales(none_usable.noise_sigma, none_usable.mean_abs_residual)
    np.testing.assert_allclose(scales, CAUCHY * SMALLEST_NOISE, rtol=1e-12)


def test_pixels_without_a_normal_say_nothing(lights):
    photographs, surface = faulty(lights)
    off = ~has_gradient(photographs.mask)
    assert (photographs.mask & off).any()
    found = photographs.linearize(surface, lights)
    for field in (found.albedo, found.jtwj, found.rhs, found.mean_abs_residual):
        assert not field[off].any()


def test_tensors_are_positive_semidefinite(lights):
    photographs, surface = faulty(lights)
    for count in (1, 2, COUNT):
        few = replace(photographs, values=np.ascontiguousarray(photographs.values[:count]))
        part = LightParameters(
            lights.vector[:count], lights.ambient[:count], lights.inverse_distance[:count]
        )
        uu, uv, vv = np.moveaxis(few.linearize(surface, part).jtwj, -1, 0)
        assert (uu >= 0).all()
        assert (vv >= 0).all()
        assert (uv**2 <= uu * vv * (1 + 1e-12)).all()


def test_one_photograph_says_nothing_of_the_depth_once_the_albedo_is_free():
    lights = some_lights(count=1)
    light, _ = seen(some_surface(), lights)
    photographs = taken(light)
    free = photographs.linearize(some_surface(), lights)
    held = photographs.linearize(some_surface(), lights, project=False)
    assert np.abs(free.jtwj).max() < 1e-9 * np.abs(held.jtwj).max()


def test_lights_far_away_are_distant_lights():
    photographs, surface = faulty(some_lights())
    found = {}
    for inverse_distance in (0.0, 1e-6, 0.5):
        lights = replace(some_lights(), inverse_distance=np.full((COUNT, 1), inverse_distance))
        linearization = photographs.linearize(surface, lights)
        terms = photographs.light_terms(
            surface, lights, linearization.albedo, numbers=5, mixed=True
        )
        found[inverse_distance] = (
            linearization.albedo,
            linearization.energy,
            linearization.jtwj,
            *terms,
        )
    for far, distant, close_by in zip(found[1e-6], found[0.0], found[0.5], strict=True):
        np.testing.assert_allclose(far, distant, atol=1e-5 * np.abs(distant).max())
        assert np.abs(np.subtract(close_by, distant)).max() > 1e-4 * np.abs(distant).max()


def test_a_near_lamp_obeys_the_inverse_square_law():
    # Straight above two facing pixels, one twice as far away: a quarter of the light.
    camera = Camera(2, 2, fx=1.0, fy=1.0, cx=0.5, cy=0.5)
    points = np.zeros((2, 2, 3))
    points[:, 1, 2] = 0.5  # behind the middle; the lamp is half a metre before it
    lights = LightParameters(np.array([[[0, 0, -0.8]]]), np.zeros((1, 1)), np.array([2.0]))
    surface = Surface(np.zeros((2, 2, 2)), points)
    light = np.full((1, 2, 2, 3), 0.5)
    albedo = (
        taken(light, mask=np.ones((2, 2), bool), camera=camera).linearize(surface, lights).albedo
    )
    np.testing.assert_allclose(albedo[:, 1], 4 * albedo[:, 0], rtol=1e-10)
    np.testing.assert_allclose(albedo[:, 0], 0.5 / 0.8, rtol=1e-4)


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="one core has one order")
def test_the_same_numbers_on_one_core_and_on_two():
    height, width = 70, 80  # enough to be shared
    camera = replace(CAMERA, height=height, width=width, fx=150.0, fy=170.0)
    lights, surface = some_lights(near=True), some_surface(height, width)
    light, _ = seen(surface, lights, camera)
    mask = ragged(height, width)
    photographs = taken(light, mask=mask, camera=camera)
    assert len(photographs) * mask.size > 1 << 14
    results = []
    for threads in (1, 2):
        with limited_threads(threads):
            found = photographs.linearize(surface, lights, scale=0.01, with_light_slope=True)
            terms = photographs.light_terms(surface, lights, found.albedo, numbers=5, mixed=True)
            terms = (*terms, found.light_slope)
            small = photographs.halved().values
            results.append((found.albedo, found.energy, found.rms, found.jtwj, *terms, small))
    for one, two in zip(*results, strict=True):
        np.testing.assert_array_equal(one, two)


# ---- lights


def test_near_lights_have_their_positions():
    vector = np.array([[[0.0, 0.0, -2.0]], [[3.0, 0.0, -4.0]]])
    lights = LightParameters(vector, np.zeros((2, 1)), np.array([[2.0], [0.5]]))
    physical = lights.as_lights(np.array([0.1, 0.2, 0.8]))
    expected = [[[0.1, 0.2, 0.8 - 0.5]], [[0.1 + 2 * 0.6, 0.2, 0.8 - 2 * 0.8]]]
    np.testing.assert_allclose(physical.position_m, expected, rtol=1e-12)
    np.testing.assert_allclose(physical.distance_m, [[0.5], [2.0]], rtol=1e-12)
    np.testing.assert_array_equal(physical.vector, vector)


def test_distant_lights_have_none_and_a_dark_lamp_is_no_trouble():
    vector = np.array([[[0.0, 0.0, -2.0]], [[0.0, 0.0, 0.0]]])
    assert (
        LightParameters.distant(vector, np.zeros((2, 1))).as_lights(np.zeros(3)).position_m is None
    )
    lights = LightParameters(vector, np.zeros((2, 1)), np.array([[2.0], [0.0]])).as_lights(
        np.zeros(3)
    )
    assert np.isfinite(lights.position_m).all()
    np.testing.assert_allclose(lights.position_m[0], [[0, 0, -0.5]])


@pytest.mark.parametrize("near", [True, False])
def test_lights_with_beams_send_what_the_kernels_say(near):
    lights, surface = some_lights(near=near, channels=3, beam=True), some_surface()
    middle_m = np.array([0.1, -0.2, 0.7])
    stated = arriving(lights.as_lights(middle_m), surface.points.reshape(-1, 3) + middle_m)
    for i, c in np.ndindex(lights.ambient.shape):
        place, beam = lights.inverse_distance[i, c], lights.beam[i, c]
        s = plain.light_at(lights.vector[i, c], place, surface.points, beam)
        np.testing.assert_allclose(s.reshape(-1, 3), stated[i, :, c], rtol=1e-12)


def test_a_beam_is_that_of_a_gaussian_around_where_it_is_aimed():
    # All but a factor of the point alone, which the albedo takes up.
    rng, sigma = np.random.default_rng(3), 0.04
    points, toward = rng.normal(0, 0.03, (50, 3)), rng.normal(size=(4, 1, 3))
    toward /= np.linalg.norm(toward, axis=-1, keepdims=True)
    aims = rng.normal(0, 0.01, (4, 3))
    aims -= (aims * toward[:, 0]).sum(axis=-1, keepdims=True) * toward[:, 0]
    points[:, 2] = 0.0
    off = points - aims[:, None]
    across2 = (off**2).sum(axis=-1) - (off * toward).sum(axis=-1) ** 2
    gaussian = np.exp(-across2 / (2 * sigma**2))
    beam = np.concatenate([aims[:, :2] / sigma**2, np.full((4, 1), 0.5 / sigma**2)], axis=-1)
    lights = LightParameters(toward, np.zeros((4, 1)), np.zeros((4, 1)), beam=beam[:, None])
    sent = np.linalg.norm(arriving(lights.as_lights(np.zeros(3)), points), axis=-1)[..., 0]
    paint = gaussian / sent
    paint /= np.mean(paint, axis=1, keepdims=True)
    np.testing.assert_allclose(paint, np.broadcast_to(paint[0], paint.shape), rtol=1e-10)
    assert np.ptp(gaussian / gaussian.mean(axis=1, keepdims=True), axis=0).max() > 0.5


@pytest.mark.parametrize("channels", [1, 3])
def test_positions_are_where_the_light_comes_from(channels):
    # The lamp that as_lights names sends what the kernels say: along P - X, with 1 / |P - X|^2.
    lights, surface = some_lights(near=True, channels=channels), some_surface()
    physical = lights.as_lights(np.zeros(3))
    stated = arriving(physical, surface.points.reshape(-1, 3))
    for i, c in np.ndindex(lights.ambient.shape):
        s = plain.light_at(lights.vector[i, c], lights.inverse_distance[i, c], surface.points)
        position = physical.position_m[i, c]
        toward = position - surface.points
        strength = np.linalg.norm(lights.vector[i, c]) * (position**2).sum()
        law = strength * toward / np.linalg.norm(toward, axis=-1, keepdims=True) ** 3
        np.testing.assert_allclose(s, law, rtol=1e-12)
        np.testing.assert_allclose(s.reshape(-1, 3), stated[i, :, c], rtol=1e-12)


def test_moved_beams():
    lights = some_lights(beam=True)
    step = 10 * np.random.default_rng(12).normal(size=(COUNT, 1, 8))
    step[0, 0, 6] = -100
    there = lights.moved(step)
    np.testing.assert_array_equal(there.beam[..., :2], (lights.beam + step[..., 4:7])[..., :2])
    assert there.beam[0, 0, 2] == 0
    np.testing.assert_allclose(there.beam[1:, ..., 2], (lights.beam + step[..., 4:7])[1:, ..., 2])
    assert lights.moved(step[..., :5]).beam is lights.beam
    np.testing.assert_allclose(lights.moved(there.numbers - lights.numbers).beam, there.beam)


def test_moved_lights():
    lights = some_lights(near=True)
    step = np.random.default_rng(12).normal(size=(COUNT, 1, 5))
    step[0, 0, 3] = -9
    there = lights.moved(step)
    np.testing.assert_array_equal(there.vector, lights.vector + step[..., :3])
    np.testing.assert_array_equal(
        there.inverse_distance, np.maximum(lights.inverse_distance + step[..., 3], 0)
    )
    np.testing.assert_array_equal(there.ambient, np.maximum(lights.ambient + step[..., 4], 0))
    assert (there.ambient == 0).any()
    assert (there.inverse_distance == 0).any()
    np.testing.assert_array_equal(
        lights.moved(step[..., :4]).inverse_distance, lights.inverse_distance
    )


# ---- which pixels


def test_some_pixels_are_about_so_many():
    mask = np.ones((200, 300), bool)
    mask[:40] = False
    camera = replace(CAMERA, height=200, width=300)
    photographs = taken(np.full((1, 200, 300, 3), 0.5), mask=mask, camera=camera)
    for most in (100, 3000, 20_000):
        some = photographs.subsample(most)
        assert not (some & ~photographs.active).any()
        assert most / 1.5 < some.sum() < 2.6 * most
    np.testing.assert_array_equal(photographs.subsample(10**6), photographs.active)


def test_some_pixels_of_a_thin_object_are_not_none():
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[5:7] = True
    photographs = taken(np.full((1, HEIGHT, WIDTH, 3), 0.5), mask=mask)
    assert photographs.subsample(1).any()


@pytest.mark.parametrize("gloss", [(0.0, 0.0, 0.0), (0.1, 0.2, 0.3)])
def test_one_compiled_version_serves_every_call(gloss):
    # A read-only scale or a strided light would each compile the kernel once more: seconds.
    lights = replace(some_lights(), gloss=np.array(gloss))
    photographs, surface = faulty(lights)
    albedo = photographs.linearize(surface, lights).albedo
    photographs.light_terms(surface, lights, albedo)
    before = versions()
    joined = np.concatenate([lights.vector, lights.ambient[..., None]], axis=-1)
    distant = LightParameters.distant(joined[..., :3], joined[..., 3])
    strided = replace(distant, gloss=lights.gloss)
    for scale in (0.03, np.full((HEIGHT, WIDTH), 0.03)):
        photographs.linearize(surface, strided, scale=scale, start=albedo)
        photographs.light_terms(surface, strided, albedo, scale=scale)
    assert before == versions()


def versions():
    """How many times each of the large kernels was compiled."""
    return [
        len(getattr(_kernels, name).dispatcher.signatures)
        for name in ("linearize", "light_terms", "linearize_glossy", "light_terms_glossy")
    ]

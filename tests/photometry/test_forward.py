"""The image model and its inverses: light given albedo, albedo given light."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from rakelight.model import Lights
from rakelight.photometry.forward import lit, shading, shadings
from rakelight.photometry.lighting import HORIZON_ROUNDS, estimate_light, frontal_lights

FRONTAL = np.array([0.0, 0.0, -1.0])


def cap(count=400, seed=0, widest_deg=80):
    """Unit normals (P, 3) facing the camera, evenly over a cap around the optical axis."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(np.cos(np.radians(widest_deg)), 1, count)
    azimuth, r = rng.uniform(0, 2 * np.pi, count), np.sqrt(1 - z**2)
    return np.stack([r * np.cos(azimuth), r * np.sin(azimuth), -z], axis=-1)


def paint(count=400, channels=3, seed=1):
    return np.random.default_rng(seed).uniform(0.1, 1, (count, channels))


def toward(tilt_deg, azimuth_deg, intensity=1.0):
    tilt, azimuth = np.radians([tilt_deg, azimuth_deg])
    sin = np.sin(tilt)
    return intensity * np.array([sin * np.cos(azimuth), sin * np.sin(azimuth), -np.cos(tilt)])


def photograph(normals, albedo, vector, ambient):
    """The image model written out pixel by pixel."""
    shades = [max(0.0, float(np.dot(n, vector))) + ambient for n in normals]
    return albedo * np.array(shades)[:, None]


def render(normals, albedo, lights, i):
    """(P, 3) photograph i of the forward model."""
    return albedo * shadings(normals, np.zeros_like(normals), lights)[i]


# ---- rendering


def test_render_is_the_model_pixel_by_pixel():
    normals, albedo, vector = cap(), paint(), toward(50, 30, 0.7)
    lights = Lights(vector=vector[None, None], ambient=np.array([[0.08]]))
    expected = photograph(normals, albedo, vector, 0.08)
    np.testing.assert_allclose(render(normals, albedo, lights, 0), expected, rtol=1e-14)


def test_coloured_lights_act_on_their_channel():
    normals, albedo = cap(), paint()
    vectors = np.stack([toward(40, azimuth) for azimuth in (0, 120, 240)])
    lights = Lights(vector=vectors[None], ambient=np.array([[0.1, 0.2, 0.3]]))
    image = render(normals, albedo, lights, 0)
    for c in range(3):
        alone = photograph(normals, albedo, vectors[c], 0.1 * (c + 1))[:, c]
        np.testing.assert_allclose(image[:, c], alone, rtol=1e-14)


@settings(deadline=None)
@given(factor=st.floats(0.01, 10), tilt=st.floats(0, 89), azimuth=st.floats(0, 360))
def test_brightness_is_linear_in_albedo_and_in_light(factor, tilt, azimuth):
    normals, albedo, vector = cap(50), paint(50), toward(tilt, azimuth)
    lights = Lights(vector[None, None], np.array([[0.2]]))
    scaled = Lights(factor * vector[None, None], np.array([[factor * 0.2]]))
    image = render(normals, albedo, lights, 0)
    np.testing.assert_allclose(render(normals, factor * albedo, lights, 0), factor * image)
    np.testing.assert_allclose(
        render(normals, albedo, scaled, 0), factor * image, rtol=1e-12, atol=1e-15
    )


def test_lights_add_where_all_of_them_shine():
    normals, a, b = cap(widest_deg=30), toward(40, 0), toward(40, 200, 0.5)
    assert lit(normals, a).all()
    assert lit(normals, b).all()
    both = shading(normals, a + b, 0.3)
    np.testing.assert_allclose(both, shading(normals, a, 0.1) + shading(normals, b, 0.2))


def test_lights_do_not_add_across_attached_shadows():
    normals, a, b = cap(), toward(70, 0), toward(70, 180)
    assert (~lit(normals, a)).any()
    difference = shading(normals, a, 0) + shading(normals, b, 0) - shading(normals, a + b, 0)
    assert difference.max() > 0.1


def test_attached_shadow_sees_ambient_light_only():
    normals, vector = cap(), toward(75, 100, 3.0)
    dark = ~lit(normals, vector)
    assert 20 < dark.sum() < 380
    np.testing.assert_array_equal(shading(normals, vector, 0.25)[dark], 0.25)
    assert (shading(normals, vector, 0.25)[~dark] > 0.25).all()


def test_without_a_lamp_nothing_is_lit():
    assert not lit(cap(), np.zeros(3)).any()


# ---- light


@pytest.mark.parametrize(("tilt_deg", "azimuth_deg"), [(0, 0), (25, 70), (50, 200), (65, 330)])
@pytest.mark.parametrize("ambient", [0.0, 0.15])
def test_exact_light_from_a_clean_photograph(tilt_deg, azimuth_deg, ambient):
    # From a frontal start: pixels in attached shadow are found along the way.
    normals, albedo = cap(), paint()
    vector = toward(tilt_deg, azimuth_deg, 0.8)
    image = photograph(normals, albedo, vector, ambient)
    ones = np.ones(image.shape)
    start = FRONTAL
    for _ in range(6):
        light = estimate_light(image, ones, albedo, normals, start)
        start = light[:3]
    np.testing.assert_allclose(light, [*vector, ambient], atol=1e-10)


@pytest.mark.parametrize("tilt_deg", [0, 20, 35])
def test_one_call_suffices_for_the_usual_lamp(tilt_deg):
    normals, albedo, vector = cap(), paint(), toward(tilt_deg, 250, 0.8)
    image = photograph(normals, albedo, vector, 0.1)
    light = estimate_light(image, np.ones(image.shape), albedo, normals, FRONTAL)
    np.testing.assert_allclose(light, [*vector, 0.1], atol=1e-9)


def test_a_start_at_the_solution_stays_there():
    normals, albedo, vector = cap(), paint(), toward(75, 10, 2.0)
    image = photograph(normals, albedo, vector, 0.1)
    light = estimate_light(image, np.ones(image.shape), albedo, normals, vector)
    np.testing.assert_allclose(light, [*vector, 0.1], atol=1e-11)


def test_where_all_is_lit_it_is_ordinary_least_squares():
    normals, albedo = cap(widest_deg=20), paint()
    rng = np.random.default_rng(3)
    weight = rng.uniform(0, 2, albedo.shape)
    image = photograph(normals, albedo, toward(20, 10), 0.2) + 0.02 * rng.normal(size=albedo.shape)
    rows = np.concatenate([normals, np.ones((len(normals), 1))], axis=1)
    matrix = (rows[:, None] * albedo[..., None]).reshape(-1, 4)
    root = np.sqrt(weight).ravel()
    expected = np.linalg.lstsq(matrix * root[:, None], image.ravel() * root, rcond=None)[0]
    assert expected[3] > 0
    light = estimate_light(image, weight, albedo, normals, FRONTAL)
    np.testing.assert_allclose(light, expected, rtol=1e-6)


@pytest.mark.parametrize("kind", [float, bool])
def test_weight_nought_leaves_a_value_out(kind):
    normals, albedo, vector = cap(), paint(), toward(30, 40)
    image = photograph(normals, albedo, vector, 0.1)
    rng = np.random.default_rng(4)
    weight = rng.random(image.shape) < 0.5
    spoilt = np.where(weight, image, 1e6 * rng.random(image.shape))
    light = estimate_light(spoilt, weight.astype(kind), albedo, normals, vector)
    np.testing.assert_allclose(light, [*vector, 0.1], atol=1e-9)
    all_of_them = estimate_light(spoilt, np.ones(image.shape), albedo, normals, vector)
    assert np.abs(all_of_them - light).max() > 1


def test_ambient_light_is_never_negative():
    # Darker than the model allows: the best plain fit has negative ambient light.
    normals, albedo, vector = cap(widest_deg=30), paint(), toward(20, 40)
    image = np.maximum(photograph(normals, albedo, vector, 0.0) - 0.3 * albedo, 0)
    light = estimate_light(image, np.ones(image.shape), albedo, normals, FRONTAL)
    assert light[3] == 0
    # and the rest is the best without it
    matrix = (normals[:, None] * albedo[..., None]).reshape(-1, 3)
    best = np.linalg.lstsq(matrix, image.ravel(), rcond=None)[0]
    np.testing.assert_allclose(light[:3], best, rtol=1e-6)


def plain_light(image, weight, albedo, normals, vector):
    """The same by dense least squares, value by value, where these determine the light."""
    for _ in range(HORIZON_ROUNDS):
        basis = np.column_stack([normals * lit(normals, vector)[:, None], np.ones(len(normals))])
        rows = (np.sqrt(weight) * albedo)[..., None] * basis[:, None]
        rows, values = rows.reshape(-1, 4), (np.sqrt(weight) * image).ravel()
        assume(np.linalg.cond(rows) < 1e3)
        light = np.linalg.lstsq(rows, values, rcond=None)[0]
        if light[3] < 0:
            light = np.append(np.linalg.lstsq(rows[:, :3], values, rcond=None)[0], 0.0)
        vector = light[:3]
    return light


@settings(deadline=None)
@given(seed=st.integers(0, 10_000))
def test_light_from_any_values_is_that_of_dense_least_squares(seed):
    rng = np.random.default_rng(seed)
    normals, albedo = cap(30, seed), rng.random((30, 3))
    image, weight = rng.random((30, 3)), rng.random((30, 3)) < 0.5
    light = estimate_light(image, weight, albedo, normals, FRONTAL)
    assert np.isfinite(light).all()
    assert light[3] >= 0
    np.testing.assert_allclose(
        light, plain_light(image, weight, albedo, normals, FRONTAL), atol=1e-9
    )


def test_equal_normals_give_the_smallest_light_that_explains_them():
    # n = (0, 0, -1) everywhere: only a - s_z counts, shared evenly by the minimum norm.
    normals, albedo = np.tile(FRONTAL, (50, 1)), paint(50)
    image = 0.6 * albedo
    light = estimate_light(image, np.ones(image.shape), albedo, normals, FRONTAL)
    np.testing.assert_allclose(light, [0, 0, -0.3, 0.3], atol=1e-12)


@pytest.mark.parametrize("what", ["nothing usable", "black albedo", "black photograph"])
def test_no_information_gives_no_light(what):
    normals, albedo = cap(), paint()
    image, weight = photograph(normals, albedo, FRONTAL, 0.1), np.ones(albedo.shape)
    if what == "nothing usable":
        weight = np.zeros(albedo.shape, bool)
    elif what == "black albedo":
        albedo = np.zeros(albedo.shape)
    else:
        image = np.zeros(image.shape)
    light = estimate_light(image, weight, albedo, normals, FRONTAL)
    np.testing.assert_allclose(light, 0, atol=1e-12)


def test_frontal_lights_shine_from_the_camera():
    lights = frontal_lights(3)
    assert lights.vector.shape == (3, 1, 3)
    np.testing.assert_array_equal(lights.direction, np.broadcast_to(FRONTAL, (3, 1, 3)))
    np.testing.assert_array_equal(lights.ambient, np.zeros((3, 1)))


def test_render_then_estimate():
    # With the true albedo the lights come back.
    normals, albedo = cap(), paint()
    vectors = np.stack([toward(30, azimuth, 0.5 + azimuth / 500) for azimuth in range(0, 360, 60)])
    lights = Lights(vector=vectors[:, None], ambient=np.linspace(0.02, 0.2, 6)[:, None])
    ones = np.ones(albedo.shape)
    for i in range(6):
        image = render(normals, albedo, lights, i)
        light = estimate_light(image, ones, albedo, normals, FRONTAL)
        np.testing.assert_allclose(light, [*vectors[i], lights.ambient[i, 0]], atol=1e-9)

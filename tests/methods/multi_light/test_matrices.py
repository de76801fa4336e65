"""The steps' matrices beside the energy that they are to lower.

Where nothing is left unexplained, Gauss-Newton's matrix is the energy's own: half the second
difference of the energy along a direction is the direction's quadratic form.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from rakelight.methods.multi_light.energy import depth_system, evaluated, first_fit
from rakelight.methods.multi_light.initial_lights import lights_of_prior
from rakelight.methods.multi_light.joint_step import damped_tensor, joint_system
from rakelight.methods.multi_light.light_model import LightModel
from rakelight.photometry.images import LightParameters
from rakelight.prepare.linear import linear_table
from tests.methods.multi_light.test_energy import make_level
from tests.photometry import plain_photographs as plain

KINDS = {
    "white": (1, 0.0, 0.0, 0.0),
    "coloured": (3, 0.0, 0.0, 0.0),
    "near": (1, 2.0, 0.0, 0.0),
    "glossy": (1, 0.0, 0.7, 0.0),
    "glossy near": (1, 2.0, 0.7, 0.0),
    "beam": (1, 0.0, 0.0, 1.0),
    "coloured near beam": (3, 2.0, 0.0, 1.0),
    "near uneven": (1, 2.0, 0.0, 0.0),
    "glossy near uneven": (1, 2.0, 0.7, 0.0),
}
"""The lights' channels and inverse distance, 1/m; gloss over (0.1, 0.05, 0.2); beam over some.

Uneven: of ambient light from one side, whose direction is free.
"""


@cache
def perfect_fit(kind):
    """A level, and the fit at its prior under the lights that have made its photographs."""
    channels, inverse_distance, gloss, beam = KINDS[kind]
    level, rng = make_level(), np.random.default_rng(1)
    prior = gaussian_filter(level.prior, 1.0)
    shape = (len(level.photographs), channels)
    lights = LightParameters(
        rng.uniform(-0.2, 0.2, (*shape, 3)) - [0, 0, 0.5],
        rng.uniform(0.02, 0.1, shape),
        np.full(shape, inverse_distance),
        gloss * np.array([0.1, 0.05, 0.2]),
        beam * np.append(rng.uniform(-5, 5, (*shape, 2)), np.full((*shape, 1), 30.0), axis=-1)
        if beam
        else None,
        ambient_direction=np.array([-0.5, 0.3, -0.4]) if "uneven" in kind else np.zeros(3),
    )
    surface = level.surface(prior)
    albedo = rng.uniform(0.3, 0.9, (*level.mask.shape, 3))
    light = albedo * plain.shading_of(level.photographs, surface, lights)
    light += plain.highlight_of(level.photographs, surface, lights)
    table = linear_table(np.dtype(np.uint16), "linear")
    values = np.searchsorted(table, light).astype(np.uint16)
    photographs = replace(level.photographs, values=values, table=table, low=1, high=65534)
    level = replace(level, photographs=photographs, prior=prior, unbiased_prior=prior)
    model = LightModel(inverse_distance > 0, beam > 0, ambient_direction="uneven" in kind)
    fit = first_fit(level, prior, lights, model)
    # Least squares: a robust loss is a parabola only within its scale, here that of rounding.  The
    # sensor counts about as much as the photographs.
    fit = replace(fit, scales=0 * fit.scales, noise=0.05)
    return level, evaluated(level, fit, prior, lights)


def half_second_difference(level, fit, depth, numbers):
    """Of the energy, along a step of log depth (h, w) and of the lights' numbers (F,)."""
    energies = []
    for sign in (1, -1):
        lights = fit.model.moved(fit.lights, sign * numbers)
        energies.append(evaluated(level, fit, fit.log_depth + sign * depth, lights).energy)
    return np.mean(energies) - fit.energy


def light_direction(fit, size, seed):
    """(F,) a step of the lights that makes no channel of all brighter, nor aims all elsewhere.

    Nothing sees that.
    """
    rng = np.random.default_rng(seed)
    brighter = fit.model.own_numbers(fit.lights.brighter(2.0).numbers - fit.lights.numbers)
    step = rng.normal(size=brighter.shape)
    share = (step * brighter).sum((0, 2)) / (brighter**2).sum((0, 2))
    step, shared = step - share[:, None] * brighter, []
    if fit.model.beam:  # b, 1/metre; all have one w, 1/metre^2
        step[..., 4:6] = 10 * (step[..., 4:6] - step[..., 4:6].mean(axis=0))
        step, shared = np.delete(step, [6] if fit.model.near else [3, 6], axis=-1), [300.0]
    gloss = rng.normal(size=3) if fit.lights.gloss.any() else []
    direction = rng.normal(size=3) if fit.model.ambient_direction else []
    return size * np.concatenate([step.ravel(), shared, gloss, direction])


@pytest.mark.parametrize("kind", KINDS)
def test_without_stiffness_a_joint_steps_matrix_is_gauss_newtons(kind, monkeypatch):
    monkeypatch.setattr("rakelight.methods.multi_light.joint_step.STIFFNESS", 0.0)
    level, fit = perfect_fit(kind)
    # The matrix is without fourth differences.
    fit = evaluated(
        level, replace(fit, fourth_difference_weight=0 * fit.scales), fit.log_depth, fit.lights
    )
    system = joint_system(level, fit, 10**6, damping=0.0)
    for seed in range(3):
        numbers = light_direction(fit, 1e-4, seed)
        light_part = numbers @ system.hessian @ numbers
        # Where the mixed derivatives are large, and as much of the energy as the lights' step.
        field = np.sign(system.columns @ numbers)
        field *= np.sqrt(light_part / (field @ (system.matrix @ field)))
        depth = np.zeros(level.mask.shape)
        depth[level.mask] = field
        both = 2 * field @ (system.columns @ numbers)
        assert both > 0.1 * light_part
        for s, t in ((1, 0), (0, 1), (1, 1), (1, -1)):
            form = (s * s + t * t) * light_part + s * t * both
            expected = half_second_difference(level, fit, s * depth, t * numbers)
            assert form == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_the_steps_matrices_are_never_softer_than_the_energy_and_stiffer_where_it_is_rough(kind):
    level, fit = perfect_fit(kind)
    white = np.random.default_rng(2).normal(size=level.mask.shape)
    checkerboard = (-1.0) ** np.indices(level.mask.shape).sum(axis=0)
    of_both = joint_system(level, fit, 10**6, damping=0.0).matrix
    of_depth = depth_system(level, fit, fit.linearization.jtwj)
    over_energy = []
    for image in (3 * gaussian_filter(white, 4.0), white, checkerboard):
        step = 1e-5 * image * level.mask
        field, lights = step[level.mask], np.zeros(fit.model.jacobian(fit.lights).shape[1])
        energy = half_second_difference(level, fit, step, lights)
        forms = field @ (of_both @ field), np.vdot(step, of_depth.apply(step))
        over_energy.append([form / energy for form in forms])
    smooth, noise, board = over_energy
    assert 1 <= smooth[0] < 1.001 < smooth[1] < 1.03
    assert 1.04 < noise[0] < 1.1
    assert noise[1] > 2.5
    assert 1.1 < board[0] < 2
    assert board[1] > 5


def test_the_depth_steps_matrix_has_the_laplacian_as_it_is_in_the_energy():
    level, fit = perfect_fit("white")
    fit = replace(fit, fourth_difference_weight=0 * fit.scales)
    held = replace(fit, laplacian_weight=1e5)
    nothing = np.zeros(fit.model.jacobian(fit.lights).shape[1])
    step = 1e-5 * np.random.default_rng(2).normal(size=level.mask.shape) * level.mask
    energies, forms = [], []
    for each in (fit, held):
        here = evaluated(level, each, each.log_depth, each.lights)
        energies.append(half_second_difference(level, here, step, nothing))
        forms.append(np.vdot(step, depth_system(level, here, fit.linearization.jtwj).apply(step)))
    assert forms[1] - forms[0] == pytest.approx(energies[1] - energies[0], rel=1e-6)
    assert forms[1] > 1.5 * forms[0]


def dark_beyond(level, share):
    """The level with values in its first columns alone; (h, w) which pixels have any."""
    lit = np.indices(level.mask.shape)[1] < share * level.mask.shape[1]
    hidden = np.broadcast_to(~lit[..., None], (*lit.shape, 3))
    photographs = level.photographs.without([hidden] * len(level.photographs))
    return replace(level, photographs=photographs), lit & level.photographs.active


def test_steps_are_damped_and_lights_found_where_most_pixels_are_dark():
    level, fit = perfect_fit("white")
    dark, lit = dark_beyond(level, 0.4)
    assert 0.1 < lit.sum() / level.photographs.active.sum() < 0.5
    there = first_fit(dark, fit.log_depth, fit.lights)
    added = damped_tensor(dark, there, 1e-3) - there.linearization.jtwj
    assert (added[lit][:, [0, 2]] > 0).all()
    here = fit.linearization.typical_information()
    assert there.linearization.typical_information() > 0.5 * here
    assert (np.linalg.norm(lights_of_prior(dark).vector, axis=-1) > 0.1).all()

"""The pyramid: what halving keeps, what a level knows, when it ends."""

from dataclasses import replace

import numpy as np
import pytest

from rakelight.geometry.averaging import Averaging
from rakelight.geometry.camera import back_project
from rakelight.geometry.cells import cell_sums, interpolate
from rakelight.geometry.grid import Links, mean_gradient
from rakelight.methods.levels import (
    FILLED,
    Level,
    cut_at_measured_jumps,
    find_small_components,
    finest_level,
    held_to_measurements,
    pyramid,
)
from rakelight.model import Camera
from rakelight.prepare import Prepared, SensorDepth
from rakelight.prepare.linear import usable


def make_prepared(height=24, width=30, mask=None, factor=1, dtype=np.uint16, encoding="linear"):
    rng = np.random.default_rng(0)
    camera = Camera(width, height, fx=200.0, fy=210.0, cx=14.3, cy=11.8)
    row, column = np.mgrid[:height, :width]
    if mask is None:
        mask = np.ones((height, width), bool)
    return Prepared(
        photographs=rng.integers(0, np.iinfo(dtype).max + 1, (4, height, width, 3)).astype(dtype),
        encoding=encoding,
        mask=mask,
        depth_m=0.8 + 0.002 * column - 0.001 * row,
        sigma_m=rng.uniform(1e-3, 4e-3, (height, width)),
        measured=rng.random((height, width)) < 0.8,
        factor=factor,
        camera=camera,
        full_camera=camera,
        rows=slice(0, height),
        columns=slice(0, width),
        sensor=SensorDepth(
            np.full((-(-height // factor), -(-width // factor)), 0.8),
            np.full((-(-height // factor), -(-width // factor)), 2e-3),
            *(np.arange(-(-side // factor) + 1) * float(factor) for side in (height, width)),
        ),
    )


def ellipse(height=24, width=30):
    row, column = np.mgrid[:height, :width]
    return np.hypot((row - 11) / 10.5, (column - 14) / 13.2) < 1


# ---- cells


@pytest.mark.parametrize("cell", [1, 2, 3, 7])
@pytest.mark.parametrize("channels", [(), (3,)])
def test_cell_sums_cell_by_cell(cell, channels):
    image = np.random.default_rng(1).normal(size=(11, 14, *channels))
    sums = cell_sums(image, cell)
    assert sums.shape == (-(-11 // cell), -(-14 // cell), *channels)
    for r, c in np.ndindex(sums.shape[:2]):
        block = image[r * cell : (r + 1) * cell, c * cell : (c + 1) * cell]
        np.testing.assert_allclose(sums[r, c], block.sum(axis=(0, 1)), atol=1e-12)


@pytest.mark.parametrize("cell", [1, 2, 3, 4])
@pytest.mark.parametrize("shape", [(12, 24), (11, 14), (5, 3)])
def test_interpolation_is_linear_between_the_centres(cell, shape):
    # A plane stays one between the outermost centres, and goes on level beyond them.
    height, width = (-(-side // cell) for side in shape)
    row, column = np.mgrid[:height, :width].astype(float)
    coarse = 2.0 + 0.5 * row - 0.25 * column
    fine = interpolate(coarse, cell, shape)
    assert fine.shape == shape
    centre = [(np.arange(side) - (cell - 1) / 2) / cell for side in shape]
    r = np.clip(centre[0], 0, height - 1)[:, None]
    c = np.clip(centre[1], 0, width - 1)[None, :]
    np.testing.assert_allclose(fine, 2.0 + 0.5 * r - 0.25 * c, atol=1e-12)


@pytest.mark.parametrize("cell", [1, 2, 4])
def test_interpolation_hands_each_cell_s_value_to_as_many_pixels(cell):
    # What a cell gives out is what it covers: sums over whole images agree.
    coarse = np.zeros((6, 8))
    coarse[1:-1, 1:-1] = np.random.default_rng(2).normal(size=(4, 6))
    fine = interpolate(coarse, cell, (6 * cell, 8 * cell))
    assert fine.sum() == pytest.approx(cell**2 * coarse.sum(), rel=1e-12)
    assert np.vdot(fine, fine) <= cell**2 * np.vdot(coarse, coarse) * (1 + 1e-12)


@pytest.mark.parametrize("cell", [2, 3, 4])
def test_interpolation_has_the_slopes_of_the_correction(cell):
    # The mean gradient over the whole is 1 / cell of that per cell.
    row, column = np.mgrid[:6, :8].astype(float)
    fine = interpolate(3 * row + 5 * column, cell, (6 * cell, 8 * cell))
    u, v = mean_gradient(fine, np.ones(fine.shape, bool))
    inside = np.s_[cell:-cell, cell:-cell]
    np.testing.assert_allclose(u[inside], 5 / cell, rtol=1e-12)
    np.testing.assert_allclose(v[inside], 3 / cell, rtol=1e-12)


# ---- the finest level


@pytest.mark.parametrize("factor", [1, 2, 4])
def test_depth_pixels_share_their_precision(factor):
    # factor^2 output pixels hold one measurement of the sensor.
    prepared = make_prepared(factor=factor)
    weight = finest_level(prepared).prior_weight
    one = (prepared.depth_m / prepared.sigma_m) ** 2
    seen = prepared.measured
    np.testing.assert_allclose(weight[seen] * factor**2, one[seen], rtol=1e-12)
    np.testing.assert_allclose(weight[~seen] * factor**2, one[~seen] / 100, rtol=1e-12)
    assert FILLED == 0.01
    assert (~seen).any()


@pytest.mark.parametrize("factor", [1, 2, 4])
def test_the_sensor_sees_means_over_its_pixels(factor):
    level = finest_level(make_prepared(width=32, factor=factor))
    rng = np.random.default_rng(4)
    change = 1e-3 * rng.normal(size=level.mask.shape)
    means = change.reshape(24 // factor, factor, 32 // factor, factor).mean(axis=(1, 3))
    expected = (cell_sums(level.prior_weight, factor) * means**2).sum()
    assert level.sensor_sum_of_squares(level.prior + change) == pytest.approx(expected, rel=1e-10)
    assert level.sensor_sum_of_squares(level.prior) == 0
    # the terms of the normal equations belong to that energy: exact, as it is quadratic
    terms = level.sensor_terms(level.prior + change, 3.0)
    step = 1e-3 * rng.normal(size=level.mask.shape)
    image, rhs = terms["data_weight"] * step, terms["data_weight"] * terms["data_target"]
    if factor > 1:
        image, rhs = image + terms["extra"].apply(step), rhs + terms["extra_rhs"]
    form = (step * image).sum() - 2 * (step * rhs).sum()
    energies = [level.sensor_sum_of_squares(level.prior + change + t * step) for t in (0, 1)]
    assert form == pytest.approx(3 * (energies[1] - energies[0]), rel=1e-6)


@pytest.mark.parametrize(("factor", "averaged"), [(1, []), (2, [0]), (4, [0, 1])])
def test_levels_as_coarse_as_the_sensor_need_no_averaging(factor, averaged):
    levels = pyramid(finest_level(make_prepared(height=96, width=96, factor=factor)), 200)
    assert len(levels) > 3
    assert [k for k, level in enumerate(levels) if level.averaging is not None] == averaged
    for k in averaged:
        assert levels[k].averaging.factor == factor / 2**k


def test_the_weight_is_the_precision_of_log_depth():
    prepared = make_prepared()
    level = finest_level(prepared)
    change = np.log(prepared.depth_m + prepared.sigma_m) - level.prior
    seen = prepared.measured
    np.testing.assert_allclose((level.prior_weight * change**2)[seen], 1, rtol=6e-3)


def test_a_sensor_that_is_more_precise_than_its_model_shows_it_from_pixel_to_pixel():
    prepared = make_prepared(96, 96)
    row, column = np.mgrid[:96, :96]
    noise = np.random.default_rng(1).standard_normal(row.shape)
    plane = 0.8 + 0.002 * column - 0.001 * row

    def level(noise_m):
        sensor = replace(prepared.sensor, depth_m=plane + noise_m * noise)
        return finest_level(replace(prepared, sensor=sensor))

    assert level(4e-4).relative_noise_variance == pytest.approx(
        0.04, rel=0.1
    )  # the model's is 2 mm
    assert level(4e-3).relative_noise_variance == 1.0
    assert level(4e-4).halved().relative_noise_variance == level(4e-4).relative_noise_variance
    unseen = replace(prepared.sensor, depth_m=np.full(row.shape, np.nan))
    assert finest_level(replace(prepared, sensor=unseen)).relative_noise_variance == 1.0


def test_a_factor_multiplies_the_weight_alone():
    level = finest_level(make_prepared())
    np.testing.assert_array_equal(level.weighted(7.0).prior_weight, 7 * level.prior_weight)
    np.testing.assert_array_equal(level.weighted(7.0).prior, level.prior)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("encoding", ["linear", "srgb"])
def test_levels_use_the_values_that_prepared_calls_usable(dtype, encoding):
    prepared = make_prepared(dtype=dtype, encoding=encoding)
    photographs = finest_level(prepared).photographs
    every = np.arange(np.iinfo(dtype).max + 1).astype(dtype)
    usable_here = (every >= photographs.low) & (every <= photographs.high)
    np.testing.assert_array_equal(usable_here, usable(every))
    light, _ = prepared.pixels(1)
    np.testing.assert_array_equal(photographs.table[photographs.values[1][prepared.mask]], light)


def test_a_surface_is_seen_from_the_middle_of_the_object():
    prepared = make_prepared(mask=ellipse())
    level = finest_level(prepared)
    points = back_project(prepared.depth_m, prepared.camera)
    surface = level.surface(level.prior)
    inside = level.mask
    np.testing.assert_allclose(surface.points[inside].mean(axis=0), 0, atol=1e-12)
    np.testing.assert_allclose(surface.points[inside], (points - level.middle_m)[inside])
    u, v = mean_gradient(level.prior, inside)
    np.testing.assert_array_equal(surface.gradient, np.stack([u, v], axis=-1))


def test_what_lies_off_the_mask_does_not_matter_to_a_surface():
    level = finest_level(make_prepared(mask=ellipse()))
    other = np.where(level.mask, level.prior, 1e6)
    surface, second = level.surface(level.prior), level.surface(other)
    np.testing.assert_array_equal(surface.gradient, second.gradient)
    np.testing.assert_array_equal(surface.points[level.mask], second.points[level.mask])
    assert np.isfinite(second.points).all()


# ---- halving


@pytest.mark.parametrize("shape", [(24, 30), (23, 29), (9, 2)])
def test_halving_keeps_the_priors_weight(shape):
    level = finest_level(make_prepared(*shape))
    coarse = level.halved()
    assert coarse.prior_weight.sum() == pytest.approx(level.prior_weight.sum(), rel=1e-12)
    ragged = replace(level, photographs=replace(level.photographs, grid=ellipse(*shape)))
    inside = ragged.prior_weight[ragged.mask].sum()
    assert ragged.halved().prior_weight.sum() == pytest.approx(inside, rel=1e-12)
    # each coarse pixel on the mask has that of its four
    half = ragged.halved()
    where = half.mask
    four = cell_sums(np.where(ragged.mask, 1.0, 0.0), 2)
    assert (four[where] == 4).all()
    np.testing.assert_allclose(half.prior_weight[where], cell_sums(level.prior_weight, 2)[where])


def test_halving_takes_means_of_log_depth_on_the_mask():
    level = finest_level(make_prepared(mask=ellipse()))
    wild = replace(level, prior=np.where(level.mask, level.prior, 1e9))
    coarse = wild.halved()
    expected = cell_sums(level.prior, 2) / 4
    np.testing.assert_allclose(coarse.prior[coarse.mask], expected[coarse.mask], rtol=1e-12)
    assert np.abs(coarse.prior).max() < 1  # continued beyond
    np.testing.assert_array_equal(coarse.middle_m, level.middle_m)


def test_the_halved_surface_is_the_same_one():
    # Same place and same slopes: gradients per pixel double.
    level = finest_level(make_prepared())
    coarse = level.halved()
    fine, half = level.surface(level.prior), coarse.surface(coarse.prior)
    inside = np.s_[1:-1, 1:-1]
    doubled = cell_sums(fine.gradient, 2) / 2
    np.testing.assert_allclose(half.gradient[inside], doubled[inside], rtol=1e-3)
    middle = cell_sums(fine.points, 2) / 4
    np.testing.assert_allclose(half.points, middle, rtol=0, atol=5e-6)  # a pixel is 4e-3 wide


# ---- carrying up


def test_carried_shift_and_slope():
    level = finest_level(make_prepared(mask=ellipse()))
    coarse = level.halved()
    row, column = np.mgrid[: coarse.mask.shape[0], : coarse.mask.shape[1]]
    correction = 0.01 + 1e-3 * row - 2e-3 * column
    found = level.carried(coarse, coarse.prior + correction)
    assert found.shape == level.mask.shape
    fine_row, fine_column = np.mgrid[: level.mask.shape[0], : level.mask.shape[1]]
    smooth = interpolate(coarse.prior, 2, level.mask.shape)
    expected = smooth + 0.01 + 1e-3 * (fine_row - 0.5) / 2 - 2e-3 * (fine_column - 0.5) / 2
    inside = level.mask & (interpolate(coarse.mask.astype(float), 2, level.mask.shape) == 1)
    assert inside.sum() > 200
    np.testing.assert_allclose(found[inside], expected[inside], atol=1e-12)


def test_carried_goes_on_beyond_the_coarse_mask_as_the_prior_does():
    level = finest_level(make_prepared(mask=ellipse()))
    coarse = level.halved()
    wild = np.where(coarse.mask, coarse.prior + 0.02, 1e9)
    found = level.carried(coarse, wild)
    smooth = interpolate(coarse.prior, 2, level.mask.shape)
    np.testing.assert_allclose(found[level.mask], smooth[level.mask] + 0.02, atol=1e-12)


def test_carried_leaves_the_priors_fine_noise_behind():
    level = finest_level(make_prepared())
    checks = 0.01 * (-1.0) ** np.add.outer(range(24), range(30))
    noisy = replace(level, prior=level.prior + checks)
    coarse = noisy.halved()
    found = noisy.carried(coarse, coarse.prior)
    inside = np.s_[2:-2, 2:-2]
    assert np.abs(found - level.prior)[inside].max() < 1e-4


# ---- the pyramid


def test_pyramid_halves_down_to_so_many_pixels():
    finest = finest_level(make_prepared(96, 120))
    levels = pyramid(finest, 800)
    assert levels[0] is finest
    assert [each.mask.shape for each in levels] == [(96, 120), (48, 60), (24, 30)]
    assert np.count_nonzero(levels[-1].mask) <= 800 < np.count_nonzero(levels[-2].mask)
    assert len(pyramid(finest, 10**6)) == 1


def test_pyramid_ends_where_a_thin_object_would_be_lost():
    mask = np.zeros((96, 120), bool)
    mask[11:15] = mask[51:54] = mask[:, 41:44] = True  # three and four pixels wide
    finest = finest_level(make_prepared(96, 120, mask=mask))
    levels = pyramid(finest, 500)
    assert np.count_nonzero(levels[-1].mask) > 500
    for level in levels:
        assert np.count_nonzero(level.photographs.active) >= 500 / 16
    assert np.count_nonzero(levels[-1].halved().photographs.active) < 500 / 16


def test_levels_of_a_pyramid_explain_alike():
    # A plane under distant light looks the same at every level.
    from rakelight.photometry.images import LightParameters

    prepared = make_prepared(48, 60)
    level = finest_level(replace(prepared, photographs=np.full((4, 48, 60, 3), 20000, np.uint16)))
    lights = LightParameters.distant(np.tile([0.1, 0.2, -0.8], (4, 1, 1)), np.full((4, 1), 0.1))
    for each in pyramid(level, 200):
        assert isinstance(each, Level)
        found = each.photographs.linearize(each.surface(each.prior), lights)
        finest = level.photographs.linearize(level.surface(level.prior), lights)
        mean = found.albedo[each.photographs.active].mean()
        assert mean == pytest.approx(finest.albedo.mean(), rel=2e-3)


# ---- what the surface is held to


@pytest.mark.parametrize("factor", [1, 2])
def test_the_bias_of_smoothing_is_taken_out(factor):
    prepared = make_prepared(48, 60, factor=factor)
    slope = 0.8 + 0.002 * np.arange(60 // factor) * factor
    sensor = replace(prepared.sensor, depth_m=np.tile(slope, (48 // factor, 1)))
    flat = replace(prepared, sensor=sensor, depth_m=np.full((48, 60), 0.8))
    plain, mended = (finest_level(flat, unbiased=choice) for choice in (False, True))
    np.testing.assert_array_equal(plain.unbiased_prior, plain.prior)
    K = sensor.averaging(flat.mask)
    edge = 16 // factor
    inner = np.s_[edge:-edge, edge:-edge]
    np.testing.assert_allclose(
        K.down(mended.unbiased_prior)[inner], np.log(sensor.depth_m)[inner], atol=0.002 * 0.2
    )


def test_noise_is_not_taken_for_bias():
    prepared = make_prepared(48, 60)
    noise = np.random.default_rng(0).normal(0, 0.003, (48, 60))
    noisy = replace(prepared, sensor=replace(prepared.sensor, depth_m=prepared.depth_m + noise))
    level = finest_level(noisy, unbiased=True)
    assert np.std(level.unbiased_prior - level.prior) < 0.1 * np.std(noise / prepared.depth_m)


@pytest.mark.parametrize("factor", [1, 2])
def test_held_to_measurements_its_means_are_theirs(factor):
    prepared = make_prepared(48, 60, factor=factor)
    shape = (48 // factor, 60 // factor)
    measured = prepared.depth_m.mean() + np.random.default_rng(0).normal(0, 0.003, shape)
    measured[:4, :4] = np.nan
    prepared = replace(prepared, sensor=replace(prepared.sensor, depth_m=measured))
    smooth = finest_level(prepared, unbiased=True)
    level = held_to_measurements(smooth, prepared)
    means = np.exp(prepared.sensor.averaging(prepared.mask).down(level.unbiased_prior))
    inner = np.s_[4:-1, 4:-1]
    np.testing.assert_allclose(means[inner], measured[inner], rtol=1e-4)
    hole = np.s_[: 4 * factor, : 4 * factor]
    np.testing.assert_array_equal(level.unbiased_prior[hole], smooth.unbiased_prior[hole])


def test_parts_smaller_than_a_sensor_pixel_are_small_components():
    mask = np.ones((12, 12), bool)
    mask[:, 8] = False
    mask[6:, 9:] = False
    edges = np.arange(0.0, 15.0, 4.0)
    small_components = find_small_components(mask, Averaging.on(mask, edges, edges))
    assert 4**2 < mask[:, 9:].sum() < 5**2
    assert not small_components.any()
    edges = np.arange(0.0, 20.0, 5.0)
    small_components = find_small_components(mask, Averaging.on(mask, edges, edges))
    np.testing.assert_array_equal(small_components, mask & (np.arange(12) > 8))
    assert not find_small_components(mask, None).any()


def test_small_components_keep_to_the_prior():
    level = finest_level(make_prepared(factor=3))
    level = replace(level, small_components=np.tile(np.arange(30) > 26, (24, 1)))
    moved = level.prior + 0.01 * level.small_components
    pointwise = 1e-4 * level.prior_weight[:, 27:].sum()
    assert level.sensor_sum_of_squares(moved) > pointwise
    terms = level.sensor_terms(moved)
    np.testing.assert_allclose(terms["data_target"][:, 27:], -0.01)
    assert not terms["data_weight"][:, :27].any()


@pytest.mark.parametrize("factor", [1, 2])
def test_parts_that_floated_are_put_back_where_the_sensor_has_them(factor):
    whole = finest_level(make_prepared(factor=factor))
    weight = whole.prior_weight
    links = Links.of(whole.mask)
    right = links.right.copy()
    right[:, 13] = False
    halves = Links(whole.mask, right, links.down)
    parted = replace(whole, photographs=replace(whole.photographs, grid=halves))
    floated = whole.unbiased_prior.copy()
    floated[:, :14] += 0.05
    floated[:, 14:] -= 0.02
    np.testing.assert_allclose(parted.placed(floated), whole.unbiased_prior, atol=1e-7)
    # of one part, the mean alone is put right
    mean = np.sum(weight * (whole.unbiased_prior - floated)) / weight.sum()
    np.testing.assert_allclose(whole.placed(floated) - floated, mean, rtol=1e-6)


def test_links_are_cut_at_jumps_but_not_all_of_them():
    level = finest_level(make_prepared())
    column = np.indices(level.mask.shape)[1]
    stepped = level.cut(level.prior + np.where(column < 15, 0.0, 2.0))
    before, after = Links.of(level.grid), Links.of(stepped.grid)
    lost = before.right & ~after.right
    assert lost.any(axis=0).nonzero()[0].tolist() == [14]
    assert (after.down == before.down).all()
    everywhere = level.prior + 2.0 * (np.indices(level.mask.shape).sum(axis=0) % 2)
    assert level.cut(everywhere) is level


def test_links_are_cut_where_measurements_as_fine_as_the_photographs_jump():
    fine, coarse = make_prepared(), make_prepared(factor=2)
    carried = replace(fine, own_view=False)
    pixel_m = 0.8 / fine.camera.fx
    for prepared, jumps in ((fine, [15]), (coarse, []), (carried, [])):
        measured = prepared.sensor.depth_m
        column = np.indices(measured.shape)[1]
        noise = np.random.default_rng(0).normal(0, 0.05 * pixel_m, measured.shape)
        stepped = measured + noise + 6 * pixel_m * (column > measured.shape[1] // 2)
        prepared = replace(prepared, sensor=replace(prepared.sensor, depth_m=stepped))
        level = finest_level(prepared)
        after = cut_at_measured_jumps(level, prepared)
        lost = level.links.right & ~after.links.right
        assert lost.any(axis=0).nonzero()[0].tolist() == jumps
        assert (after.links.down == level.links.down).all()


def test_a_depth_that_is_a_jump_everywhere_keeps_its_links():
    """Without them no pixel would have a normal."""
    prepared = make_prepared()
    steep = prepared.depth_m + 2.0 * (np.indices(prepared.mask.shape).sum(axis=0) % 2)
    level = finest_level(replace(prepared, depth_m=steep), cut=True)
    assert level.photographs.active.any()

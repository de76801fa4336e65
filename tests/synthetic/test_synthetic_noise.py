import numpy as np
import pytest
from scipy.ndimage import binary_opening, gaussian_filter

from rakelight.errors import InputError
from rakelight.synthetic import DepthNoise, add_depth_noise, calibrate_noise

FLAT = np.full((400, 500), 0.8)


def noise_mm(depth, **options):
    return 1000 * (add_depth_noise(depth, DepthNoise(**options), seed=4) - depth)


def test_a_perfect_sensor_changes_nothing():
    depth = np.where(np.eye(9) > 0, np.nan, 0.8)
    assert np.array_equal(
        add_depth_noise(depth, DepthNoise()), depth.astype(np.float32), equal_nan=True
    )


@pytest.mark.parametrize("length", [0.0, 3.0, 14.0])
def test_rms_is_as_asked(length):
    noise = noise_mm(FLAT, rms_mm=3.3, correlation_length_px=length)
    assert np.sqrt(np.mean(noise**2)) == pytest.approx(3.3, rel=1e-4)


@pytest.mark.parametrize("length", [6, 12])
def test_correlation_falls_to_1_over_e_at_its_length(length):
    noise = noise_mm(FLAT, rms_mm=3.0, correlation_length_px=float(length))
    for axis in (0, 1):
        for lag, expected in ((length // 2, np.exp(-0.25)), (length, np.exp(-1)), (3 * length, 0)):
            pair = np.take(noise, np.arange(lag, noise.shape[axis]), axis) * np.take(
                noise, np.arange(noise.shape[axis] - lag), axis
            )
            # about 200,000 / length^2 independent samples: three of their standard deviations
            assert np.mean(pair) / np.mean(noise**2) == pytest.approx(expected, abs=0.08)


def test_independent_pixels_without_a_length():
    noise = noise_mm(FLAT, rms_mm=3.0)
    assert abs(np.mean(noise[:, 1:] * noise[:, :-1])) / 9 < 0.01


@pytest.mark.parametrize("growth", [0.0, 1.0, 2.0])
def test_growth_with_depth(growth):
    depth = FLAT.copy()
    depth[:, 250:] = 1.6
    noise = noise_mm(depth, rms_mm=2.0, growth=growth, reference_depth_m=0.8)
    near, far = (np.sqrt(np.mean(part**2)) for part in (noise[:, :250], noise[:, 250:]))
    assert near == pytest.approx(2.0, rel=0.01)
    assert far / near == pytest.approx(2**growth, rel=0.01)


def test_the_reference_is_the_median_depth():
    depth = FLAT * np.linspace(0.8, 1.2, 500)
    by_default, stated = (
        noise_mm(depth, rms_mm=3.0, reference_depth_m=reference) for reference in (None, 0.8)
    )
    assert np.allclose(by_default, stated, atol=1e-3)


def test_steps():
    depth = add_depth_noise(
        FLAT, DepthNoise(rms_mm=3.0, correlation_length_px=9.0, step_mm=2.0), seed=1
    )
    steps = depth.astype(float) * 500
    assert np.abs(steps - np.rint(steps)).max() < 1e-4
    assert len(np.unique(depth)) > 5


def test_holes_are_as_many_as_asked_and_cover_connected_areas():
    depth = FLAT.copy()
    depth[:50] = np.nan
    noisy = add_depth_noise(depth, DepthNoise(hole_fraction=0.05, hole_size_px=8.0), seed=2)
    holes = np.isnan(noisy) & np.isfinite(depth)
    assert np.count_nonzero(holes) == round(0.05 * 350 * 500)
    assert np.isnan(noisy[:50]).all()
    core = binary_opening(holes, np.ones((3, 3)))
    assert np.count_nonzero(core) > 0.8 * np.count_nonzero(holes)


def test_the_seed_decides():
    noise = DepthNoise(rms_mm=3.0, correlation_length_px=4.0, hole_fraction=0.02)
    first, again, other = (add_depth_noise(FLAT, noise, seed) for seed in (7, 7, 8))
    assert np.array_equal(first, again, equal_nan=True)
    assert not np.allclose(first, other, equal_nan=True)


def test_calibration_meets_both_numbers():
    """With a real filter between the noise and its errors."""
    camera_px_per_m = 900 / 0.8

    def score(noise):
        left = gaussian_filter(
            noise_mm(FLAT, rms_mm=noise.rms_mm, correlation_length_px=noise.correlation_length_px),
            2.0,
        )
        slope = np.hypot(*np.gradient(left / 1000)) * camera_px_per_m
        return float(np.sqrt(np.mean(left**2))), float(np.degrees(np.arctan(slope)).mean())

    found = calibrate_noise(score, target=(3.33, 16.31))
    rmse, mae = score(found)
    assert rmse == pytest.approx(3.33, rel=0.0051)
    assert mae == pytest.approx(16.31, rel=0.0051)


def test_calibration_that_cannot_succeed():
    with pytest.raises(InputError, match="no depth noise gives these errors"):
        calibrate_noise(lambda noise: (1.0, 10.0))


@pytest.mark.parametrize(
    "options",
    [
        {"rms_mm": -1.0},
        {"rms_mm": np.nan},
        {"correlation_length_px": -1.0},
        {"step_mm": np.inf},
        {"hole_fraction": 1.0},
        {"reference_depth_m": 0.0},
    ],
)
def test_impossible_sensors(options):
    with pytest.raises(InputError):
        DepthNoise(**options)


def test_no_depth_at_all():
    with pytest.raises(InputError, match="no depth"):
        add_depth_noise(np.full((4, 4), np.nan), DepthNoise())

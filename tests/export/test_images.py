"""The pictures in a result folder, read back by other libraries: units, frames, encodings."""

import io
from dataclasses import replace

import numpy as np
import pytest

from rakelight.export import write_result
from rakelight.export.depth import choose_values_per_metre, depth_values
from rakelight.export.preview import preview
from rakelight.pictures.shown import object_window
from tests.export.readers import from_srgb, read_png

tifffile = pytest.importorskip("tifffile")
Image = pytest.importorskip("PIL.Image")


@pytest.fixture
def folder(sphere, tmp_path):
    write_result(sphere, tmp_path / "out", mesh="none")
    return tmp_path / "out"


def test_depth_tiff_is_metres_bit_for_bit(sphere, folder):
    depth = tifffile.imread(folder / "depth.tiff")
    assert depth.dtype == np.float32
    np.testing.assert_array_equal(depth, sphere.depth)
    assert np.nanmin(depth) == pytest.approx(0.61, abs=0.001)
    assert not np.isinf(depth).any()


def test_normals_tiff_is_xyz_in_the_camera_frame(sphere, folder):
    normals = tifffile.imread(folder / "normals.tiff")
    assert normals.dtype == np.float32
    np.testing.assert_array_equal(normals, sphere.normals)
    rows, columns = np.nonzero(sphere.mask)
    left, top = columns.argmin(), rows.argmin()
    assert normals[rows[left], columns[left], 0] < -0.8  # the left flank points left: x right
    assert normals[rows[top], columns[top], 1] < -0.8  # the upper flank points up: y down
    # All face the camera: against the ray to the pixel.
    ray = [(columns - 29.0) / 300.0, (rows - 26.5) / 280.0, np.ones(len(rows))]
    assert (np.sum(normals[rows, columns].T * ray, axis=0) < 0).all()


def test_depth_png_times_its_scale_is_the_depth(sphere, folder):
    values = np.asarray(Image.open(folder / "depth.png"))
    np.testing.assert_array_equal(values, read_png((folder / "depth.png").read_bytes()))
    assert ((values == 0) == ~sphere.mask).all()
    # 0.65 m: 100,000 values per metre would reach 65,000
    error = values[sphere.mask] / 100_000.0 - sphere.depth[sphere.mask]
    assert np.abs(error).max() <= 0.51e-5


@pytest.mark.parametrize(
    ("deepest_m", "expected"),
    [(0.6, 1e5), (0.66, 5e4), (1.31, 5e4), (1.32, 2e4), (20.0, 2e3), (9.87, 5e3), (70e3, 0.5)],
)
def test_depth_scale_uses_the_range_and_does_not_leave_it(deepest_m, expected):
    scale = choose_values_per_metre(deepest_m)
    assert scale == pytest.approx(expected)
    assert 65534 / 2.5 <= deepest_m * scale * (1 + 1e-12) <= 65534 * (1 + 1e-12)


def test_depth_values_never_wrap():
    depth = np.array([np.nan, 1e-12, 0.5, 65.534, 65.536, 70.0, 1e6, np.inf])
    assert depth_values(depth, 1000.0).tolist() == [0, 1, 500, 65534, 65534, 65534, 65534, 0]


def test_normals_png_opengl(sphere, folder):
    image = Image.open(folder / "normals.png")
    assert image.mode == "RGB"
    values = np.asarray(image).astype(float)
    decoded = (values / 255 * 2 - 1)[sphere.mask]
    nx, ny, nz = sphere.normals[sphere.mask].T
    np.testing.assert_allclose(decoded.T, [nx, -ny, -nz], atol=1 / 255 + 1e-6)
    assert (values[~sphere.mask] == (128, 128, 255)).all()


def test_normals_png_directx_differs_in_green_alone(sphere, folder, tmp_path):
    write_result(sphere, tmp_path / "dx", mesh="none", normal_map="directx")
    gl = np.asarray(Image.open(folder / "normals.png")).astype(int)[sphere.mask]
    dx = np.asarray(Image.open(tmp_path / "dx" / "normals.png")).astype(int)[sphere.mask]
    np.testing.assert_array_equal(dx[:, [0, 2]], gl[:, [0, 2]])
    assert np.abs(dx[:, 1] + gl[:, 1] - 255).max() <= 1
    assert np.abs(dx[:, 1] - gl[:, 1]).max() > 200


def test_albedo_png_is_16_bit_srgb(sphere, folder):
    values = read_png((folder / "albedo.png").read_bytes())
    assert values.max() > 255
    np.testing.assert_allclose(
        from_srgb(values / 65535)[sphere.mask], sphere.albedo[sphere.mask], atol=2e-5
    )
    assert (values[~sphere.mask] == 0).all()
    red, green, blue = np.asarray(Image.open(folder / "albedo.png"))[sphere.mask].T.astype(int)
    assert red.max() > green.max() > blue.max()


def test_albedo_above_one_is_clipped_not_wrapped(sphere, tmp_path):
    write_result(replace(sphere, albedo=sphere.albedo * 4), tmp_path / "out", mesh="none")
    values = read_png((tmp_path / "out" / "albedo.png").read_bytes())
    assert (values[sphere.mask & (sphere.albedo[..., 0] > 0.25)][:, 0] == 65535).all()


def test_confidence_png(sphere, folder):
    image = Image.open(folder / "confidence.png")
    assert image.mode == "L"
    values = np.asarray(image) / 255
    np.testing.assert_allclose(values, sphere.confidence, atol=0.5 / 255 + 1e-6)


def test_preview_png_shows_before_and_after_cropped(sphere, folder):
    image = np.asarray(Image.open(io.BytesIO((folder / "preview.png").read_bytes())))
    np.testing.assert_array_equal(image, preview(sphere))
    rows, columns = object_window(sphere.mask)
    width = columns.stop - columns.start
    assert image.shape == (rows.stop - rows.start, 2 * width + 16)
    # A bump before, flat after: only the left picture has shades.
    flat = np.where(sphere.mask[..., None], np.float32([0, 0, -1]), np.nan)
    after = preview(replace(sphere, normals=flat))
    assert len(np.unique(after[:, -width:])) == 2
    assert len(np.unique(after[:, :width])) > 20


def test_prepared_depth_with_holes_still_gives_a_preview(sphere, tmp_path):
    prepared = sphere.prepared_depth.copy()
    prepared[20:25, 20:40] = np.nan
    prepared[30, 30] = 0
    write_result(replace(sphere, prepared_depth=prepared), tmp_path / "out", mesh="none")
    assert (tmp_path / "out" / "preview.png").stat().st_size > 0

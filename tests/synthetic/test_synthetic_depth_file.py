"""Depth maps as shapes: faithful to the samples, exact normals, and refused when damaged."""

import io
import re
import zipfile

import numpy as np
import pytest

from rakelight.capture.images import encode_png, encode_tiff
from rakelight.errors import CaptureError, InputError
from rakelight.synthetic import SceneOptions, make_albedo, make_shape, render_scene
from rakelight.synthetic.depth_file import shape_from_depth, shape_from_file
from rakelight.synthetic.shapes import VIEW

CAMERA = VIEW.scaled(0.25)
SPHERE = make_shape("sphere").render(CAMERA)


def save_npz(path, **arrays):
    np.savez_compressed(path, **arrays)
    return path


@pytest.fixture
def npz(tmp_path):
    return save_npz(tmp_path / "ball.npz", depth_mm=1000 * SPHERE.depth, mask=SPHERE.mask)


def test_samples_are_kept_and_normals_follow(npz):
    shape = shape_from_file(npz, camera=CAMERA)
    seen = shape.render(CAMERA)
    inner = seen.mask
    assert np.count_nonzero(SPHERE.mask & ~inner) < 0.1 * np.count_nonzero(SPHERE.mask)
    assert not (inner & ~SPHERE.mask).any()
    assert np.abs(seen.depth - SPHERE.depth)[inner].max() < 1e-12
    cosine = np.sum(seen.normals * SPHERE.normals, axis=-1)[inner & (SPHERE.normals[..., 2] < -0.6)]
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 0.2


def test_normals_are_those_of_the_interpolated_depth(npz):
    """By a view so fine that its differences are derivatives."""
    finer = 200
    camera = CAMERA.scaled(finer).cropped(
        slice(30 * finer, 30 * finer + 3), slice(70 * finer, 70 * finer + 3)
    )
    seen = shape_from_file(npz, camera=CAMERA).render(camera)
    p = np.log(seen.depth)
    p_u, p_v = (p[1, 2] - p[1, 0]) / 2, (p[2, 1] - p[0, 1]) / 2
    x, y = 1 - camera.cx, 1 - camera.cy
    normal = np.array([camera.fx * p_u, camera.fy * p_v, -(1 + x * p_u + y * p_v)])
    assert np.abs(normal / np.linalg.norm(normal) - seen.normals[1, 1]).max() < 1e-6


def test_the_default_view_holds_the_object_and_divides_by_4(npz):
    shape = shape_from_file(npz)
    assert (shape.camera.width % 4, shape.camera.height % 4) == (0, 0)
    assert shape.camera.fx == 3750
    mask = shape.render(shape.camera).mask
    assert not mask[[0, -1]].any()
    assert not mask[:, [0, -1]].any()
    capture, truth = render_scene(shape, make_albedo("white"), SceneOptions(depth_factor=4))
    assert np.array_equal(capture.mask, truth.mask)


def test_a_tiff_in_metres(tmp_path):
    path = tmp_path / "ball.tiff"
    path.write_bytes(encode_tiff(SPHERE.depth.astype(np.float32)))
    seen = shape_from_file(path, camera=CAMERA).render(CAMERA)
    assert np.abs(seen.depth - SPHERE.depth)[seen.mask].max() < 1e-7


def test_holes_stay_holes():
    depth = np.full((20, 30), 0.8)
    depth[8:12, 10:14] = 0
    shape = shape_from_depth("plate", depth, VIEW.cropped(slice(0, 20), slice(0, 30)))
    top, left = (shape.camera.height - 20) // 2, (shape.camera.width - 30) // 2
    mask = shape.render(shape.camera).mask[top:, left:]
    assert not mask[8:12, 10:14].any()
    assert mask[2, 2]


def test_flat_walls_continue_flat_beyond_their_rim():
    """A slanted plane stays one up to its border: the spline has nothing to ring about."""
    camera = VIEW.cropped(slice(0, 30), slice(0, 40))
    x, y = np.meshgrid(np.arange(40) - camera.cx, np.arange(30) - camera.cy)
    depth = 0.8 / (1 - 0.4 * x / camera.fx + 0.3 * y / camera.fy)
    depth[:5] = depth[:, :6] = np.nan
    normals = shape_from_depth("plane", depth, camera).render(camera).normals
    expected = np.array([0.4, -0.3, -1.0]) / np.sqrt(1.25)
    assert np.nanmax(np.abs(normals - expected)) < 1e-3


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"depth": np.ones((9, 9))}, "missing"),
        ({"depth_mm": np.ones((9, 9, 2))}, "not an image of numbers"),
        ({"depth_mm": np.array([["a"] * 9] * 9)}, "not an image of numbers"),
        ({"depth_mm": np.ones((9, 9)), "mask": np.ones((8, 9), bool)}, "different size"),
        ({"depth_mm": np.full((9, 9), np.nan)}, "too little depth"),
        ({"depth_mm": np.ones((2, 9))}, "too little depth"),
        ({"depth_mm": np.full((9, 9), 1e30)}, "bad.npz: too little depth.*between 0 and 1000 m"),
    ],
)
def test_refused_arrays(tmp_path, arrays, words):
    with pytest.raises(InputError) as refused:
        shape_from_file(save_npz(tmp_path / "bad.npz", **arrays))
    assert re.search(words, str(refused.value))


@pytest.mark.parametrize("name", ["../evil.npy", "/evil.npy", "folder\\evil.npy"])
def test_archives_with_paths_are_refused(npz, name):
    with zipfile.ZipFile(npz, "a") as archive:
        archive.writestr(name, b"")
    with pytest.raises(InputError, match="an archive with paths in it"):
        shape_from_file(npz)


def test_pickles_are_refused(tmp_path):
    path = tmp_path / "bad.npz"
    np.savez(path, depth_mm=np.array([[{}, {}]] * 9, dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match="not an image of numbers"):
        shape_from_file(path)


def _npy(shape, values=b"\0" * 64, dtype="<f4"):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": dtype, "fortran_order": False, "shape": shape}
    )
    return header.getvalue() + values


@pytest.mark.parametrize(
    ("member", "words"),
    [
        (_npy((4, 5)), "not of the size it states"),
        (_npy((4, 3)), "not of the size it states"),
        (_npy((10**6, 10**6)), "not an image of numbers"),
        (_npy((-1, 4)), "not an image of numbers"),
        (b"\x93NUMPY\x01\x00", "damaged"),
        (b"nonsense", "damaged"),
        (b"", "damaged"),
    ],
)
def test_lying_headers(tmp_path, member, words):
    path = tmp_path / "bad.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("depth_mm.npy", member)
    with pytest.raises(InputError, match=words):
        shape_from_file(path)


def test_every_truncation_is_refused(npz):
    data = npz.read_bytes()
    for keep in np.linspace(0, len(data) - 1, 40).astype(int):
        npz.write_bytes(data[:keep])
        with pytest.raises(InputError):
            shape_from_file(npz)


def test_other_files_are_refused(tmp_path, npz):
    path = tmp_path / "shape.mat"
    path.write_bytes(b"x")
    with pytest.raises(InputError, match=r"\.mat"):
        shape_from_file(path)
    with pytest.raises(InputError):
        shape_from_file(tmp_path / "none.npz")
    path = tmp_path / "shape.tiff"
    path.write_bytes(encode_png(np.ones((9, 9), np.uint16)))
    with pytest.raises(InputError):
        shape_from_file(path)
    path.write_bytes(b"II*\0nonsense")
    with pytest.raises(CaptureError):
        shape_from_file(path)
    with pytest.raises(InputError, match="another size"):
        shape_from_file(npz, camera=VIEW)

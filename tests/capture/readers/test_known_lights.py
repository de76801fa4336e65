"""Folders of DiLiGenT and of RTI, .mat files of SRmeetsPS: read, refused, damaged."""

import io
import random
import zlib

import numpy as np
import pytest
from scipy.io import savemat

from rakelight import load_capture, write_capture
from rakelight.capture.images import encode_png, encode_tiff
from rakelight.capture.matfile import read_mat
from rakelight.capture.readers import find_reader
from rakelight.errors import CaptureError, InputError
from tests.capture.capture_builder import HEIGHT, WIDTH, small_capture
from tests.capture.photo_files import pfm

SMALL = small_capture(dtype=np.uint16, maps=1)
DIRECTIONS = np.array([[0.0, 0.0, -1.0], [0.6, 0, -0.8], [0, 0.6, -0.8], [-0.48, -0.36, -0.8]])
K = np.array([[40.0, 0, 15.25], [0, 40.5, 11.75], [0, 0, 1]])


def lines(rows):
    return "".join(" ".join(map(str, row)) + "\n" for row in rows)


def beside(folder):
    """What the user puts beside a dataset with lights."""
    folder.mkdir()
    for i, photograph in enumerate(SMALL.photographs):
        (folder / f"{i + 1:03d}.png").write_bytes(encode_png(photograph))
    (folder / "depth.tiff").write_bytes(encode_tiff(SMALL.depth_m[0]))
    (folder / "mask.png").write_bytes(encode_png(SMALL.mask.astype(np.uint8)))
    (folder / "K.txt").write_text(lines(K))
    return folder


def diligent(folder):
    beside(folder)
    (folder / "filenames.txt").write_text("004.png\n001.png\n002.png\n003.png\n")
    (folder / "light_directions.txt").write_text(lines(DIRECTIONS[[3, 0, 1, 2]] * [1, -1, -1]))
    (folder / "light_intensities.txt").write_text(
        lines([[4, 5, 6], [1, 1, 2], [1, 1, 1], [2, 2, 2]])
    )
    return folder


def rti(folder):
    beside(folder)
    rows = [[f"D:/dome/{i + 1:03d}.tif", *row] for i, row in enumerate(DIRECTIONS * [1, -1, -1])]
    (folder / "dome.lp").write_text("4\n" + lines(rows))
    return folder


def mat(path, compressed=True, **changes):
    """A file as MATLAB's users save it: H x W x 3 x N, millimetres or metres, K from 1."""
    first_is_1 = K + np.array([[0, 0, 1], [0, 0, 1], [0, 0, 0]])
    values = {
        "I": np.moveaxis(SMALL.photographs / 65535, 0, -1),
        "z0": np.nan_to_num(SMALL.depth_m[0]).astype(float),
        "mask": SMALL.mask,
        "K": first_is_1,
        "notes": {"by": "hand"},
    }
    savemat(path, values | changes, do_compression=compressed)
    return path


@pytest.mark.parametrize("before", ["./", ".\\"])
def test_names_that_begin_in_the_folder(tmp_path, before):
    folder = diligent(tmp_path / "set")
    expected = load_capture(folder)
    names = [f"{before}{name}" for name in expected.names]
    (folder / "filenames.txt").write_text("\r\n".join(names))
    capture = load_capture(folder)
    assert capture.names == expected.names
    np.testing.assert_array_equal(capture.photographs, expected.photographs)


@pytest.mark.parametrize(("make", "name"), [(diligent, "diligent"), (rti, "rti")])
def test_a_folder_with_lights_is_read_with_the_depth_beside(tmp_path, make, name):
    folder = make(tmp_path / "set")
    assert find_reader(folder).name == name
    capture = load_capture(folder)
    order = [3, 0, 1, 2] if name == "diligent" else [0, 1, 2, 3]
    assert np.array_equal(capture.photographs, SMALL.photographs[order])
    assert capture.lights.directions == pytest.approx(DIRECTIONS[order])
    assert capture.lights.fixed == (name == "diligent")
    assert capture.camera == SMALL.camera
    assert capture.encoding == "linear"
    assert np.array_equal(capture.mask, SMALL.mask)
    assert np.array_equal(capture.depth_m, SMALL.depth_m, equal_nan=True)
    if name == "diligent":
        assert capture.lights.intensities[1].tolist() == [1, 1, 2]
    some = load_capture(folder, photographs=[2, 0])
    assert np.array_equal(some.photographs, SMALL.photographs[[order[2], order[0]]])
    assert some.lights.directions == pytest.approx(DIRECTIONS[[order[2], order[0]]])
    write_capture(capture, tmp_path / "capture")
    again = load_capture(tmp_path / "capture").lights
    assert again.directions == pytest.approx(capture.lights.directions, abs=1e-15)


@pytest.mark.parametrize("make", [diligent, rti])
def test_without_depth_or_intrinsics_it_says_what_to_put_there(tmp_path, make):
    folder = make(tmp_path / "set")
    (folder / "K.txt").write_text("40 0 15.25\n")
    with pytest.raises(CaptureError, match=r"K\.txt: no intrinsics in it"):
        load_capture(folder)
    (folder / "K.txt").unlink()
    with pytest.raises(CaptureError, match=r"set: no intrinsics.*into intrinsics\.txt"):
        load_capture(folder)
    (folder / "depth.tiff").unlink()
    with pytest.raises(CaptureError, match=r"set: no depth map.*depth\.png .16 bit, millimetres"):
        load_capture(folder)
    (folder / "depth.png").write_bytes(encode_png(np.full((HEIGHT, WIDTH), 612, np.uint16)))
    (folder / "K.txt").write_text(lines(K))
    capture = load_capture(folder)
    assert np.nanmedian(capture.depth_m) == pytest.approx(0.612)
    assert "depth-unit-assumed" in [finding.code for finding in capture.findings]


def test_what_else_lies_in_a_diligent_folder(tmp_path):
    folder = diligent(tmp_path / "set")
    (folder / "Normal_gt.png").write_bytes(encode_png(SMALL.photographs[0]))
    (folder / "depth.tiff").unlink()
    (folder / "Z.pfm").write_bytes(pfm(SMALL.depth_m[0]))
    # Three rows that could be a calibration matrix.
    for name in ("filenames.txt", "light_intensities.txt", "light_directions.txt"):
        (folder / name).write_text("".join((folder / name).read_text().splitlines(True)[1:]))
    (folder / "light_directions.txt").write_text("0.6 0 0.8\n0 0.6 0.8\n0 0 1\n")
    capture = load_capture(folder)
    assert capture.names == ("001.png", "002.png", "003.png")
    assert capture.camera == SMALL.camera
    assert np.array_equal(capture.depth_m, SMALL.depth_m, equal_nan=True)
    (folder / "filenames.txt").write_text("001.png\n002.png\n010.png\n")
    with pytest.raises(CaptureError, match=r"set/010\.png: a photograph that is listed is not"):
        load_capture(folder)


@pytest.mark.parametrize("name", ["../secret.png", "/etc/passwd", "a\\..\\b.png", "..", "C:x.png"])
def test_names_in_lists_do_not_leave_the_folder(tmp_path, name):
    folder = diligent(tmp_path / "set")
    (folder / "filenames.txt").write_text(f"{name}\n001.png\n002.png\n003.png\n")
    with pytest.raises(CaptureError, match="leaves the folder"):
        load_capture(folder)


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("unit", [1, 1000])
def test_a_mat_file_is_read(tmp_path, compressed, unit):
    depth = unit * np.nan_to_num(SMALL.depth_m[0])
    path = mat(tmp_path / "mitten_sf2.mat", compressed, z0=depth)
    assert find_reader(path).name == "srmeetsps"
    capture = load_capture(path)
    assert np.array_equal(capture.photographs, SMALL.photographs)
    assert np.allclose(capture.depth_m, SMALL.depth_m, equal_nan=True)
    assert np.array_equal(capture.mask, SMALL.mask)
    assert capture.camera == SMALL.camera
    assert len(load_capture(path, photographs=[1]).photographs) == 1
    some = np.where(np.arange(16) < 10, 65.535 * unit, depth)  # most of it "too far"
    far = load_capture(mat(tmp_path / "far.mat", compressed, z0=some)).depth_m
    assert np.isnan(far[..., :10]).all()
    assert np.array_equal(far[..., 10:], capture.depth_m[..., 10:], equal_nan=True)
    unit_note = next(f for f in capture.findings if f.code == "depth-unit-assumed")
    assert ("millimetres" in unit_note.message) == (unit == 1000)


@pytest.mark.parametrize("kind", ["float64", "float32"])
def test_8_bit_photographs_in_floating_point(tmp_path, kind):
    """What double(imread(...)) returns: as if they had been saved as uint8."""
    eight = np.moveaxis(SMALL.photographs >> 8, 0, -1).astype(np.uint8)
    expected = load_capture(mat(tmp_path / "uint8.mat", I=eight))
    assert (expected.encoding, expected.photographs.dtype) == ("srgb", np.uint8)
    capture = load_capture(mat(tmp_path / f"{kind}.mat", I=eight.astype(kind)))
    assert (capture.encoding, capture.findings) == ("srgb", expected.findings)
    np.testing.assert_array_equal(capture.photographs, expected.photographs)


@pytest.mark.parametrize("most", [1.02, 4, 254.5])
def test_photographs_brighter_than_white_are_refused(tmp_path, most):
    images = np.moveaxis(SMALL.photographs / 65535, 0, -1)
    images[3, 4] = most
    path = mat(tmp_path / "a.mat", I=images)
    with pytest.raises(CaptureError, match=rf"beyond 0 to 1 \(seen .* to {most:g}"):
        load_capture(path)


@pytest.mark.parametrize(
    "kind", ["float64", "float32", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64"]
)
@pytest.mark.parametrize("shape", [(1, 1), (3, 1), (2, 3, 4), (5, 7)])
def test_numbers_of_every_kind_are_as_scipy_wrote_them(kind, shape):
    values = np.random.default_rng(1).integers(0, 100, shape).astype(kind)
    for compressed in (False, True):
        file = io.BytesIO()
        savemat(file, {"first": np.eye(2), "a": values, "b": values}, do_compression=compressed)
        found = read_mat(file.getvalue(), ("a", "b"))
        assert all(np.array_equal(found[name], values) for name in "ab")
        assert found["a"].dtype == kind


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"I": {"a": 1}}, "a structure"),
        ({"K": np.array([1, "a"], dtype=object)}, "a cell"),
        ({"mask": "text"}, "text"),
        ({"z0": np.full((12, 16), 1j)}, "complex"),
        ({"z0": np.zeros((12, 16))}, "no depth at all"),
        ({"z0": np.zeros((0, 3))}, "empty"),
        ({"K": np.eye(4)}, "not a calibration matrix"),
        ({"I": np.zeros((24, 32))}, "no variable I as it has to be"),
    ],
)
def test_wrong_variables_are_refused(tmp_path, changes, message):
    with pytest.raises(InputError, match=message):
        load_capture(mat(tmp_path / "a.mat", **changes))


@pytest.mark.parametrize(
    "head", [b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM", b"\x89HDF\r\n\x1a\n"]
)
def test_version_7_3_is_refused_with_the_way_to_save(tmp_path, head):
    path = tmp_path / "a.mat"
    with path.open("wb") as file:
        file.write(head)
        file.truncate(3_000_000_000)  # as large as only these can be; it is not read to the end
    with pytest.raises(CaptureError, match=r"a\.mat: HDF5 is not read.*7\.3.*'K', '-v7'"):
        load_capture(path)


def test_a_compressed_bomb_is_not_unpacked():
    file = io.BytesIO()
    savemat(file, {"I": np.zeros((2, 2))})
    body = bytearray(file.getvalue()[128:])
    packed = zlib.compress(bytes(body) + bytes(50_000_000))
    data = file.getvalue()[:128] + np.array([15, len(packed)], "<u4").tobytes() + packed
    assert read_mat(data, ("I",))["I"].tolist() == [[0, 0], [0, 0]]
    body[4:8] = np.array([60_000_000], "<u4").tobytes()
    packed = zlib.compress(bytes(body) + bytes(60_000_000))
    data = file.getvalue()[:128] + np.array([15, len(packed)], "<u4").tobytes() + packed
    with pytest.raises(CaptureError, match="longer than its size"):
        read_mat(data, ("I",))


def damaged(data, rng):
    """The bytes cut short, or with some of them changed, often near the start."""
    data = bytearray(data)
    if rng.random() < 0.2:
        return bytes(data[: rng.randrange(len(data))])
    for _ in range(rng.choice((1, 2, 8))):
        span = rng.choice((64, 400, len(data)))
        data[rng.randrange(min(span, len(data)))] = rng.choice((0, 1, 255, rng.randrange(256)))
    return bytes(data)


def test_damaged_mat_files_are_read_or_refused(tmp_path):
    rng, outcomes = random.Random(5), set()
    for compressed in (False, True):
        sound = mat(tmp_path / "a.mat", compressed).read_bytes()
        for case in range(250):
            data = damaged(sound, rng) if case % 2 else sound[:128] + damaged(sound[128:], rng)
            try:
                read_mat(data, ("I", "z0", "mask", "K"), "a.mat")
                outcomes.add("read")
            except CaptureError:
                outcomes.add("refused")
    assert outcomes == {"read", "refused"}


@pytest.mark.parametrize("make", [diligent, rti])
def test_damaged_folders_are_read_or_refused(tmp_path, make):
    rng = random.Random(6)
    folder = make(tmp_path / "set")
    texts = [path for path in folder.iterdir() if path.suffix in (".txt", ".lp", ".tiff")]
    sound = {path: path.read_bytes() for path in texts}
    outcomes = set()
    for _ in range(60):
        path = rng.choice(texts)
        path.write_bytes(damaged(sound[path], rng))
        try:
            load_capture(folder)
            outcomes.add("read")
        except InputError:
            outcomes.add("refused")
        path.write_bytes(sound[path])
    assert outcomes == {"read", "refused"}


def test_a_diligent_folder_without_directions_says_so(tmp_path):
    folder = diligent(tmp_path / "set")
    (folder / "light_directions.txt").unlink()
    with pytest.raises(InputError, match=r"set/light_directions\.txt: .* Fix: put it there"):
        load_capture(folder)


@pytest.mark.parametrize("comma", [False, True])
def test_directions_alone_are_in_the_order_of_the_photographs(tmp_path, comma):
    folder = beside(tmp_path / "set")
    text = lines(DIRECTIONS * [1, -1, -1])
    (folder / "light_directions.txt").write_text(text.replace(" ", ", ") if comma else text)
    capture = load_capture(folder)
    assert np.allclose(capture.lights.directions, DIRECTIONS)
    assert capture.lights.fixed
    assert capture.encoding == "linear"  # by its 16 bits
    (folder / "light_directions.txt").write_text(lines(DIRECTIONS[:3] * [1, -1, -1]))
    with pytest.raises(CaptureError, match=r"3 lines, needed 4"):
        load_capture(folder)


def test_a_list_of_lights_that_is_not_read_is_named(tmp_path):
    folder = beside(tmp_path / "set")
    assert "ignored-files" not in [finding.code for finding in load_capture(folder).findings]
    (folder / "lights.txt").write_text(lines(DIRECTIONS))
    capture = load_capture(folder)
    (finding,) = (each for each in capture.findings if each.code == "ignored-files")
    assert capture.lights is None
    assert finding.severity == "warning"
    assert finding.message.startswith("not read: lights.txt")


def test_a_folder_of_captures_with_lights_is_none_of_rti(tmp_path):
    for name in ("a", "b"):
        write_capture(load_capture(rti(tmp_path / f"of-{name}")), tmp_path / "captures" / name)
        assert (tmp_path / "captures" / name / "lights.lp").is_file()
    with pytest.raises(InputError, match="a folder of captures"):
        load_capture(tmp_path / "captures")


def test_listed_photographs_may_lie_in_a_folder_of_their_own(tmp_path):
    folder = diligent(tmp_path / "set")
    before = load_capture(folder)
    (folder / "images").mkdir()
    for path in folder.glob("0*.png"):
        path.rename(folder / "images" / path.name)
    text = "".join(f"images/{n}.png\n" for n in ("004", "001", "002", "003"))
    (folder / "filenames.txt").write_text(text)
    assert np.array_equal(load_capture(folder).photographs, before.photographs)
    (folder / "filenames.txt").write_text(text.replace("/", "\\"))
    assert np.array_equal(load_capture(folder).photographs, before.photographs)
    (folder / "filenames.txt").write_text(text.replace("images/004", "images/../../004"))
    with pytest.raises(CaptureError, match="leaves the folder"):
        load_capture(folder)


def test_lights_that_belong_to_photographs_by_their_order_are_told_of(tmp_path):
    folder = rti(tmp_path / "set")
    before = load_capture(folder)
    (folder / "dome.lp").write_text((folder / "dome.lp").read_text().replace("/0", "/light"))
    capture = load_capture(folder)
    np.testing.assert_array_equal(capture.lights.directions, before.lights.directions)
    (warning,) = [f for f in capture.findings if f.code == "lights-by-order"]
    assert "dome.lp" in warning.message
    assert warning not in before.findings


def test_a_list_of_lights_one_folder_below(tmp_path):
    """As RTIBuilder has it: jpeg-exports/ and assembly-files/."""
    folder = rti(tmp_path / "set")
    (folder / "assembly-files").mkdir()
    (folder / "dome.lp").rename(folder / "assembly-files/dome.lp")
    assert np.allclose(load_capture(folder).lights.directions, DIRECTIONS)
    (tmp_path / "other.lp").write_bytes((folder / "assembly-files/dome.lp").read_bytes())
    (folder / "assembly-files/dome.lp").unlink()
    (folder / "assembly-files/dome.lp").symlink_to(tmp_path / "other.lp")
    with pytest.raises(CaptureError, match="outside the folder"):
        load_capture(folder)


def test_a_diligent_folder_without_intensities_is_read(tmp_path):
    folder = diligent(tmp_path / "set")
    (folder / "light_intensities.txt").unlink()
    assert load_capture(folder).lights.intensities is None


def test_matlabs_transposed_matrix_is_read(tmp_path):
    plain = load_capture(mat(tmp_path / "plain.mat"))
    first_is_1 = K + np.array([[0, 0, 1], [0, 0, 1], [0, 0, 0]])
    turned = load_capture(mat(tmp_path / "turned.mat", K=first_is_1.T))
    assert turned.camera == plain.camera


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (1, 2, 0, 3)])
def test_photographs_of_other_axes_in_a_mat_file(tmp_path, order):
    axes = np.transpose(SMALL.photographs / 65535, order)
    with pytest.raises(CaptureError, match=r"I: .*needed \(H, W, 3, N\)\)\. Fix: permute\(I"):
        load_capture(mat(tmp_path / "a.mat", I=axes))

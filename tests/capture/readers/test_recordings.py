"""Recordings of phones and recorders: each is found, read exactly, and refused where it lies."""

import json
import shutil
import zipfile

import av
import lzfse
import numpy as np
import pytest

from rakelight.capture import load_capture
from rakelight.capture.images import decode_image, encode_tiff
from rakelight.capture.readers import find_reader, open3d_recorder, record3d, stray_scanner
from rakelight.capture.readers import tum_rgbd as tum
from rakelight.capture.recording import Recording
from rakelight.errors import CaptureError
from rakelight.model import Camera, Distortion
from tests.capture.readers.phone_sources import (
    CAMERA,
    DEPTH_HEIGHT,
    DEPTH_WIDTH,
    FPS,
    HEIGHT,
    WIDTH,
    depth_maps,
    expected,
    frames,
    grown,
    jpeg,
    metadata,
    odometry,
    png,
    portrait,
    r3d_members,
    write_open3d,
    write_polycam,
    write_r3d,
    write_scanner_app,
    write_stray,
    write_tum,
)

COUNT = 12


def images_of(recording: Recording):
    return np.stack([image for _, image in recording.color.walk(range(len(recording.color)))])


def depth_of(recording: Recording):
    return np.stack([depth for _, depth in recording.depth.walk(range(len(recording.depth)))])


def read_whole(path):
    """Every frame of an .r3d."""
    recording, _ = record3d.recording(path)
    depth_of(recording)
    images_of(recording)


def codes(path):
    return [finding.code for finding in load_capture(path).findings]


def decoded(image, **options):
    from simplejpeg import decode_jpeg

    return decode_jpeg(jpeg(image, **options), "RGB", fastdct=False, fastupsample=False)


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("record3d", lambda path: write_r3d(path / "scan.zip")),
        ("stray-scanner", lambda path: write_stray(path / "scan")),
        ("open3d", lambda path: write_open3d(path / "scan")),
        ("tum", lambda path: write_tum(path / "scan")),
    ],
)
def test_each_is_found_by_its_content(tmp_path, name, write):
    assert find_reader(write(tmp_path)).name == name


# Record3D


def test_r3d_is_read_exactly(tmp_path):
    recording, _ = record3d.recording(write_r3d(tmp_path / "a.r3d"))
    assert recording.camera == CAMERA
    assert np.array_equal(images_of(recording), [decoded(image) for image in frames()])
    assert np.array_equal(depth_of(recording), expected(depth_maps()), equal_nan=True)
    assert np.allclose(recording.color.times_s, 100 + np.arange(COUNT) / FPS)
    assert recording.depth_camera == CAMERA.resized(DEPTH_WIDTH, DEPTH_HEIGHT)
    ((number, image),) = recording.color.walk([5])
    assert number == 5
    assert np.array_equal(image, decoded(frames()[5]))


def test_r3d_metadata_may_lack_what_is_not_needed(tmp_path):
    facts = metadata(COUNT, dw=None, dh=None, frameTimestamps=None, poses=None, fps=60)
    recording, poses = record3d.recording(write_r3d(tmp_path / "a.r3d", r3d_members(facts)))
    assert recording.depth.shape == (DEPTH_HEIGHT, DEPTH_WIDTH)
    assert np.allclose(recording.color.times_s, np.arange(COUNT) / 60)
    assert poses is None


def test_r3d_may_end_with_half_a_frame_and_have_no_confidence(tmp_path):
    members = r3d_members()
    members = {name: data for name, data in members.items() if not name.endswith(".conf")}
    del members["rgbd/11.depth"]
    members["rgbd/10.depth"] = b""
    recording, _ = record3d.recording(write_r3d(tmp_path / "a.r3d", members))
    assert (len(recording.color), len(recording.depth)) == (COUNT, COUNT - 2)
    want = np.where(np.isnan(depth_maps()), np.nan, depth_maps())[:-2].astype(np.float32)
    assert np.array_equal(depth_of(recording), want, equal_nan=True)


def test_r3d_that_was_unpacked_and_packed_again_with_its_folder(tmp_path):
    want = record3d.recording(write_r3d(tmp_path / "a.r3d"))[0]
    members = {f"scan/{name}": data for name, data in r3d_members().items()}
    members["__MACOSX/scan/._metadata"] = members["__MACOSX/scan/rgbd/._0.jpg"] = b"\0\5\x16\7"
    path = write_r3d(tmp_path / "b.zip", members)
    assert find_reader(path).name == "record3d"
    recording, _ = record3d.recording(path)
    assert recording.camera == want.camera
    assert np.array_equal(depth_of(recording), depth_of(want), equal_nan=True)


def test_r3d_k_of_smaller_frames_is_scaled(tmp_path):
    small = CAMERA.resized(WIDTH // 2, HEIGHT // 2)
    facts = metadata(COUNT, small)
    recording, _ = record3d.recording(write_r3d(tmp_path / "a.r3d", r3d_members(facts)))
    assert recording.camera == CAMERA


def test_r3d_takes_the_median_of_each_frames_focal_length(tmp_path):
    each = [[500.0 + i, 500.0 + i, CAMERA.cx, CAMERA.cy] for i in range(COUNT)]
    facts = metadata(COUNT, perFrameIntrinsicCoeffs=each)
    recording, _ = record3d.recording(write_r3d(tmp_path / "a.r3d", r3d_members(facts)))
    assert recording.camera.fx == 505.5


def turned(images):
    """As a phone held upright shows what its sensor sees: a quarter to the left."""
    return np.stack([np.rot90(image) for image in images])


def test_r3d_portrait_is_read_as_it_is(tmp_path):
    facts = metadata(COUNT, portrait(CAMERA), dw=DEPTH_HEIGHT, dh=DEPTH_WIDTH)
    members = r3d_members(facts, turned(frames()), turned(depth_maps()))
    recording, _ = record3d.recording(write_r3d(tmp_path / "a.r3d", members))
    assert recording.camera == portrait(CAMERA)
    assert recording.color.shape == (WIDTH, HEIGHT)
    assert recording.depth.shape == (DEPTH_WIDTH, DEPTH_HEIGHT)


def test_r3d_w_and_h_exchanged_are_seen_by_the_frames(tmp_path):
    facts = metadata(COUNT, w=HEIGHT, h=WIDTH)
    recording, _ = record3d.recording(write_r3d(tmp_path / "a.r3d", r3d_members(facts)))
    assert recording.camera == CAMERA


def test_r3d_frames_are_turned_by_exif_where_w_and_h_are_of_the_other_side(tmp_path):
    from PIL import Image

    exif = Image.Exif()
    exif[274] = 8  # to be shown a quarter to the left
    facts = metadata(COUNT, portrait(CAMERA), dw=DEPTH_HEIGHT, dh=DEPTH_WIDTH)
    members = r3d_members(facts, frames(), turned(depth_maps()), exif=exif)
    recording, _ = record3d.recording(write_r3d(tmp_path / "a.r3d", members))
    assert np.array_equal(images_of(recording)[3], np.rot90(decoded(frames()[3])))
    assert recording.camera == portrait(CAMERA)


def test_r3d_depth_turned_against_the_frames_is_refused(tmp_path):
    facts = metadata(COUNT, dw=DEPTH_HEIGHT, dh=DEPTH_WIDTH)
    path = write_r3d(tmp_path / "a.r3d", r3d_members(facts))
    with pytest.raises(CaptureError, match="turned against each other"):
        load_capture(path)


def bomb():
    """Of zeros: some kilobytes that unpack to 5 MB."""
    return lzfse.compress(bytes(5_000_000))


def understated():
    """The same, whose first block says that it is as large as the map should be."""
    data = bytearray(lzfse.compress(bytes(4_000_000)))
    assert data.count(b"bvx2") == 1
    data[4:8] = (4 * DEPTH_WIDTH * DEPTH_HEIGHT).to_bytes(4, "little")
    return bytes(data)


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("rgbd/3.depth", bomb, "the LZFSE data are damaged"),
        ("rgbd/3.depth", understated, "the LZFSE data are damaged"),
        ("rgbd/3.conf", lambda: lzfse.compress(bytes(3)), "seen 3 bytes, needed 192"),
        ("rgbd/3.depth", lambda: b"bvx2" + bytes(40), "the LZFSE data are damaged"),
        ("rgbd/3.jpg", lambda: jpeg(frames()[0][::2]), "different kinds"),
        ("metadata", lambda: b"[" * 5000, "not JSON"),
        ("metadata", lambda: b'{"K": "no"}', "K is not a list of numbers"),
        ("metadata", lambda: json.dumps(metadata(K=[1] * 9)).encode(), "K: "),
        ("metadata", lambda: json.dumps(metadata(K=[9e9] * 9)).encode(), "K: "),
        ("metadata", lambda: json.dumps(metadata(dw=99999, dh=99999)).encode(), "too large"),
        ("metadata", lambda: json.dumps(metadata(poses=[["a"] * 7] * 12)).encode(), "poses"),
    ],
)
def test_r3d_with_one_wrong_member_is_refused(tmp_path, name, data, said):
    members = {**r3d_members(), name: data()}
    path = write_r3d(tmp_path / "a.r3d", members)
    with pytest.raises(CaptureError, match=said):
        read_whole(path)


def test_r3d_bomb_is_not_unpacked(tmp_path, monkeypatch):
    members = {**r3d_members(), "rgbd/0.depth": lzfse.compress(bytes(500_000))}
    assert len(members["rgbd/0.depth"]) < 4 * DEPTH_WIDTH * DEPTH_HEIGHT
    path = write_r3d(tmp_path / "a.r3d", members)
    unpacked = []
    monkeypatch.setattr(lzfse, "decompress", unpacked.append)
    with pytest.raises(CaptureError, match="seen 500000 bytes, needed 768"):
        read_whole(path)
    assert unpacked == []


def test_r3d_zip_that_lies_is_refused(tmp_path):
    path = tmp_path / "a.r3d"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in r3d_members().items():
            archive.writestr(name, data if name != "metadata" else bytes(11_000_000))
    with pytest.raises(CaptureError, match="a member is too large"):
        load_capture(path)
    link = zipfile.ZipInfo("metadata")
    link.external_attr = 0o120777 << 16
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("rgbd/0.jpg", jpeg(frames()[0]))
        archive.writestr("rgbd/0.depth", b"x")
        archive.writestr(link, "/etc/passwd")
    with pytest.raises(CaptureError, match="seen a link"):
        load_capture(path)
    with pytest.warns(UserWarning, match="Duplicate"), zipfile.ZipFile(path, "a") as archive:
        archive.writestr("rgbd/0.depth", b"y")
    with pytest.raises(CaptureError, match="two members of one name"):
        load_capture(path)
    data = bytearray(write_r3d(path).read_bytes())
    at = data.index(b"PK\1\2")
    data[at + 8] |= 1  # encrypted
    path.write_bytes(data)
    with pytest.raises(CaptureError, match="encrypted"):
        load_capture(path)


# Stray Scanner


def test_stray_folder_is_read(tmp_path):
    recording, poses = stray_scanner.recording(write_stray(tmp_path / "scan"))
    assert recording.camera == CAMERA
    assert np.array_equal(depth_of(recording), expected(depth_maps(), 1000), equal_nan=True)
    assert np.allclose(recording.color.times_s, np.arange(COUNT) / FPS, atol=1e-9)
    assert np.array_equal(recording.color.times_s, recording.depth.times_s)
    # 4:2:0 halves the colours' resolution: 7.7 of 255; more than 10 of the frame beside.
    off = images_of(recording).astype(float) - frames()
    assert np.sqrt((off**2).mean(axis=(1, 2, 3))).max() < 9
    assert np.abs(off.mean(axis=(0, 1, 2))).max() < 1
    assert poses is not None
    assert poses.positions_m.shape == (COUNT, 3)


@pytest.mark.parametrize("name", ["rgb.MP4", "IMG_0012.mov"])
def test_stray_video_of_another_name(tmp_path, name):
    path = write_stray(tmp_path / "scan", frames()[:3], depth_maps()[:3])
    (path / "rgb.mp4").rename(path / name)
    assert find_reader(path).name == "stray-scanner"
    recording, _ = stray_scanner.recording(path)
    assert recording.names[0] == f"{name} frame 0"
    (path / "IMG_1.jpg").write_bytes(b"")  # photographs, and a video of how they were made
    assert not stray_scanner.sniff(path)
    (path / "IMG_1.jpg").unlink()
    (path / "second.mp4").write_bytes((path / name).read_bytes())
    with pytest.raises(CaptureError, match=r"several videos .*needed rgb\.mp4"):
        stray_scanner.recording(path)


def test_stray_newer_columns_numbers_and_lost_frames(tmp_path):
    """Per-frame intrinsics, numbers that go on from an earlier scan, a last map cut short."""
    text = odometry(COUNT, 40, fx=510.0, fy=511.0, cx=CAMERA.cx, cy=CAMERA.cy, distortion="")
    path = write_stray(tmp_path / "scan", text=text + "\n60.0, 0000", start=40)
    (path / "depth/000051.png").write_bytes(b"")
    (path / "depth/000043.png").unlink()
    (path / "confidence/000045.png").unlink()
    recording, _ = stray_scanner.recording(path)
    assert (recording.camera.fx, recording.camera.fy) == (510.0, 511.0)
    kept = [i for i in range(COUNT) if i not in (3, 11)]
    assert np.allclose(recording.depth.times_s, np.array(kept) / FPS)
    want = expected(depth_maps(), 1000)[kept]
    want[kept.index(5)] = np.rint(depth_maps()[5] * 1000) / 1000  # no doubts about this one
    assert np.array_equal(depth_of(recording), want.astype(np.float32), equal_nan=True)


def test_stray_without_odometry_or_of_early_2021(tmp_path):
    path = write_stray(tmp_path / "scan", text="\n".join(["0.1, 0.2, 0.3, 0, 0, 0, 1"] * COUNT))
    early, poses = stray_scanner.recording(path)
    assert poses is not None
    (path / "odometry.csv").unlink()
    without, none = stray_scanner.recording(path)
    assert none is None
    for recording in (early, without):
        assert len(recording.depth) == COUNT
        assert np.allclose(recording.depth.times_s, np.arange(COUNT) / FPS, atol=1e-3)


def test_stray_video_of_one_frame_less(tmp_path):
    path = write_stray(tmp_path / "scan", frames(), text=odometry(COUNT + 1))
    recording, _ = stray_scanner.recording(path)
    assert (len(recording.color), len(recording.depth)) == (COUNT, COUNT)


def test_stray_first_frame_that_players_do_not_show(tmp_path):
    """The app writes it before the time 0, and counts it in odometry.csv and depth/."""
    path = write_stray(tmp_path / "scan", first=-1)
    with av.open(str(path / "rgb.mp4")) as container:
        assert len(list(container.decode(video=0))) == COUNT - 1
    recording, _ = stray_scanner.recording(path)
    off = images_of(recording).astype(float) - frames()
    assert np.sqrt((off**2).mean(axis=(1, 2, 3))).max() < 9
    assert np.allclose(recording.color.times_s, recording.depth.times_s)


def test_stray_depth_of_2021(tmp_path):
    path = write_stray(tmp_path / "scan")
    before, _ = stray_scanner.recording(path)
    want = depth_of(before)
    for file in (path / "depth").iterdir():
        np.save(file.with_suffix(".npy"), decode_image(file.read_bytes()))
        file.unlink()
    recording, _ = stray_scanner.recording(path)
    assert np.array_equal(depth_of(recording), want, equal_nan=True)
    np.save(path / "depth/000000.npy", np.ones((DEPTH_HEIGHT, DEPTH_WIDTH)))
    with pytest.raises(CaptureError, match=r"000000\.npy: this is no depth map.*array float64"):
        stray_scanner.recording(path)


@pytest.mark.parametrize(
    ("file", "text", "said"),
    [
        ("camera_matrix.csv", "1, 2\n3, 4", "the matrix"),
        ("camera_matrix.csv", "", "the matrix"),
        ("camera_matrix.csv", "5000, 0, 959.5\n0, 5000, 719.5\n0, 0, 1", "implausible"),
        ("odometry.csv", "timestamp, frame, x\n1, 0, 0\n1, 1, 0\n1, 2, 0", "do not rise"),
        ("odometry.csv", "timestamp, frame, x\n1, 0\n1, 1, 0\n1, 2", "too short"),
        ("odometry.csv", "timestamp, frame, x\n1, 700, 0\n2, 701, 0", "no depth map belongs"),
        (
            "odometry.csv",
            "timestamp, frame, x\n1, 1e300, 0\n2, 701, 0",
            "frame numbers that cannot be",
        ),
    ],
)
def test_stray_text_that_is_wrong_is_refused(tmp_path, file, text, said):
    path = write_stray(tmp_path / "scan", frames()[:3], depth_maps()[:3])
    (path / file).write_text(text)
    with pytest.raises(CaptureError, match=said):
        stray_scanner.recording(path)


# Open3D and TUM


@pytest.mark.parametrize("by_rows", [False, True])
def test_open3d_folder_is_read_exactly(tmp_path, by_rows):
    path = write_open3d(tmp_path / "scan", by_rows=by_rows)
    (path / "color/000003.png").unlink()
    (path / "depth/000011.png").unlink()
    recording, _ = open3d_recorder.recording(path)
    assert recording.camera == CAMERA
    assert recording.depth_camera is None
    kept = [i for i in range(COUNT) if i != 3]
    assert np.array_equal(images_of(recording), frames()[kept])
    want = np.rint(np.nan_to_num(grown(depth_maps())) * 1000) / 1000
    want = np.where(want == 0, np.nan, want).astype(np.float32)
    assert np.array_equal(depth_of(recording), want[:-1], equal_nan=True)
    assert np.allclose(recording.color.times_s, np.array(kept) / 30)
    assert not recording.color.timed


def test_open3d_states_the_unit_of_the_depth_and_the_rate(tmp_path):
    """As RGBDVideoMetadata.cpp does: 4000 values per metre of an L515."""
    path = write_open3d(tmp_path / "scan", per_metre=4000, depth_scale=4000.0, fps=15.0)
    recording, _ = open3d_recorder.recording(path)
    want = np.rint(np.nan_to_num(grown(depth_maps())) * 4000) / 4000
    want = np.where(want == 0, np.nan, want).astype(np.float32)
    assert np.array_equal(depth_of(recording), want, equal_nan=True)
    assert np.allclose(recording.color.times_s, np.arange(COUNT) / 15)
    assert recording.color.timed


@pytest.mark.parametrize(
    ("stated", "per_metre"),
    [
        (1000, 1000), (0.001, 1000), ("5000", 5000), (0.00025, 4000), (0.0001, 10_000),
        (9.999999747378752e-05, 10_000),  # of 32 bits
    ],
)  # fmt: skip
def test_open3d_depth_scale_of_either_kind(tmp_path, stated, per_metre):
    one = frames()[:1], grown(depth_maps())[:1]
    path = write_open3d(tmp_path / "scan", *one, per_metre=per_metre, depth_scale=stated)
    recording, _ = open3d_recorder.recording(path)
    assert not recording.findings
    measured = np.isfinite(one[1])
    np.testing.assert_allclose(depth_of(recording)[measured], one[1][measured], atol=6e-4)


def test_open3d_depth_scale_that_is_not_stated(tmp_path):
    path = write_open3d(tmp_path / "scan", frames()[:1], grown(depth_maps())[:1])
    (note,) = open3d_recorder.recording(path)[0].findings
    assert note.code == "depth-unit-assumed"
    assert "1000 depth values per metre assumed, which are the recorders'" in note.message
    (path / "depth_scale.txt").write_text("1000")
    assert not open3d_recorder.recording(path)[0].findings


@pytest.mark.parametrize("stated", [0, -1000, "millimetres", True, [1000], 35])
def test_open3d_depth_scale_that_is_none_is_refused(tmp_path, stated):
    one = frames()[:1], grown(depth_maps())[:1]
    path = write_open3d(tmp_path / "scan", *one, depth_scale=stated)
    with pytest.raises(CaptureError, match=r"(not understood|no possible scale).*depth_scale\.txt"):
        open3d_recorder.recording(path)


def test_open3d_intrinsics_of_another_size_are_refused(tmp_path):
    path = write_open3d(tmp_path / "scan", frames()[:2], grown(depth_maps())[:2], CAMERA.scaled(2))
    with pytest.raises(CaptureError, match=r"another image \(seen 240x180, needed 120x90\)"):
        open3d_recorder.recording(path)


def test_stray_tables_that_an_editor_has_marked(tmp_path):
    path = write_stray(tmp_path / "scan", frames()[:2], depth_maps()[:2])
    for name in ("camera_matrix.csv", "odometry.csv"):
        (path / name).write_bytes(b"\xef\xbb\xbf" + (path / name).read_bytes())
    recording, _ = stray_scanner.recording(path)
    assert recording.camera == CAMERA
    assert len(recording.depth) == 2


def test_open3d_frames_in_jpeg_are_noted(tmp_path):
    path = write_open3d(tmp_path / "scan", suffix="jpg")
    assert "compressed" in codes(path)
    recording, _ = open3d_recorder.recording(path)
    assert np.array_equal(images_of(recording)[7], decoded(frames()[7]))


def test_tum_folder_is_read_exactly(tmp_path):
    recording, _ = tum.recording(write_tum(tmp_path / "scan"))
    assert recording.camera == CAMERA
    assert np.array_equal(images_of(recording), frames())
    want = np.rint(np.nan_to_num(grown(depth_maps())) * 5000) / 5000
    want = np.where(want == 0, np.nan, want).astype(np.float32)
    assert np.array_equal(depth_of(recording), want, equal_nan=True)
    assert np.allclose(recording.depth.times_s - recording.color.times_s, 0.01, atol=1e-5)


@pytest.mark.parametrize(
    ("text", "camera"),
    [
        ("# fx fy cx cy\n517.3 516.5 60.5 44.5", (517.3, 516.5, 60.5, 44.5)),
        ("517.3, 516.5, 60.5, 44.5, 0.26, -0.95, 0, 0, 1.16", (517.3, 516.5, 60.5, 44.5)),
        ("[[517.3, 0, 60.5]\n [0, 516.5, 44.5]\n [0, 0, 1]]", (517.3, 516.5, 60.5, 44.5)),
    ],
)
def test_tum_intrinsics_beside_the_lists(tmp_path, text, camera):
    path = write_tum(tmp_path / "scan", frames()[:1], grown(depth_maps())[:1], intrinsics=text)
    recording, _ = tum.recording(path)
    seen = recording.camera
    assert (seen.fx, seen.fy, seen.cx, seen.cy) == camera
    lens = Distortion("brown-conrady", (0.26, -0.95, 0, 0, 1.16)) if "0.26" in text else None
    assert seen.distortion == lens
    assert "default-intrinsics" not in [finding.code for finding in recording.findings]


ORB_SLAM = f"""%YAML:1.0

Camera.fx: {CAMERA.fx}
Camera.fy: {CAMERA.fy}
Camera.cx: {CAMERA.cx}
Camera.cy: {CAMERA.cy}
DepthMapFactor: 1000.0
"""


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("camera.yaml", ORB_SLAM),
        ("camera.yaml", ORB_SLAM.replace("DepthMapFactor", "RGBD.DepthMapFactor")),
        ("config.yaml", "cam:\n  png_depth_scale: 1000.0  # to metres\n"),
        ("depth_scale.txt", "1000\n"),
    ],
)
def test_tum_depth_of_another_scale(tmp_path, name, text):
    path = write_tum(tmp_path / "scan", intrinsics="" if "fx" in text else None, per_metre=1000)
    (path / name).write_text(text)
    recording, _ = tum.recording(path)
    assert recording.camera == CAMERA
    want = np.rint(np.nan_to_num(grown(depth_maps())) * 1000) / 1000
    want = np.where(want == 0, np.nan, want).astype(np.float32)
    assert np.array_equal(depth_of(recording), want, equal_nan=True)


def test_tum_says_that_it_assumes_the_benchmarks_scale(tmp_path):
    path = write_tum(tmp_path / "scan", frames()[:1], grown(depth_maps())[:1])
    (note,) = tum.recording(path)[0].findings
    assert note.code == "depth-unit-assumed"
    assert "5000 depth values per metre" in note.message
    (path / "depth_scale.txt").write_text("5000")
    assert not tum.recording(path)[0].findings


def test_tum_lists_of_windows(tmp_path):
    path = write_tum(tmp_path / "scan")
    for name in ("rgb.txt", "depth.txt"):
        _, text = (path / name).read_text().split("\n", 1)
        lines = text.replace("# timestamp filename\n", "").replace("/", "\\").replace("\n", "\r\n")
        (path / name).write_bytes(b"\xef\xbb\xbf" + lines.encode())
    recording, _ = tum.recording(path)
    assert np.array_equal(images_of(recording), frames())
    assert len(recording.depth) == len(frames())


def test_tum_depth_of_two_scales_is_refused(tmp_path):
    path = write_tum(tmp_path / "scan", frames()[:1], grown(depth_maps())[:1])
    for factor in (1000, 5000):
        (path / f"orb-{factor}.yaml").write_text(f"DepthMapFactor: {factor}\n")
    with pytest.raises(CaptureError, match=r"several scales of the depth \(seen 1000, 5000"):
        tum.recording(path)


@pytest.mark.parametrize("kind", ["floats", "colour"])
def test_tum_depth_that_is_none_is_refused_whatever_its_scale(tmp_path, kind):
    floats = encode_tiff(np.ones((90, 120), np.float32))
    path = write_tum(tmp_path / "scan", frames()[:1], grown(depth_maps())[:1])
    (path / "orb.yaml").write_text("DepthMapFactor: 1000")
    (path / "depth" / "1305031102.185304.png").write_bytes(
        floats if kind == "floats" else png(frames()[0])
    )
    with pytest.raises(CaptureError, match="this is no depth map"):
        tum.recording(path)


@pytest.mark.parametrize(("later_s", "refused"), [(1e9, True), (-1e9, True), (500, False)])
def test_tum_colour_and_depth_of_one_recording(tmp_path, later_s, refused):
    path = write_tum(tmp_path / "scan")
    lines = [line.split() for line in (path / "rgb.txt").read_text().splitlines()[2:]]
    moved = [f"{float(time) + later_s:.6f} {name}" for time, name in lines]
    (path / "rgb.txt").write_text("\n".join(moved))
    if not refused:
        assert len(tum.recording(path)[0].color) == len(lines)
        return
    said = r"the times of rgb\.txt and depth\.txt lie far apart .seen (1,000,000|999,99)"
    with pytest.raises(CaptureError, match=said):
        tum.recording(path)


@pytest.mark.parametrize("name", ["associations.txt", "associated.txt"])
@pytest.mark.parametrize("depth_first", [True, False])
def test_tum_pairs_in_the_place_of_the_lists(tmp_path, name, depth_first):
    path = write_tum(tmp_path / "scan")
    want = tum.recording(path)[0]
    lists = []
    for kind in ("depth", "rgb"):
        lines = (path / f"{kind}.txt").read_text().splitlines()
        lists.append([line for line in lines if line[0] != "#"])
        (path / f"{kind}.txt").unlink()
    pairs = [" ".join(each if depth_first else each[::-1]) for each in zip(*lists, strict=True)]
    (path / name).write_text("\n".join(pairs) + "\n")
    assert find_reader(path).name == "tum"
    recording, _ = tum.recording(path)
    assert recording.names == want.names
    assert np.array_equal(recording.depth.times_s, want.depth.times_s)
    assert np.array_equal(depth_of(recording), depth_of(want), equal_nan=True)


@pytest.mark.parametrize("line", ["1 rgb/1.png", "1 depth/1.png 1 depth/1.png"])
def test_tum_pairs_that_are_none_are_refused(tmp_path, line):
    path = write_tum(tmp_path / "scan", frames()[:1], grown(depth_maps())[:1])
    (path / "rgb.txt").unlink()
    (path / "associations.txt").write_text(line)
    with pytest.raises(
        CaptureError, match=r"line 1 is no time and file.*75\.png, and the same of depth"
    ):
        tum.recording(path)


def test_tum_without_intrinsics_takes_the_benchmarks_with_a_warning(tmp_path):
    large = np.zeros((1, 480, 640, 3), np.uint8), np.ones((1, 480, 640), np.float32)
    recording, _ = tum.recording(write_tum(tmp_path / "large", *large, intrinsics=""))
    assert recording.camera.fx == 525.0
    found = [finding.code for finding in recording.findings]
    assert found == ["default-intrinsics", "depth-unit-assumed"]
    path = write_tum(tmp_path / "small", frames()[:1], grown(depth_maps())[:1], intrinsics="")
    with pytest.raises(CaptureError, match=r"not known.*120x90.*intrinsics\.txt"):
        tum.recording(path)


TRAJECTORY = "1305031102.17 0.1 0.2 0.3 0 0 0 1\n"


@pytest.mark.parametrize(
    ("name", "lines"),
    [("CameraTrajectory.txt", 1), ("camera_poses.txt", 24), ("camera_path.txt", 24)],
)
def test_tum_trajectories_are_no_intrinsics(tmp_path, name, lines):
    path = write_tum(tmp_path / "scan", frames()[:1], grown(depth_maps())[:1])
    (path / name).write_text(lines * TRAJECTORY)
    assert tum.recording(path)[0].camera == CAMERA
    (path / "intrinsics.txt").unlink()
    with pytest.raises(CaptureError, match=r"the intrinsics of the colour camera are not known"):
        tum.recording(path)


def test_tum_files_that_are_not_understood_are_named(tmp_path):
    large = np.zeros((1, 480, 640, 3), np.uint8), np.ones((1, 480, 640), np.float32)
    path = write_tum(tmp_path / "scan", *large, intrinsics="")
    (path / "my_camera.txt").write_text("a Kinect")
    (warning, _) = tum.recording(path)[0].findings
    assert warning.message.endswith("assumed; none were found in my_camera.txt")
    (path / "my_camera.txt").rename(path / "camera.txt")
    with pytest.raises(CaptureError, match=r"camera\.txt: no intrinsics in it \(seen a Kinect"):
        tum.recording(path)


@pytest.mark.parametrize("name", ["calibration.txt", "camera_intrinsic.json"])
def test_tum_intrinsics_that_contradict_each_other_are_refused(tmp_path, name):
    path = write_tum(tmp_path / "scan", frames()[:1], grown(depth_maps())[:1])
    facts = {"width": CAMERA.width, "height": CAMERA.height}
    for wrong in (0.0, 1.0):
        matrix = CAMERA.matrix + wrong * np.diag([1, 1, 0])
        facts["intrinsic_matrix"] = matrix.T.ravel().tolist()
        numbers = " ".join(map(str, matrix.ravel()))
        (path / name).write_text(numbers if name.endswith("txt") else json.dumps(facts))
        if not wrong:
            assert tum.recording(path)[0].camera == CAMERA
    with pytest.raises(CaptureError, match=rf"several files with intrinsics.*{name}, intrinsics"):
        tum.recording(path)


@pytest.mark.parametrize(
    "name",
    ["../secret.png", "/etc/passwd", "rgb/../../secret.png", "link/secret.png", "..\\secret.png"],
)
def test_tum_names_stay_in_the_folder(tmp_path, name):
    path = write_tum(tmp_path / "scan", frames()[:2], grown(depth_maps())[:2])
    (tmp_path / "secret.png").write_bytes(png(frames()[0]))
    (path / "link").symlink_to(tmp_path)
    (path / "rgb.txt").write_text(f"1.0 {name}\n")
    with pytest.raises(CaptureError, match="outside the folder"):
        tum.recording(path)


def test_tum_names_of_nothing_are_said(tmp_path):
    path = write_tum(tmp_path / "scan", frames()[:2], grown(depth_maps())[:2])
    (path / "rgb").rename(path / "color")
    with pytest.raises(CaptureError, match=r"rgb\.txt: none of the files.*seen rgb/13050"):
        tum.recording(path)


@pytest.mark.parametrize("line", ["rgb/1.png", "x rgb/1.png", "nan rgb/1.png", "1e300 rgb/1.png"])
def test_tum_lines_that_are_wrong_are_refused(tmp_path, line):
    path = write_tum(tmp_path / "scan", frames()[:1], grown(depth_maps())[:1])
    (path / "depth.txt").write_text(f"# depth\n{line}\n")
    with pytest.raises(CaptureError, match="line 2 is no time and file"):
        tum.recording(path)


def test_links_out_of_a_folder_are_refused(tmp_path):
    for write in (write_open3d, write_stray):
        path = write(tmp_path / write.__name__, frames()[:2], (
            grown(depth_maps()) if write is write_open3d else depth_maps())[:2])  # fmt: skip
        outside = tmp_path / f"{write.__name__}.png"
        shutil.move(path / "depth/000000.png", outside)
        (path / "depth/000000.png").symlink_to(outside)
        with pytest.raises(CaptureError, match="outside the folder"):
            load_capture(path)


# A phone that moves


def walked(i):
    """Two centimetres to the side over twelve frames."""
    return 0.1 + 0.02 * i / (COUNT - 1), 0.2, 0.3


def shaken(i):
    """What tracking says of a phone that stands: a tenth of a millimetre."""
    return 0.1 + 0.0001 * (i % 2), 0.2, 0.3


def test_a_phone_that_moved_is_warned_of(tmp_path):
    path = write_stray(tmp_path / "a", text=odometry(COUNT, place=walked))
    (finding,) = [f for f in load_capture(path).findings if f.code == "phone-moved"]
    # From frame 3, as near to most as any, to the last; 225 px of focal length, 0.75 m away.
    assert "moved by 15 mm and 0.0 degrees" in finding.message
    assert "by up to 4 pixels" in finding.message
    still = write_stray(tmp_path / "b", text=odometry(COUNT, place=shaken))
    assert "phone-moved" not in codes(still)
    angle = np.radians(3.0) / 2
    turn = [[0, np.sin(angle), 0, np.cos(angle), 0, 0, 0]] + [[0, 0, 0, 1, 0, 0, 0]] * (COUNT - 1)
    facts = metadata(COUNT, poses=turn)
    (finding,) = [
        f
        for f in load_capture(write_r3d(tmp_path / "c.r3d", r3d_members(facts))).findings
        if f.code == "phone-moved"
    ]
    assert "3.0 degrees" in finding.message
    assert "by up to 12 pixels" in finding.message  # 225 px of focal length


# What lies beside the frames

OWN = {"width": 16, "height": 12, "fx": 22.0, "fy": 22.5, "cx": 8.25, "cy": 5.75}
SHIFT_M = [0.03, 0.0, -0.002]


@pytest.mark.parametrize(
    ("read", "write"), [(open3d_recorder, write_open3d), (tum, write_tum)], ids=["Open3D", "TUM"]
)
def test_a_depth_camera_that_a_file_states_is_used(tmp_path, read, write):
    path = write(tmp_path / "a", depth_m=depth_maps())
    plain, _ = read.recording(path)
    (path / "depth_intrinsics.json").write_text(json.dumps(OWN))
    pose = {"rotation": np.eye(3).tolist(), "translation": SHIFT_M}
    (path / "depth_to_color.json").write_text(json.dumps(pose))
    made, _ = read.recording(path)
    assert made.depth_camera == Camera(**OWN)
    assert np.array_equal(made.depth_to_color.translation_m, SHIFT_M)
    more = [finding for finding in made.findings if finding not in plain.findings]
    assert [finding.code for finding in more] == ["depth-camera"]
    # Of another size, and beside depth that is registered, it is named.
    (path / "depth_intrinsics.json").write_text(json.dumps({**OWN, "width": 18}))
    made, _ = read.recording(path)
    assert (made.depth_camera, made.camera) == (plain.depth_camera, plain.camera)
    warning = next(finding for finding in made.findings if finding.code == "ignored-files")
    assert "for 18x12, the depth is 16x12" in warning.message
    registered = write(tmp_path / "b")
    whole = {"width": WIDTH, "height": HEIGHT, "fx": 165.0, "fy": 166.0, "cx": 60.0, "cy": 44.0}
    (registered / "depth_intrinsics.json").write_text(json.dumps(whole))
    made, _ = read.recording(registered)
    assert made.depth_camera is None
    warning = next(finding for finding in made.findings if finding.code == "ignored-files")
    assert "taken to be registered" in warning.message


def test_what_is_not_read_beside_frames_is_named(tmp_path):
    path = write_open3d(tmp_path / "a")
    for name in ("ambient.png", "flat.png", "lights.lp", "mask_old.png"):
        (path / name).write_bytes(png(frames()[0]))
    (path / "confidence").mkdir()
    (path / "mask.png").write_bytes(png(np.full((HEIGHT, WIDTH), 255, np.uint8)))
    (warning,) = (f for f in load_capture(path).findings if f.code == "ignored-files")
    assert warning.severity == "warning"
    assert "ambient.png, confidence, flat.png, lights.lp and 1 more" in warning.message


@pytest.mark.parametrize("write", [write_stray, write_scanner_app, write_polycam])
def test_what_an_app_writes_beside_its_frames_is_not_named(tmp_path, write):
    path = write(tmp_path / "a")
    assert "ignored-files" not in codes(path)
    (path / "ambient.png").write_bytes(png(frames()[0]))
    assert "ignored-files" in codes(path)


@pytest.mark.parametrize("write", [write_open3d, write_tum])
def test_a_depth_lens_that_folds_where_no_frame_has_depth_is_used(tmp_path, write):
    rows, columns = np.mgrid[: OWN["height"], : OWN["width"]]
    seen = np.hypot(columns - OWN["cx"], rows - OWN["cy"]) < 7
    facts = json.dumps({**OWN, "distortion": [-0.9, 0, 0, 0]})  # folds 9 pixels off
    everywhere_m = np.nan_to_num(depth_maps(), nan=0.6)
    path = write(tmp_path / "a", depth_m=np.where(seen, everywhere_m, np.nan))
    (path / "depth_intrinsics.json").write_text(facts)
    assert load_capture(path).depth_camera.distortion.coefficients[0] == -0.9
    path = write(tmp_path / "b", depth_m=everywhere_m)
    (path / "depth_intrinsics.json").write_text(facts)
    with pytest.raises(CaptureError, match="depth_camera: distortion folds inside"):
        load_capture(path)

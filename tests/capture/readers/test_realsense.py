"""RealSense recordings: what librealsense writes comes back bit by bit."""

import sqlite3
from dataclasses import replace

import cv2
import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from rakelight import load_capture
from rakelight.capture.images import encode_jpeg, encode_png
from rakelight.capture.readers import find_reader, realsense
from rakelight.capture.readers.ros_bag import opened
from rakelight.capture.readers.ros_pixels import color_of, depth_of
from rakelight.errors import CaptureError
from rakelight.geometry.distortion import to_pixels
from rakelight.model import Camera, RigidTransform
from tests.capture.readers.realsense_files import (
    CHANNELS,
    TILT,
    TURN,
    Take,
    jpegs,
    librealsense,
    some_color,
    some_depth,
    write_bag,
    write_db3,
)

WRITERS = {"rec.db3": write_db3, "rec.bag": write_bag}


def recording_of(path):
    """The recording and all frames of both its streams."""
    with opened(path) as bag:
        recording = realsense._recording(bag)
        frames = [
            np.stack([image for _, image in stream.walk(range(len(stream)))])
            for stream in (recording.color, recording.depth)
        ]
    return recording, *frames


def shown(form, pixels):
    """RGB of recorded pixels, by other ways than the reader's."""
    if form == "y8":
        return np.repeat(pixels, 3, axis=-1)
    if form in ("yuyv", "uyvy"):
        y, u, v = (pixels[..., 0], pixels[:, 0::2, 1], pixels[:, 1::2, 1])
        if form == "uyvy":
            y, u, v = (pixels[..., 1], pixels[:, 0::2, 0], pixels[:, 1::2, 0])
        y = 298 * (y.astype(int) - 16)
        u, v = (np.repeat(each.astype(int) - 128, 2, axis=1) for each in (u, v))
        rgb = np.stack([y + 409 * v, y - 100 * u - 208 * v, y + 516 * u], axis=-1)
        return np.clip((rgb + 128) >> 8, 0, 255).astype(np.uint8)
    return pixels[..., 2::-1] if form.startswith("bgr") else pixels[..., :3]


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("form", CHANNELS)
@pytest.mark.parametrize("compressed", [True, False])
def test_frames_come_back_bit_by_bit(tmp_path, name, form, compressed):
    take = Take(color=some_color(3, CHANNELS[form]), format=form, compressed=compressed)
    if name == "rec.bag":
        write_bag(tmp_path / name, take, compression="bz2" if compressed else "")
    else:
        write_db3(tmp_path / name, take)
    recording, color, depth_m = recording_of(tmp_path / name)
    assert recording.color.encoding == "srgb"
    expected = np.stack([shown(form, frame) for frame in take.color])
    off = np.abs(color.astype(int) - expected).max()
    assert off <= (1 if form in ("yuyv", "uyvy") else 0)
    values = np.stack(take.depth)
    assert np.array_equal(np.isnan(depth_m), values == 0)
    assert np.array_equal(np.nan_to_num(depth_m), (values * 0.001).astype(np.float32))


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("compressed", [True, False])
def test_colour_as_jpeg(tmp_path, name, compressed):
    smooth = [cv2.GaussianBlur(image, (0, 0), 4) for image in some_color(3)]
    take = Take(color=jpegs(smooth), format="mjpeg", compressed=compressed)
    WRITERS[name](tmp_path / name, take)
    _, color, _ = recording_of(tmp_path / name)
    assert np.abs(color.astype(int) - np.stack(smooth)).mean() < 2


def test_pictures_that_other_programs_packed():
    """JPEG and PNG as they are; depth with and without the 12 bytes of ROS before it."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    time = store.types["builtin_interfaces/msg/Time"](0, 0)
    header = store.types["std_msgs/msg/Header"](time, "0")

    def message(form, data):
        kind = store.types["sensor_msgs/msg/CompressedImage"]
        return kind(header, form, np.frombuffer(data, np.uint8))

    image = cv2.GaussianBlur(some_color(1)[0], (0, 0), 4)
    jpeg = message("rgb8; jpeg compressed bgr8", encode_jpeg(image, 97))
    assert np.abs(color_of(jpeg, "rec.db3").astype(int) - image).mean() < 2
    (values,) = some_depth(1)
    for form, before in (("mono16;png", b""), ("16UC1; compressedDepth png", bytes(12))):
        packed = message(form, before + encode_png(values))
        assert np.array_equal(depth_of(packed, "rec.db3"), values)
    with pytest.raises(CaptureError, match="this kind of picture is not read"):
        color_of(message("h264", b"abcd"), "rec.db3")


@pytest.mark.parametrize("name", WRITERS)
def test_cameras_and_their_places(tmp_path, name):
    take = Take()
    extrinsics = WRITERS[name](tmp_path / name, take)
    recording, *_ = recording_of(tmp_path / name)
    assert recording.camera == take.camera
    assert recording.depth_camera == take.depth_camera
    found = recording.depth_to_color
    assert np.allclose(found.rotation, TURN @ TILT, rtol=0, atol=2e-6)
    assert np.allclose(found.rotation @ found.rotation.T, np.eye(3), rtol=0, atol=1e-12)
    assert np.allclose(found.translation_m, [0.015, -0.002, 0.001], rtol=0, atol=1e-6)
    if extrinsics is not None:
        point = [0.1, 0.2, 0.7]
        theirs = librealsense().rs2_transform_point_to_point(extrinsics, point)
        assert np.allclose(found.rotation @ point + found.translation_m, theirs, atol=3e-6)


def test_both_places_relative_to_a_third(tmp_path):
    """As where infrared is the first stream: depth itself stands elsewhere."""
    write_db3(tmp_path / "rec.db3", Take())
    place = "rotation={};translation={}".format
    with sqlite3.connect(tmp_path / "rec.db3") as database:
        text = place("1,0,0,0,0,1,0,-1,0", "0.1,0.2,0.3").encode() + b"\0"
        data = b"\0\1\0\0" + len(text).to_bytes(4, "little") + text
        topic = "SELECT id FROM topics WHERE name LIKE '%Depth_0/tf/%'"
        database.execute(f"UPDATE messages SET data = ? WHERE topic_id = ({topic})", (data,))
    database.close()
    found = recording_of(tmp_path / "rec.db3")[0].depth_to_color
    third_to_depth = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    at = np.array([0.4, 0.5, 0.6])
    in_depth = third_to_depth @ at + [0.1, 0.2, 0.3]
    in_color = TURN @ TILT @ at + [0.015, -0.002, 0.001]
    assert np.allclose(found.rotation @ in_depth + found.translation_m, in_color, atol=5e-6)


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize(
    "model",
    ["brown_conrady", "inverse_brown_conrady", "modified_brown_conrady", "kannala_brandt4"],
)
def test_lens_distortion_is_that_of_librealsense(tmp_path, name, model):
    take = Take(model=model, coefficients=(0.1, -0.05, 0.002, -0.003, 0.02))
    WRITERS[name](tmp_path / name, take)
    camera = recording_of(tmp_path / name)[0].camera
    rs = librealsense()
    lens = rs.intrinsics()
    lens.width, lens.height = camera.width, camera.height
    lens.fx, lens.fy, lens.ppx, lens.ppy = camera.fx, camera.fy, camera.cx, camera.cy
    lens.model, lens.coeffs = getattr(rs.distortion, model), list(take.coefficients)
    for point in ([0.1, 0.2, 0.7], [-0.25, 0.1, 0.7], [0.2, -0.15, 0.6]):
        theirs = rs.rs2_project_point_to_pixel(lens, point)
        ours = to_pixels(np.array([point[0] / point[2]]), np.array([point[1] / point[2]]), camera)
        assert np.allclose(np.ravel(ours), theirs, rtol=0, atol=1e-4)
        plain = (camera.fx * point[0] / point[2] + camera.cx, camera.cy)
        assert abs(theirs[0] - plain[0]) > 0.01


@pytest.mark.parametrize("unit_m", [0.001, 0.0001, 0.00025])
@pytest.mark.parametrize("name", WRITERS)
def test_depth_units(tmp_path, name, unit_m):
    WRITERS[name](tmp_path / name, Take(unit_m=unit_m))
    depth_m = recording_of(tmp_path / name)[2]
    assert depth_m[0, 5, 7] == np.float32(607 * unit_m)


def test_the_unit_beside_the_frames_where_the_sensor_has_none(tmp_path):
    write_db3(tmp_path / "rec.db3", Take(unit_m=None, frame_unit_m=0.0005))
    assert recording_of(tmp_path / "rec.db3")[2][0, 5, 7] == np.float32(607 * 0.0005)


@pytest.mark.parametrize("name", WRITERS)
def test_times_rise_from_0(tmp_path, name):
    WRITERS[name](tmp_path / name, Take())
    recording = recording_of(tmp_path / name)[0]
    for times_s in (recording.color.times_s, recording.depth.times_s):
        assert (np.diff(times_s) > 0).all()
        assert 0 <= times_s[0] < times_s[-1] < 60
    if name == "rec.bag":
        assert np.allclose(recording.color.times_s, 0.033 * np.arange(4), atol=1e-9)


@pytest.mark.parametrize("name", WRITERS)
def test_only_the_frames_wanted_are_read(tmp_path, name, monkeypatch):
    WRITERS[name](tmp_path / name, Take())
    with opened(tmp_path / name) as bag:
        recording, read = realsense._recording(bag), []
        message = type(bag).message
        monkeypatch.setattr(
            type(bag), "message", lambda *args: read.append(args[2]) or message(*args)
        )
        walked = [number for number, _ in recording.color.walk([1, 3])]
    assert walked == read == [1, 3]


@pytest.mark.parametrize("name", WRITERS)
def test_found_by_content_and_nothing_is_left_beside_it(tmp_path, name):
    path = tmp_path / f"ünïcode? #1%20 {name}.txt"
    WRITERS[name](tmp_path / name, Take())
    (tmp_path / name).rename(path)
    before = path.read_bytes()
    reader = find_reader(path)
    assert (reader.name, reader.extra) == ("realsense", "recordings")
    recording_of(path)
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_bytes() == before


def test_other_databases_are_none(tmp_path):
    path = tmp_path / "other.db3"
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE topics (id)")
        database.execute("CREATE VIEW messages AS SELECT 1 AS id")
    database.close()
    assert not realsense.is_bag(path)
    assert not realsense.is_bag(tmp_path)


def test_a_view_in_a_recording_is_not_followed(tmp_path):
    path = tmp_path / "rec.db3"
    write_db3(path, Take())
    endless = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT"
    with sqlite3.connect(path) as database:
        database.execute("ALTER TABLE messages RENAME TO kept")
        database.execute(
            f"CREATE VIEW messages AS {endless} i AS id, 1 AS topic_id, i AS timestamp FROM n"
        )
    database.close()
    assert not realsense.is_bag(path)
    with pytest.raises(CaptureError, match="this recording is damaged"), opened(path):
        pass


@pytest.mark.parametrize(
    ("take", "what"),
    [
        (Take(color=[]), "no stream of colour with frames in it"),
        (Take(depth=[]), "no stream of depth with frames in it"),
        (Take(depth_to_color=None), "where the depth camera is is not in it"),
        (Take(unit_m=None), "the unit of the depth is not in it"),
        (Take(unit_m=0.5), "the unit of the depth is impossible .seen 0.5 m"),
        (
            Take(model="ftheta", coefficients=(0.1, 0, 0, 0, 0)),
            "an unknown model of lens distortion .*ftheta, .0.1",
        ),
    ],
)
def test_what_is_missing_is_named(tmp_path, take, what):
    write_db3(tmp_path / "rec.db3", take)
    with pytest.raises(CaptureError, match=what):
        recording_of(tmp_path / "rec.db3")


@pytest.mark.parametrize(
    ("leave_out", "what"),
    [
        ("Color_0/tf", "where the depth camera is is not in it"),
        ("Depth_Units", "the unit of the depth is not in it"),
        ("Depth_0/info", "a part is missing .needed /device_0/sensor_0/Depth_0/info/camera_info"),
        ("Depth_0/image", "no stream of depth with frames in it"),
    ],
)
def test_what_is_missing_of_a_bag(tmp_path, leave_out, what):
    write_bag(tmp_path / "rec.bag", Take(), leave_out=leave_out)
    with pytest.raises(CaptureError, match=what):
        recording_of(tmp_path / "rec.bag")


def test_a_frame_of_another_size(tmp_path):
    write_bag(tmp_path / "rec.bag", Take(camera=Camera(24, 24, 40.0, 40.0, 11.5, 11.5)))
    with pytest.raises(CaptureError, match=r"not that of its camera .seen 32 x 24, needed 24"):
        recording_of(tmp_path / "rec.bag")


def test_a_block_that_would_fill_the_memory(tmp_path, monkeypatch):
    monkeypatch.setattr("rakelight.capture.readers.ros_bag.LONGEST", 9000)
    write_bag(tmp_path / "rec.bag", Take(color=4 * [np.zeros_like(some_color()[0])]), "bz2")
    with pytest.raises(CaptureError, match=r"damaged .*too large"):
        recording_of(tmp_path / "rec.bag")


def test_zeros_in_the_matrix_are_not_lost(tmp_path):
    """A camera without rotation, the most usual: the identity, exactly."""
    take = replace(Take(), depth_to_color=RigidTransform(np.eye(3), np.array([0.015, 0.0, 0.0])))
    for name, write in WRITERS.items():
        write(tmp_path / name, take)
        found = recording_of(tmp_path / name)[0].depth_to_color
        assert np.array_equal(found.rotation, np.eye(3))
        assert np.allclose(found.translation_m, [0.015, 0, 0], rtol=0, atol=1e-9)


def test_opencv_has_the_yuv_of_librealsense():
    """Studio range, as both convert YUY2."""
    white = np.array([[[235, 128], [16, 128]]], np.uint8)
    assert cv2.cvtColor(white, cv2.COLOR_YUV2RGB_YUY2)[0, :, 0].tolist() == [255, 0]


def test_a_bag_without_a_realsense_camera_is_called_that(tmp_path):
    store = get_typestore(Stores.ROS1_NOETIC)
    kind = "std_msgs/msg/String"
    with Writer(tmp_path / "talk.bag") as writer:
        talk = writer.add_connection("/chatter", kind, typestore=store)
        writer.write(talk, 1, store.serialize_ros1(store.types[kind]("hello"), kind))
    with pytest.raises(CaptureError, match=r"no pictures of colour.*seen /chatter.*Fix: record"):
        load_capture(tmp_path / "talk.bag")


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_a_recording_that_was_cut_short_is_damaged(tmp_path, share):
    write_db3(tmp_path / "rec.db3", Take())
    data = (tmp_path / "rec.db3").read_bytes()
    (tmp_path / "rec.db3").write_bytes(data[: int(share * len(data))])
    with pytest.raises(CaptureError, match=r"rec\.db3.*damaged"):
        load_capture(tmp_path / "rec.db3")

"""What a camera's ROS node publishes, recorded by rosbag or ros2 bag, is read exactly."""

import cv2
import numpy as np
import pytest
from rosbags.rosbag2 import CompressionMode

from rakelight import load_capture
from rakelight.capture.images import encode_jpeg, encode_png
from rakelight.capture.readers import find_reader, realsense
from rakelight.capture.readers.ros_bag import opened
from rakelight.errors import CaptureError
from rakelight.model import Distortion
from tests.capture.readers.realsense_files import (
    CAMERA,
    DEPTH_CAMERA,
    PLACE,
    some_color,
    some_depth,
)
from tests.capture.readers.ros_files import (
    COLOR,
    COLOR_INFO,
    DEPTH,
    DEPTH_INFO,
    Messages,
    node,
    write_node,
)

WRITERS = ["rec.bag", "rec.db3", "rec.mcap"]


def read(path):
    """The recording, its colour and its depth."""
    with opened(path) as bag:
        recording = realsense._recording(bag)
        streams = recording.color, recording.depth
        return recording, *(
            np.stack([each for _, each in stream.walk(range(len(stream)))]) for stream in streams
        )


def metres(values):
    values = np.stack(values)
    return np.where(values > 0, values / 1000, np.nan).astype(np.float32)


@pytest.mark.parametrize("name", WRITERS)
def test_colour_depth_and_the_place_of_the_depth_camera(tmp_path, name):
    make = Messages(name == "rec.bag")
    path = write_node(tmp_path / name, node(make, aligned=True))
    assert find_reader(path).name == "realsense"
    recording, color, depth_m = read(path)
    assert np.array_equal(color, np.stack(some_color()))
    assert np.array_equal(depth_m, metres(some_depth()), equal_nan=True)
    assert (recording.camera, recording.depth_camera) == (CAMERA, DEPTH_CAMERA)
    assert np.allclose(recording.depth_to_color.rotation, PLACE.rotation, atol=1e-7)
    assert np.allclose(recording.depth_to_color.translation_m, PLACE.translation_m, atol=1e-7)
    assert np.allclose(recording.color.times_s, 0.033 * np.arange(4))


@pytest.mark.parametrize("name", WRITERS)
def test_aligned_depth_where_the_place_is_not_known(tmp_path, name):
    make = Messages(name == "rec.bag")
    path = write_node(tmp_path / name, node(make, aligned=True, tf=False))
    recording, _, depth_m = read(path)
    assert (recording.depth_camera, recording.depth_to_color) == (None, None)
    assert depth_m.shape[1:] == CAMERA.shape
    assert np.nanmedian(load_capture(path).depth_m) == pytest.approx(0.9, abs=0.01)


def test_depth_registered_by_the_node_under_its_own_name(tmp_path):
    """As Orbbec's node does: the frame of its pictures says so."""
    make = Messages(False)
    topics = node(make, tf=False)
    topics[DEPTH] = [make.image(e, "16UC1", "camera_color_optical_frame") for e in some_depth()]
    topics[DEPTH_INFO] = [make.info(CAMERA.resized(16, 12), "camera_color_optical_frame")]
    recording, _, _ = read(write_node(tmp_path / "rec.db3", topics))
    assert recording.depth_camera == CAMERA.resized(16, 12)
    assert np.array_equal(recording.depth_to_color.rotation, np.eye(3))


def test_depth_in_metres_and_in_other_forms(tmp_path):
    make = Messages(False)
    values = some_depth()
    want = metres(values)
    floats = [np.where(v > 0, v / 1000, np.nan).astype(np.float32) for v in values]
    frame, head = "d", bytes(12)
    quantised = [np.where(v > 0, 30000 / np.maximum(v, 1) * 1000 - 20, 0) for v in values]
    header = np.array([0], "<i4").tobytes() + np.array([30000.0, -20.0], "<f4").tobytes()
    forms = {
        "": [make.image(each, "32FC1", frame, padding=8) for each in floats],
        "be": [make.image(each, "32FC1", frame, big=True) for each in floats],
        "be16": [make.image(each, "16UC1", frame, padding=6, big=True) for each in values],
        "/compressed": [
            make.packed(encode_png(v), "16UC1; png compressed ", frame) for v in values
        ],
        "/compressedDepth": [
            make.packed(head + encode_png(v), "16UC1; compressedDepth png", frame) for v in values
        ],
        "/compressedDepth ": [
            make.packed(header + encode_png(v.astype(np.uint16)), "32FC1; compressedDepth", frame)
            for v in quantised
        ],
    }
    topics = node(make, tf=False)
    del topics[DEPTH]
    topics[COLOR_INFO] = [make.info(CAMERA, frame)]
    topics[COLOR] = [make.image(each, "rgb8", frame) for each in some_color()]
    for number, (form, messages) in enumerate(forms.items()):
        folder = tmp_path / str(number)
        folder.mkdir()
        name = DEPTH + (form.strip() if form.startswith("/") else "")
        path = write_node(folder / "rec.db3", topics | {name: messages})
        found = read(path)[2]
        assert np.array_equal(np.isnan(found), np.isnan(want)), form
        assert np.nanmax(np.abs(found - want)) < (3e-5 if "depth " in form.lower() else 1e-7), form


def test_colour_of_a_node_that_is_called_depth(tmp_path):
    topics = node(Messages(False))
    topics = {name.replace("/camera/", "/depth_camera/"): each for name, each in topics.items()}
    path = write_node(tmp_path / "rec.db3", topics)
    assert np.array_equal(read(path)[1], np.stack(some_color()))


def test_compressed_colour_is_taken_where_there_is_no_other(tmp_path):
    make = Messages(False)
    topics, frame = node(make), "camera_color_optical_frame"
    smooth = [cv2.GaussianBlur(each, (0, 0), 4) for each in some_color()]
    form = "rgb8; jpeg compressed bgr8"
    jpegs = [make.packed(encode_jpeg(each, 97), form, frame) for each in smooth]
    topics[COLOR + "/compressed"] = jpegs
    for name in ("both", "one"):
        (tmp_path / name).mkdir()
        color = read(write_node(tmp_path / name / "rec.db3", topics))[1]
        want = np.stack(some_color() if COLOR in topics else smooth)
        assert np.abs(color.astype(int) - want).mean() < (2 if name == "one" else 1e-9)
        topics.pop(COLOR, None)


K8 = (0.1, -0.2, 0.001, 0.002, 0.05, 0.3, -0.1, 0.02)
LENSES = [
    ("plumb_bob", K8[:5], Distortion("brown-conrady", K8[:5])),
    ("plumb_bob", K8, Distortion("brown-conrady", K8)),
    ("rational_polynomial", (*K8, 0.0, 0.0), Distortion("brown-conrady", K8)),
    ("equidistant", K8[:4], Distortion("kannala-brandt", K8[:4])),
    ("", (), None),
]


@pytest.mark.parametrize(("model", "D", "lens"), LENSES)
def test_the_lens(tmp_path, model, D, lens):
    make = Messages(False)
    topics = node(make)
    topics[COLOR_INFO] = [make.info(CAMERA, "c", model, D)]
    assert read(write_node(tmp_path / "rec.db3", topics))[0].camera.distortion == lens


def test_rectified_pictures_have_no_lens(tmp_path):
    make = Messages(False)
    topics = node(make)
    topics[COLOR_INFO] = [make.info(CAMERA, "c", D=K8[:5], P=CAMERA.matrix * [2, 2, 1])]
    topics["/camera/color/image_rect_color"] = topics.pop(COLOR)
    camera = read(write_node(tmp_path / "rec.db3", topics))[0].camera
    assert (camera.fx, camera.distortion) == (2 * CAMERA.fx, None)


PACKED = [
    ("rec.db3", CompressionMode.MESSAGE),
    ("rec.mcap", CompressionMode.MESSAGE),
    ("rec.mcap", CompressionMode.STORAGE),
]


@pytest.mark.parametrize(("name", "mode"), PACKED)
def test_messages_and_blocks_that_are_packed(tmp_path, name, mode):
    path = write_node(tmp_path / name, node(Messages(False)), mode)
    assert np.array_equal(read(path)[1], np.stack(some_color()))


def without(*names):
    def change(make):
        topics = node(make, tf="tf" not in names)
        return {k: v for k, v in topics.items() if k not in names}

    return change


def nameless(make):
    topics = node(make)
    for message in topics[COLOR] + topics[DEPTH]:
        message.header.frame_id = ""
    return topics


def described(model, D, K=None):
    def change(make):
        info = make.info(CAMERA, "c", model, D)
        if K is not None:
            info.k[:] = K
        return node(make) | {COLOR_INFO: [info]}

    return change


REFUSED = {
    "where the depth camera is is not in it.*seen /camera/depth": nameless,
    "the camera is not calibrated .seen /camera/color/camera_info": described("", (), 0.0),
    "another number of coefficients.*seen 3": described("plumb_bob", K8[:3]),
    "this lens distortion is not read.*thin": described("thin prism", K8),
    "a recording of the Orbbec SDK.*k4arecorder": lambda make: {
        f"/cam/sensor_{i}/frameType_{i}": node(make)[name] for i, name in enumerate((COLOR, DEPTH))
    },
    "no pictures of colour in it .*Fix: record its pictures": without(COLOR),
    "no pictures of depth in it .*Fix: record its pictures": without(DEPTH),
    "where the depth camera is is not in it.*switch the alignment": without("tf"),
    "a part is missing .needed /camera/color/camera_info": without(COLOR_INFO),
    "more than one camera of colour": lambda make: node(make) | {
        "/second/color/image_raw": node(make)[COLOR]
    },
    "more than one camera of colour.*/camera/depth/image_rect_raw": lambda make: node(make) | {
        DEPTH: [make.image(e, "rgb8", "d") for e in some_color()]  # by the node's colorizer
    },
    "this kind of picture is not read .seen bayer_rggb8": lambda make: node(make) | {
        COLOR: [make.image(e[..., 0], "bayer_rggb8", "camera_color_optical_frame")
                for e in some_color()]
    },
    "seen 16UC1; compressedDepth rvl": lambda make: without(DEPTH)(make) | {
        DEPTH + "/compressedDepth": [
            make.packed(bytes(40), "16UC1; compressedDepth rvl", "camera_depth_optical_frame")
        ]
    },
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_what_cannot_be_read_is_said_in_one_line(tmp_path, what):
    path = write_node(tmp_path / "rec.db3", REFUSED[what](Messages(False)))
    with pytest.raises(CaptureError, match=what) as caught:
        load_capture(path)
    assert str(caught.value).startswith(str(path))


def test_mcap_without_an_index_is_not_unpacked_to_find_one(tmp_path):
    path = write_node(tmp_path / "rec.mcap", node(Messages(False)))
    data = path.read_bytes()
    path.write_bytes(data[:-28] + bytes(8) + data[-20:])  # where the summary begins
    with pytest.raises(CaptureError, match=r"seen no index.*mcap recover rec\.mcap"):
        load_capture(path)

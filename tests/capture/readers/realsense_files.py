"""Recordings of a RealSense camera: .db3 by librealsense, .bag as its older versions wrote them."""

from __future__ import annotations

import gc
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from rakelight.capture.images import encode_jpeg
from rakelight.model import Camera, RigidTransform

CHANNELS = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "y8": 1, "yuyv": 2, "uyvy": 2}
JPEG_BYTES = 4  # per pixel of a frame into which a JPEG is put, zeros after it
BAG_ENCODINGS = {"mjpeg": "MJPEG", "y8": "8UC1", "yuyv": "YUYV", "uyvy": "yuv422"}
TURN = np.array([[0.96, -0.28, 0.0], [0.28, 0.96, 0.0], [0.0, 0.0, 1.0]])
TILT = np.array([[1.0, 0.0, 0.0], [0.0, 0.8, -0.6], [0.0, 0.6, 0.8]])

CAMERA = Camera(32, 24, 40.25, 40.5, 15.75, 11.25)
DEPTH_CAMERA = Camera(16, 12, 20.5, 20.75, 7.75, 5.5)
PLACE = RigidTransform(TURN @ TILT, np.array([0.015, -0.002, 0.001]))


def librealsense() -> Any:
    """The maker's own library; the test is skipped where it, or the system's libusb, is absent."""
    return pytest.importorskip("pyrealsense2", exc_type=ImportError)


def some_color(count: int = 4, channels: int = 3) -> list[np.ndarray]:
    random = np.random.default_rng(3)
    return list(random.integers(16, 240, (count, 24, 32, channels), np.uint8))


def jpegs(color: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Frames of the format "mjpeg" that hold images."""
    files = [np.frombuffer(encode_jpeg(image, 97), np.uint8) for image in color]
    height, width = color[0].shape[:2]
    size = height * width * JPEG_BYTES
    return [np.pad(each, (0, size - each.size)).reshape(height, width, -1) for each in files]


def some_depth(count: int = 4) -> list[np.ndarray]:
    """Millimetres of a disc before a wall, with holes."""
    rows, columns = np.mgrid[:12, :16]
    disc = (rows - 5.5) ** 2 + (columns - 7.5) ** 2 < 16
    depth = np.where(disc, 600 + columns, 900).astype(np.uint16)
    depth[0, :3] = 0
    return [depth + np.uint16(i) * (depth > 0) for i in range(count)]


@dataclass(frozen=True)
class Take:
    """What is recorded; depth_to_color None registers no extrinsics."""

    color: Sequence[np.ndarray] = field(default_factory=some_color)
    depth: Sequence[np.ndarray] = field(default_factory=some_depth)
    camera: Camera = CAMERA
    depth_camera: Camera = DEPTH_CAMERA
    depth_to_color: RigidTransform | None = PLACE
    format: str = "rgb8"
    unit_m: float | None = 0.001
    frame_unit_m: float = 0.0
    model: str = "brown_conrady"
    coefficients: tuple[float, ...] = (0.0,) * 5
    compressed: bool = True


def write_db3(path: Path, take: Take) -> Any:
    """Record with librealsense; returns the extrinsics depth -> colour as it has them."""
    rs = librealsense()
    device = rs.software_device()
    sensors = device.add_sensor("Stereo Module"), device.add_sensor("RGB Camera")
    of_depth = _profile(take, take.depth_camera, rs.stream.depth, rs.format.z16, 2, 0)
    form = getattr(rs.format, take.format)
    of_color = _profile(
        take, take.camera, rs.stream.color, form, CHANNELS.get(take.format, JPEG_BYTES), 1
    )
    profiles = [s.add_video_stream(p) for s, p in zip(sensors, (of_depth, of_color), strict=True)]
    if take.unit_m is not None:
        sensors[0].add_read_only_option(rs.option.depth_units, take.unit_m)
    extrinsics = None
    if take.depth_to_color is not None:
        extrinsics = rs.extrinsics()
        extrinsics.rotation = take.depth_to_color.rotation.T.ravel().tolist()  # by columns
        extrinsics.translation = take.depth_to_color.translation_m.tolist()
        profiles[0].register_extrinsics_to(profiles[1], extrinsics)
    recorder = rs.recorder(str(path), device, take.compressed)
    recorded = recorder.query_sensors()
    queue = rs.frame_queue(1, False)
    for sensor, profile in zip(recorded, profiles, strict=True):
        sensor.open(profile)
        sensor.start(queue)
    kept = []  # librealsense reads the pixels later
    for number in range(max(len(take.color), len(take.depth))):
        for of, frames in enumerate((take.depth, take.color)):
            if number < len(frames):
                kept.append(np.ascontiguousarray(frames[number]))
                _show(sensors[of], profiles[of], kept[-1], number, take)
    for sensor in recorded:
        sensor.stop()
        sensor.close()
    del recorder, recorded
    gc.collect()  # closes the file
    return extrinsics


def _profile(take, camera, stream, form, channels, uid):
    rs = librealsense()
    lens = rs.intrinsics()
    lens.width, lens.height = camera.width, camera.height
    lens.fx, lens.fy, lens.ppx, lens.ppy = camera.fx, camera.fy, camera.cx, camera.cy
    lens.model = getattr(rs.distortion, take.model)
    lens.coeffs = list(take.coefficients)
    video = rs.video_stream()
    video.type, video.index, video.uid, video.fps = stream, 0, uid, 30
    video.width, video.height, video.bpp, video.fmt = camera.width, camera.height, channels, form
    video.intrinsics = lens
    return video


def _show(sensor, profile, pixels, number, take):
    rs = librealsense()
    frame = rs.software_video_frame()
    frame.pixels, frame.stride = pixels, pixels.strides[0]
    frame.bpp = pixels.strides[1]
    frame.timestamp, frame.domain = 1000 + 33.3 * number, rs.timestamp_domain.hardware_clock
    frame.frame_number, frame.profile = number, profile.as_video_stream_profile()
    if pixels.dtype == np.uint16:
        frame.depth_units = take.frame_unit_m
    sensor.on_video_frame(frame)


def write_bag(path: Path, take: Take, compression: str = "lz4", leave_out: str = "-") -> None:
    """The topics of librealsense before 2026; without those whose name holds `leave_out`."""
    store = get_typestore(Stores.ROS1_NOETIC)
    new = {name.split("/")[-1]: kind for name, kind in store.types.items()}
    time = store.types["builtin_interfaces/msg/Time"](0, 0)
    header = store.types["std_msgs/msg/Header"](0, time, "0")
    turn = take.depth_to_color or RigidTransform(np.eye(3), np.zeros(3))
    streams = (
        ("sensor_0/Depth_0", take.depth_camera, take.depth, "mono16", np.eye(3), np.zeros(3)),
        (
            *("sensor_1/Color_0", take.camera, take.color),
            BAG_ENCODINGS.get(take.format, take.format),
            *(turn.rotation, turn.translation_m),
        ),
    )
    messages = [("sensor_0/option/Depth_Units/value", 0, new["Float32"](take.unit_m or 0.0))]
    for name, camera, frames, encoding, rotation, translation_m in streams:
        info = new["CameraInfo"](
            *(header, camera.height, camera.width, take.model.replace("_", " ").title()),
            D=np.array(take.coefficients, float),
            K=np.array([camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1]),
            R=np.zeros(9), P=np.zeros(12), binning_x=0, binning_y=0,
            roi=new["RegionOfInterest"](0, 0, 0, 0, False),
        )  # fmt: skip
        place = new["Transform"](new["Vector3"](*translation_m), _quaternion(new, rotation))
        messages += [(f"{name}/info/camera_info", 0, info), (f"{name}/tf/0", 0, place)]
        for number, frame in enumerate(frames):
            data = np.frombuffer(np.ascontiguousarray(frame).tobytes(), np.uint8)
            height, width = frame.shape[:2]
            step = data.size // height
            image = new["Image"](header, height, width, encoding, 0, step, data)
            messages.append((f"{name}/image/data", 1 + 33 * number, image))
    writer = Writer(path)
    if compression:
        writer.set_compression(Writer.CompressionFormat[compression.upper()])
    with writer:
        connections = {}
        for topic, time_ms, message in sorted(messages, key=lambda each: each[1]):
            if leave_out in topic:
                continue
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(
                    f"/device_0/{topic}", kind, typestore=store
                )
            data = store.serialize_ros1(message, kind)
            writer.write(connections[topic], 10**6 * time_ms, data)


def _quaternion(new, rotation):
    """As librealsense's rot2quat."""
    w = np.sqrt(1 + np.trace(rotation)) / 2
    x, y, z = ((rotation[i, j] - rotation[j, i]) / (4 * w) for i, j in ((2, 1), (0, 2), (1, 0)))
    return new["Quaternion"](x, y, z, w)

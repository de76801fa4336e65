"""Recordings as k4arecorder writes them: FFmpeg's own Matroska, every track as V_MS/VFW/FOURCC."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np

from rakelight.capture.images import encode_jpeg
from rakelight.model import Camera, RigidTransform

WIDTH, HEIGHT = 1280, 720
DEPTH_WIDTH, DEPTH_HEIGHT = 320, 288
FPS = 30
BROWN_CONRADY = "CALIBRATION_LensDistortionModelBrownConrady"
# A device's own numbers: cx, cy, fx, fy, k1 to k6, centre of distortion, p2, p1, radius.
COLOR_LENS = [
    0.4967627227306366, 0.5108628273010254, 0.470907062292099, 0.6274453997612, 0.7227460145950317,
    -2.8855903148651123, 1.6327226161956787, 0.6021990180015564, -2.7196261882781982,
    1.565053105354309, 0, 0, -0.0001431911950930953, 0.0007828465895727277, 1.7,
]  # fmt: skip
DEPTH_LENS = [
    0.5122697949409485, 0.49451231956481934, 0.4921168386936188, 0.4921667277812958,
    3.1305770874023438, 2.324939012527466, 0.1304156482219696, 3.458651542663574,
    3.350114583969116, 0.6629416346549988, 0, 0, -0.0000511557373101823, 0.00008132171933539212,
    1.74,
]  # fmt: skip
TILTED = RigidTransform(
    np.array([[1.0, 0.0, 0.0], [0.0, 0.96, 0.28], [0.0, -0.28, 0.96]]),
    np.array([-0.032, -0.002, 0.004]),
)


def listed_camera(location, lens, sensor, place=None, model=BROWN_CONRADY):
    """One entry of calibration.json."""
    place = place or RigidTransform(np.eye(3), np.zeros(3))
    return {
        "Intrinsics": {
            "ModelParameterCount": len(lens),
            "ModelParameters": lens,
            "ModelType": model,
        },
        "Location": location,
        "MetricRadius": 1.7,
        "Purpose": "CALIBRATION_CameraPurposePhotoVideo",
        "Rt": {
            "Rotation": place.rotation.ravel().tolist(),
            "Translation": place.translation_m.tolist(),
        },
        "SensorWidth": sensor[0],
        "SensorHeight": sensor[1],
    }


def calibration(
    color=COLOR_LENS, depth=DEPTH_LENS, place=TILTED, sensor=(4096, 3072), depth_place=None
):
    """The table of calibration.json, with the names that devices write and calibration.c reads."""
    of_depth = listed_camera("CALIBRATION_CameraLocationD0", depth, (1024, 1024), depth_place)
    of_color = listed_camera("CALIBRATION_CameraLocationPV0", color, sensor, place)
    return {"CalibrationInformation": {"Cameras": [of_depth, of_color], "InertialSensors": []}}


def plain_lens(camera: Camera, sensor_height: float, sensor_width: float, corner=(0.0, 0.0)):
    """ModelParameters of a camera without distortion, on a sensor in that camera's pixels."""
    cx, cy = camera.cx + corner[0] + 0.5, camera.cy + corner[1] + 0.5
    sides = (sensor_width, sensor_height) * 2
    numbers = (cx, cy, camera.fx, camera.fy)
    return [number / side for number, side in zip(numbers, sides, strict=True)] + [0.0] * 10 + [1.7]


def some_color(count=3):
    """(N, 720, 1280, 3) uint8 of smooth colours."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    image = np.stack([rows / 4 + 40, columns / 8 + 30, 200 - columns / 10], axis=-1)
    return np.stack([image + 4 * i for i in range(count)]).astype(np.uint8)


def some_depth(count=3):
    """(N, 288, 320) uint16 millimetres of a disc before a wall, with holes."""
    rows, columns = np.mgrid[:DEPTH_HEIGHT, :DEPTH_WIDTH]
    disc = (rows - 140) ** 2 + (columns - 150) ** 2 < 60**2
    values = np.where(disc, 600 + columns // 16, 900)
    values[:9, :30] = 0
    return np.stack([values + i * (values > 0) for i in range(count)]).astype(np.uint16)


def jpeg(image):
    return encode_jpeg(image, 95)


def nv12(image):
    """Studio range, BT.601."""
    planes = cv2.cvtColor(image, cv2.COLOR_RGB2YUV_I420)
    height = len(image)
    chroma = planes[height:].reshape(2, -1).T
    return planes[:height].tobytes() + np.ascontiguousarray(chroma).tobytes()


def yuy2(image):
    height, width = image.shape[:2]
    planes = np.frombuffer(nv12(image), np.uint8)
    chroma = planes[height * width :].reshape(height // 2, width).repeat(2, axis=0)
    return np.stack([planes[: height * width].reshape(height, width), chroma], -1).tobytes()


def bgra(image):
    return cv2.cvtColor(image, cv2.COLOR_RGB2BGRA).tobytes()


FORMS = {"MJPG": jpeg, "NV12": nv12, "YUY2": yuy2, "BGRA": bgra}


@dataclass(frozen=True)
class Take:
    """What is recorded; attached None attaches nothing."""

    color: Sequence[np.ndarray] = field(default_factory=some_color)
    depth: Sequence[np.ndarray] = field(default_factory=some_depth)
    form: str = "MJPG"
    attached: bytes | None = field(default_factory=lambda: json.dumps(calibration()).encode())
    titles: tuple[str, ...] = ("COLOR", "DEPTH", "IR")
    depth_form: str = "b16g"


def write_mkv(path: Path, take: Take | None = None) -> Path:
    """A recording; returns its path."""
    take = take or Take()
    encode = FORMS[take.form]
    sides = ((WIDTH, HEIGHT), *[(len(take.depth[0][0]), len(take.depth[0]))] * 2)
    if len(take.color):
        sides = ((take.color[0].shape[1], take.color[0].shape[0]), *sides[1:])
    options = {"allow_raw_vfw": "1", "write_crc32": "0", "fflags": "bitexact"}
    with av.open(str(path), "w", format="matroska", options=options) as container:
        streams = []
        for title, (width, height) in zip(take.titles, sides, strict=False):
            stream = container.add_stream("rawvideo", rate=FPS)
            stream.width, stream.height, stream.pix_fmt = width, height, "bgra"
            stream.metadata["title"] = title
            streams.append(stream)
        if take.attached is not None:
            kind = "application/octet-stream"
            container.add_attachment("calibration.json", kind, take.attached)
        for number in range(max(len(take.color), len(take.depth))):
            image = [encode(each) for each in take.color[number : number + 1]]
            values = [each.astype(">u2").tobytes() for each in take.depth[number : number + 1]]
            tracks = zip(streams, (image, values, values), strict=False)
            for stream, data in ((stream, data) for stream, some in tracks for data in some):
                packet = av.Packet(data)
                packet.stream, packet.time_base = stream, Fraction(1, FPS)
                packet.pts = packet.dts = number
                packet.is_keyframe = True
                container.mux(packet)
    data = bytearray(path.read_bytes())
    headers = re.finditer(rb"\x28\0\0\0.{8}\x01\0\x20\0(\0{4})", bytes(data), re.DOTALL)
    forms = (take.form, take.depth_form, take.depth_form)
    for _, header, form in zip(streams, headers, forms, strict=False):
        data[header.start(1) : header.end(1)] = form.encode()
    path.write_bytes(data)
    return path

"""Recordings of a camera's ROS node, as rosbag and ros2 bag write them."""

from __future__ import annotations

import shutil

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import CompressionFormat, StoragePlugin
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from tests.capture.readers.realsense_files import (
    CAMERA,
    DEPTH_CAMERA,
    PLACE,
    some_color,
    some_depth,
)

OPTICAL = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # of tf: x ahead, y left, z up
COLOR_INFO, DEPTH_INFO = "/camera/color/camera_info", "/camera/depth/camera_info"
COLOR, DEPTH = "/camera/color/image_raw", "/camera/depth/image_rect_raw"
ALIGNED = "/camera/aligned_depth_to_color/image_raw"


class Messages:
    """Makes and writes messages of ROS 1 or 2, by the name of the file."""

    def __init__(self, old):
        self.old = old
        self.store = get_typestore(Stores.ROS1_NOETIC if old else Stores.ROS2_HUMBLE)
        if old:
            text = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(get_types_from_msg(text, "tf2_msgs/msg/TFMessage"))

    def make(self, kind, *fields):
        names = {name.split("/")[-1]: name for name in self.store.types}
        names["Time"] = "builtin_interfaces/msg/Time"
        return self.store.types[names[kind]](*fields)

    def header(self, frame):
        time = self.make("Time", 0, 0)
        return self.make("Header", *([0] if self.old else []), time, frame)

    def image(self, pixels, encoding, frame, padding=0, big=False):
        height, width = pixels.shape[:2]
        rows = pixels.astype(pixels.dtype.newbyteorder(">" if big else "<")).tobytes()
        rows = np.frombuffer(rows, np.uint8).reshape(height, -1)
        rows = np.pad(rows, ((0, 0), (0, padding)))
        head = self.header(frame), height, width, encoding, int(big), rows.shape[1]
        return self.make("Image", *head, rows.ravel())

    def packed(self, data, form, frame):
        return self.make("CompressedImage", self.header(frame), form, np.frombuffer(data, np.uint8))

    def info(self, camera, frame, model="plumb_bob", D=(0.0,) * 5, P=None):
        K = camera.matrix.ravel()
        P = np.column_stack([camera.matrix if P is None else P, np.zeros(3)]).ravel()
        roi = self.make("RegionOfInterest", 0, 0, 0, 0, False)
        head = self.header(frame), camera.height, camera.width, model
        return self.make("CameraInfo", *head, np.array(D), K, np.eye(3).ravel(), P, 0, 0, roi)

    def transforms(self, *steps):
        """Of (parent, child, R, t): X_parent = R @ X_child + t."""
        made = []
        for parent, child, R, t in steps:
            w = np.sqrt(1 + np.trace(R)) / 2
            q = [(R[i, j] - R[j, i]) / (4 * w) for i, j in ((2, 1), (0, 2), (1, 0))]
            turn = self.make("Quaternion", *q, w)
            transform = self.make("Transform", self.make("Vector3", *t), turn)
            made.append(self.make("TransformStamped", self.header(parent), child, transform))
        return self.make("TFMessage", made)


def write_node(path, topics, mode=None):
    """A recording of `topics` {name: messages}, 33 ms apart; returns the file."""
    messages = Messages(path.suffix == ".bag")
    if messages.old:
        writer = rosbag1.Writer(path)
    else:
        storage = StoragePlugin.MCAP if path.suffix == ".mcap" else StoragePlugin.SQLITE3
        writer = rosbag2.Writer(path.parent / "folder", version=9, storage_plugin=storage)
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    store = messages.store
    with writer:
        for name, of_name in topics.items():
            kind = of_name[0].__msgtype__
            connection = writer.add_connection(name, kind, typestore=store)
            for i, message in enumerate(of_name):
                pack = store.serialize_ros1 if messages.old else store.serialize_cdr
                writer.write(connection, 10**9 + 33_000_000 * i, bytes(pack(message, kind)))
    if messages.old:
        return path
    (found,) = (p for p in (path.parent / "folder").iterdir() if p.suffix != ".yaml")
    found.rename(path)
    shutil.rmtree(path.parent / "folder")
    return path


def node(make, aligned=False, tf=True, place=PLACE):
    """The topics of realsense2_camera."""
    color, values = some_color(), some_depth()
    frames = ["camera_color_optical_frame", "camera_depth_optical_frame"]
    topics = {
        COLOR: [make.image(each, "rgb8", frames[0]) for each in color],
        COLOR_INFO: [make.info(CAMERA, frames[0])],
        DEPTH: [make.image(each, "16UC1", frames[1]) for each in values],
        DEPTH_INFO: [make.info(DEPTH_CAMERA, frames[1])],
        "/camera/infra1/image_rect_raw": [make.image(values[0].astype(np.uint8), "mono8", "i")],
    }
    if aligned:
        grown = [np.kron(each, np.ones((2, 2), np.uint16)) for each in values]
        topics[ALIGNED] = [make.image(each, "16UC1", frames[0]) for each in grown]
        topics[ALIGNED.replace("image_raw", "camera_info")] = topics[COLOR_INFO]
    if tf:
        turned = place.rotation.T  # colour to depth
        body = OPTICAL @ turned @ OPTICAL.T, OPTICAL @ (-turned @ place.translation_m)
        topics["/tf_static"] = [
            make.transforms(("camera_link", "camera_depth_frame", np.eye(3), [0.01, 0.02, 0.03])),
            make.transforms(
                ("camera_depth_frame", frames[1], OPTICAL, np.zeros(3)),
                ("camera_depth_frame", "camera_color_frame", *body),
                ("camera_color_frame", frames[0], OPTICAL, np.zeros(3)),
            ),
        ]
    return topics

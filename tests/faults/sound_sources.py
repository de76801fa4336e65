"""Small sound sources that are no capture folders: what is damaged of each, and what reads it."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import OpenEXR

from rakelight.capture import load_capture
from rakelight.capture.images import encode_jpeg, encode_png, encode_tiff
from rakelight.capture.readers import kinect_mkv
from rakelight.model import Camera, RigidTransform
from tests.capture.photo_files import dng, exr, heic, mosaic_of, pfm
from tests.capture.readers import test_known_lights as datasets
from tests.capture.readers.kinect_files import Take as KinectTake
from tests.capture.readers.kinect_files import some_color, some_depth, write_mkv
from tests.capture.readers.realsense_files import Take, write_bag
from tests.capture.readers.ros_files import Messages, node, write_node
from tests.capture.readers.test_photographs import fill
from tests.capture.readers.test_stated_depth_camera import snapshots
from tests.faults.sound_recordings import read_all

# Of a .mat: text with the time at which it was written.
_MAT_TEXT = 116


def source_kinds(folder: Path) -> list[tuple[str, Path, Callable[[], object]]]:
    """(name, file to damage, what reads the source) of each, written below the new `folder`."""
    folder.mkdir()
    kinect = KinectTake(color=some_color(1), depth=some_depth(1), titles=("COLOR", "DEPTH"))
    path = write_mkv(folder / "kinect.mkv", kinect)
    kinds = [
        ("kinect.mkv", path, partial(read_all, lambda p: (kinect_mkv.recording(p), None), path))
    ]

    path = folder / "realsense.bag"
    beside = RigidTransform(np.eye(3), np.array([0.015, 0.0, 0.0]))
    write_bag(path, Take(depth_to_color=beside))
    kinds.append(("realsense.bag", path, partial(load_capture, path)))

    path = write_node(folder / "node.mcap", node(Messages(old=False), place=beside))
    kinds.append(("node.mcap", path, partial(load_capture, path)))

    path = datasets.mat(folder / "set.mat")
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(_MAT_TEXT) + path.read_bytes()[_MAT_TEXT:])
    kinds.append(("set.mat", path, partial(load_capture, path)))

    folders = {
        datasets.diligent(folder / "diligent"): (
            *("filenames.txt", "light_directions.txt", "light_intensities.txt", "K.txt"),
        ),
        datasets.rti(folder / "rti"): ("dome.lp", "002.png"),
        photographs(folder / "photographs-npy", ".npy"): (
            "intrinsics.txt",
            "depth.npy",
            "img9.jpg",
        ),
        photographs(folder / "photographs-pfm", ".pfm"): ("depth.pfm",),
        depth_camera(folder / "photographs-two"): (
            "cameras.json",
            "depth_to_color.txt",
            "conf.png",
        ),
        viewer(folder / "photographs-viewer"): ("s1_Depth.raw", "s1_Depth_metadata.csv"),
        decoded_elsewhere(folder / "photographs-heic", ".heic"): ("img9.heic",),
        decoded_elsewhere(folder / "photographs-raw", ".dng"): ("img9.dng",),
        decoded_elsewhere(folder / "photographs-exr", ".exr"): ("img9.exr", "depth.exr"),
    }
    for place, names in folders.items():
        read = partial(load_capture, place)
        kinds += [(f"{place.name}/{name}", place / name, read) for name in names]
    return kinds


def decoded_elsewhere(folder: Path, suffix: str) -> Path:
    """Loose photographs that a library decodes in a process of its own; depth as EXR beside EXR."""
    made = fill(folder, depth=suffix != ".exr")
    for old, pixels in zip(sorted(folder.glob("*.png")), made.photographs, strict=True):
        old.unlink()
        new, light = old.with_suffix(suffix), (pixels / 255).astype(np.float16)
        if suffix == ".exr":
            exr(new, OpenEXR.PIZ_COMPRESSION, RGB=light)
        else:
            new.write_bytes(heic(pixels, 90) if suffix == ".heic" else dng(mosaic_of(light)))
    if suffix == ".exr":
        exr(folder / "depth.exr", Z=made.depth_m[0])
    return folder


def viewer(folder: Path) -> Path:
    """Snapshots of the RealSense Viewer."""
    snapshots(folder, Camera(20, 14, 22.0, 22.5, 9.25, 6.75))
    return folder


def depth_camera(folder: Path) -> Path:
    """Loose photographs, depth of a camera of its own, and how sure it is."""
    fill(folder, depth=False, texts=False)
    (folder / "depth.tiff").write_bytes(encode_tiff(np.full((14, 20), 0.6, np.float32)))
    sure = np.full((14, 20), 2, np.uint8)
    sure[0] = 0
    (folder / "conf.png").write_bytes(encode_png(sure))
    color = {"width": 32, "height": 24, "fx": 40, "fy": 40.5, "cx": 15.25, "cy": 11.75}
    depth = {"width": 20, "height": 14, "K": [[22, 0, 9.25], [0, 22.5, 6.75], [0, 0, 1]]}
    (folder / "cameras.json").write_text(json.dumps({"color": color, "depth": depth}))
    (folder / "depth_to_color.txt").write_text("1 0 0 0.015\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")
    return folder


def photographs(folder: Path, suffix: str) -> Path:
    """Loose JPEGs, with depth in another format than TIFF."""
    made = fill(folder, depth=False)
    for old, pixels in zip(sorted(folder.glob("*.png")), made.photographs, strict=True):
        old.unlink()
        old.with_suffix(".jpg").write_bytes(encode_jpeg(pixels, 95))
    depth = folder / f"depth{suffix}"
    if suffix == ".npy":
        np.save(depth, made.depth_m[0])
    else:
        depth.write_bytes(pfm(made.depth_m[0]))
    return folder

"""Small sound recordings of phones and recorders, and the files in them that fuzzing damages."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from rakelight.capture.readers import (
    open3d_recorder,
    polycam,
    record3d,
    scanner_app,
    stray_scanner,
    tum_rgbd,
)
from rakelight.capture.readers.tracking import moved_finding
from rakelight.errors import InputError
from rakelight.model import Camera, Capture
from tests.capture.readers import phone_sources as sources

WIDTH, HEIGHT = 32, 24
CAMERA = Camera(WIDTH, HEIGHT, 40.0, 40.5, 15.25, 11.75)
COUNT = 3
RANDOM = np.random.default_rng(9)
FRAMES = RANDOM.integers(40, 200, (COUNT, HEIGHT, WIDTH, 3), np.uint8)
COARSE = np.full((COUNT, 9, 12), 0.6, np.float32)  # 2 2/3 pixels of colour each
FINE = np.full((COUNT, HEIGHT, WIDTH), 0.6, np.float32)


def read_all(recording: Callable, path: Path) -> None:
    """Every frame, and whether the phone moved."""
    made, poses = recording(path)
    for stream in (made.color, made.depth):
        for _ in stream.walk(range(len(stream))):
            pass
    if poses is not None:
        capture = Capture(FRAMES, FINE, np.ones((HEIGHT, WIDTH), bool), made.camera)
        moved_finding(poses, capture, {})


def read_packed(path: Path, metadata: Path, members: dict[str, bytes]) -> None:
    """An .r3d with the metadata that lie beside it."""
    members = {**members, "metadata": metadata.read_bytes()}
    read_all(record3d.recording, sources.write_r3d(path, members))


def sniffed_and_read(path: Path) -> None:
    """An .r3d, where it is found to be one."""
    if not record3d.sniff(path):
        raise InputError("not found to be one")
    read_all(record3d.recording, path)


def recording_kinds(folder: Path) -> list[tuple[str, Path, Callable[[], object]]]:
    """(name, file to damage, what reads the recording) of each, written below the new `folder`."""
    folder.mkdir()
    facts = sources.metadata(COUNT, CAMERA, dw=12, dh=9)
    facts["perFrameIntrinsicCoeffs"] = [[40.0, 40.5, 15.25, 11.75]] * COUNT
    members = sources.r3d_members(facts, FRAMES, COARSE)
    packed = sources.write_r3d(folder / "scan.r3d", members)
    (folder / "metadata").write_bytes(members["metadata"])
    stray = sources.write_stray(folder / "stray", FRAMES, COARSE)
    (stray / "camera_matrix.csv").write_text(sources.matrix_text(CAMERA))
    open3d = sources.write_open3d(folder / "open3d", FRAMES, FINE, CAMERA, suffix="jpg")
    tum = sources.write_tum(folder / "tum", FRAMES, FINE, "40.0 40.5 15.25 11.75 0.01 0 0 0 0\n")
    app = sources.write_scanner_app(folder / "3d-scanner-app", FRAMES, COARSE, camera=CAMERA)
    raw = sources.write_polycam(folder / "polycam", FRAMES, COARSE)
    camera = f"keyframes/cameras/{293814600474 + 33000}.json"
    again = partial(read_packed, folder / "again.r3d", folder / "metadata", members)
    kinds = [("r3d", packed, partial(sniffed_and_read, packed))]
    kinds.append(("r3d/metadata", folder / "metadata", again))
    for place, recording, names in (
        (
            stray,
            stray_scanner.recording,
            ("rgb.mp4", "odometry.csv", "camera_matrix.csv", "confidence/000001.png"),
        ),
        (open3d, open3d_recorder.recording, ("camera_intrinsic.json", "color/000001.jpg")),
        (tum, tum_rgbd.recording, ("rgb.txt", "intrinsics.txt")),
        (app, scanner_app.recording, ("frame_00001.json", "depth_00001.png")),
        (raw, polycam.recording, (camera,)),
    ):
        read = partial(read_all, recording, place)
        kinds += [(f"{place.name}/{name}", place / name, read) for name in names]
    return kinds

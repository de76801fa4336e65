"""Stray Scanner's folder: rgb.mp4, depth/, confidence/, camera_matrix.csv, odometry.csv.

Facts: github.com/strayrobots/scanner, docs/format.md and the encoders in StrayScanner/Helpers.  All
is stored as the sensor sees it; the video's note of how the phone was held is left alone.  The
first frame lies before the time 0 of the video, whose edit list hides it: odometry.csv and depth/
count it.  Depth of recordings of 2021 is .npy, in millimetres too.  The only video in the folder is
read under another name, too: what a phone's files are copied with may rename it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rakelight.capture.listing import SUFFIXES, inside
from rakelight.capture.readers.base import Reader
from rakelight.capture.readers.depth_place import recording_of_one_view
from rakelight.capture.readers.image_files import (
    NPY,
    depth_stream,
    numbered_files,
    read_within,
)
from rakelight.capture.readers.numbers import camera_of
from rakelight.capture.readers.tracked_frames import middle_camera
from rakelight.capture.readers.tracking import Poses, reading_by
from rakelight.capture.readers.video_file import video_stream
from rakelight.capture.recording import Recording, Stream, nearest
from rakelight.errors import CaptureError, listed
from rakelight.files import MAX_TEXT_BYTES
from rakelight.model import Camera, Finding, Floats

VIDEO, MATRIX, ODOMETRY = "rgb.mp4", "camera_matrix.csv", "odometry.csv"
_VIDEOS = (".mp4", ".mov", ".m4v")
_PER_METRE = 1000.0
# The columns of odometry.csv without a header; recordings of early 2021 begin with the place.
_COLUMNS = ("timestamp", "frame", "x", "y", "z", "qx", "qy", "qz", "qw")
_COMPRESSED = Finding("note", "compressed", "frames are video; its compression looks like relief")


@dataclass(frozen=True)
class _Odometry:
    """The columns of odometry.csv by their names, (N,) each, NaN where a row has none."""

    columns: dict[str, Floats]
    rows: int

    def of(self, *names: str) -> Floats:
        """(N, len(names)) of some columns."""
        none = np.full(self.rows, np.nan)
        return np.stack([self.columns.get(name, none) for name in names], axis=-1)


def sniff(path: Path) -> bool:
    """Whether the folder holds the video and a file of its own.

    A video of another name beside photographs is not of a recording.
    """
    if (path / VIDEO).is_file():
        return (path / MATRIX).is_file() or (path / ODOMETRY).is_file()
    renamed = (path / ODOMETRY).is_file() and (path / "depth").is_dir() and bool(_videos(path))
    return renamed and not any(
        each.suffix.lower() in SUFFIXES and each.stem != "mask" for each in path.iterdir()
    )


def _videos(path: Path) -> list[str]:
    """Names of the videos in the folder, rgb.mp4 alone where it is there."""
    if (path / VIDEO).is_file():
        return [VIDEO]
    files = (each for each in path.iterdir() if each.suffix.lower() in _VIDEOS and each.is_file())
    return sorted(each.name for each in files if not each.name.startswith("."))


def _video(path: Path) -> str:
    """The name of the one video; raises CaptureError for several, of which none is rgb.mp4."""
    names = _videos(path)
    if len(names) > 1:
        raise CaptureError(
            "several videos", source=str(path), seen=listed(names), needed=VIDEO,
            remedy=f"name the one of this recording {VIDEO}",
        )  # fmt: skip
    return names[0] if names else VIDEO


def recording(path: Path) -> tuple[Recording, Poses | None]:
    """The recording in a folder."""
    video = _video(path)
    color = video_stream(inside(path, video), f"{path}/{video}", hidden=True)
    odometry = _odometry(path)
    camera = _camera(path, odometry, color.shape)
    color, depth, poses = _streams(path, color, odometry)
    made = recording_of_one_view(
        path,
        camera,
        color,
        depth,
        depth_source=f"{path}/depth",
        names=[f"{video} frame {number}" for number in range(len(color))],
        findings=[_COMPRESSED],
        beside=("confidence",),
    )
    return made, poses


def _table(path: Path, name: str) -> list[list[str]]:
    """The fields of every line that has some."""
    text = read_within(path, name, MAX_TEXT_BYTES).decode("utf-8-sig", "replace")
    rows = [[field.strip() for field in line.split(",")] for line in text.splitlines()]
    return [row for row in rows if any(row)]


def _number(field: str) -> float:
    """Of one field; NaN where it is none."""
    try:
        return float(field)
    except ValueError:
        return np.nan


def _odometry(path: Path) -> _Odometry | None:
    """None where there is no such file, or nothing in it."""
    if not (path / ODOMETRY).is_file():
        return None
    rows = _table(path, ODOMETRY)
    names = [field.lower() for field in rows[0]] if rows else []
    if "x" in names:
        rows = rows[1:]
    else:
        names = list(_COLUMNS if len(names) >= len(_COLUMNS) else _COLUMNS[2:])
    if rows and len(rows[-1]) < len(rows[0]):
        rows = rows[:-1]  # broken off while it was written
    if not rows:
        return None
    if any(len(row) < len(names) for row in rows):
        raise CaptureError(
            "a row is too short",
            source=f"{path}/{ODOMETRY}",
            needed=", ".join(names)[:200],
            remedy="copy the recording again",
        )
    columns = {name: np.array([_number(row[i]) for row in rows]) for i, name in enumerate(names)}
    return _Odometry(columns, len(rows))


def _camera(path: Path, odometry: _Odometry | None, shape: tuple[int, int]) -> Camera:
    """By the median of each frame's focal length and centre, if given: the focus moves them."""
    if odometry is not None:
        each = odometry.of("fx", "fy", "cx", "cy")
        each = each[np.isfinite(each).all(axis=1)]
        if len(each):
            return middle_camera(each.tolist(), shape, f"{path}/{ODOMETRY}")
    rows = [[_number(field) for field in row if field] for row in _table(path, MATRIX)]
    return camera_of(rows, shape, f"{path}/{MATRIX}", "the matrix")


def _streams(
    path: Path, color: Stream, odometry: _Odometry | None
) -> tuple[Stream, Stream, Poses | None]:
    """Colour and depth on one clock, and the pose of every colour frame.

    Row n of odometry.csv is of frame n of the video, and names the depth map of that moment.
    """
    names = numbered_files(path, "depth", (*SUFFIXES, NPY))
    start = min(names)
    times = {start + i: time for i, time in enumerate(color.times_s.tolist())}
    poses = None
    if odometry is not None:
        clock, numbers = odometry.of("timestamp", "frame").T
        if not np.isfinite(numbers).all():
            numbers = start + np.arange(odometry.rows)
        if not np.isfinite(clock).all():
            clock = color.times_s[: odometry.rows]
        rising = bool(np.all(np.diff(clock) > 0))
        if not rising or np.abs(numbers).max() > 1e15:
            raise CaptureError(
                "frame numbers that cannot be" if rising else "times that do not rise",
                source=f"{path}/{ODOMETRY}",
                needed="one per frame",
                remedy="copy the recording again",
            )
        times = dict(zip(numbers.astype(int).tolist(), (clock - clock[0]).tolist(), strict=False))
        if odometry.rows == len(color):
            color = Stream(clock - clock[0], color.shape, color.walk)
        rows = nearest(clock - clock[0], color.times_s)
        poses = Poses(odometry.of("x", "y", "z")[rows], odometry.of("qx", "qy", "qz", "qw")[rows])
    kept = sorted(set(names) & set(times), key=lambda number: times[number])
    if not kept:
        raise CaptureError(
            "no depth map belongs to a frame of the video", source=f"{path}/depth",
            seen=f"numbers {start} to {max(names)}", needed=f"those in {ODOMETRY}",
            remedy="copy the recording again, whole",
        )  # fmt: skip
    moments = np.array([times[number] for number in kept])
    sure = numbered_files(path, "confidence") if (path / "confidence").is_dir() else {}
    confidence = {i: sure[number] for i, number in enumerate(kept) if number in sure}
    depth = depth_stream(path, [names[number] for number in kept], moments, _PER_METRE, confidence)
    return color, depth, poses


READER = Reader(
    name="stray-scanner",
    reads="Stray Scanner's folder: rgb.mp4, depth/, odometry.csv",
    sniff=sniff,
    read=reading_by(recording),
    extra="recordings",
)

"""Recordings of an Azure Kinect, or of an Orbbec by its wrapper for that: k4arecorder's .mkv.

Facts: github.com/microsoft/Azure-Kinect-Sensor-SDK, src/record/sdk/record.cpp.  FFmpeg takes the
file apart and decodes nothing: colour is JPEG or raw, depth raw.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rakelight.capture.images import as_rgb, decode_image
from rakelight.capture.readers import kinect_calibration as calibration
from rakelight.capture.readers.base import Reader, Reading, Wanted
from rakelight.capture.readers.containers import (
    check_count,
    check_frame_size,
    damaged,
    demuxing,
    opened_container,
)
from rakelight.capture.readers.image_files import JPEG_FINDING, check_same
from rakelight.capture.readers.numbers import between
from rakelight.capture.recording import Recording, Stream, capture_of
from rakelight.errors import CaptureError
from rakelight.files import MAX_TEXT_BYTES
from rakelight.model import Array

_MAGIC = b"\x1aE\xdf\xa3"  # of EBML, of which Matroska is a kind that its header names
_HEADER = 64  # bytes in which the header names the kind; k4arecorder's has 40
_CALIBRATION = "calibration.json"
_AGAIN = "record colour and depth with k4arecorder"
_JPEG, _DEPTH = "MJPG", "b16g"
# Rows of bytes per row of pixels, bytes per pixel of a row, and how RGB is made of them.  Its YUV
# is BT.601 of studio range, as the SDK has it.
_RAW = {
    "NV12": (1.5, 1, cv2.COLOR_YUV2RGB_NV12),
    "YUY2": (1.0, 2, cv2.COLOR_YUV2RGB_YUY2),
    "BGRA": (1.0, 4, cv2.COLOR_BGRA2RGB),
}
_MILLIMETRES = 1000.0
# Frames left out from which the file's index is used: half a second at 30 a second.  The index has
# an entry every second or so, of the first track.
_SEEK = 15


@dataclass(frozen=True)
class _Track:
    """One track of frames.

    name : "colour" or "depth"; number : of its stream; form : of its frames, four letters
    pts : when they are shown, rising, in units of `unit_s` seconds
    """

    name: str
    number: int
    form: str
    shape: tuple[int, int]
    unit_s: float
    pts: tuple[int, ...] = ()


def sniff(path: Path) -> bool:
    """Whether a file is Matroska, by its first bytes."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        first = file.read(_HEADER)
    return first.startswith(_MAGIC) and b"matroska" in first


def read(path: Path, wanted: Wanted) -> Reading:
    """The capture made of a recording."""
    return capture_of(recording(path), wanted)


def recording(path: Path) -> Recording:
    """The recording in a file."""
    source = str(path)
    with opened_container(path, source, "matroska") as container:
        tracks = [_track(container, name, source) for name in ("colour", "depth")]
        data, name = _attached(container, source), f"{source}: {_CALIBRATION}"
        cameras = calibration.listed_cameras(data, name)
        of_color, of_depth = cameras[calibration.COLOR], cameras[calibration.DEPTH]
        camera = calibration.color_camera(of_color, tracks[0].shape, name)
        depth_camera = calibration.depth_camera(of_depth, tracks[1].shape, name)
        depth_to_color = between(
            calibration.place(of_depth, calibration.DEPTH, name),
            calibration.place(of_color, calibration.COLOR, name),
        )
        color, depth = _with_times(container, tracks, source)
    start_s = min(track.pts[0] * track.unit_s for track in (color, depth))
    return Recording(
        source=source,
        camera=camera,
        color=_stream(path, color, start_s, _color),
        depth=_stream(path, depth, start_s, _metres),
        depth_camera=depth_camera,
        depth_to_color=depth_to_color,
        findings=(JPEG_FINDING,) if color.form == _JPEG else (),
    )


def _track(container: Any, name: str, source: str) -> _Track:
    """The one track of a kind, by the title and the tag that k4arecorder gives it."""
    title = {"colour": "COLOR", "depth": "DEPTH"}[name]
    with demuxing(source):
        videos = {stream: dict(stream.metadata) for stream in container.streams.video}
    found = [
        stream
        for stream, facts in videos.items()
        if facts.get("title") == title or f"K4A_{title}_TRACK" in facts
    ]
    if len(found) != 1:
        raise CaptureError(
            f"{'no' if not found else 'more than one'} track of {name} in it",
            source=source,
            seen=", ".join(facts.get("title", "?") for facts in videos.values()) or "no video",
            needed=f"the track {title} of an Azure Kinect",
            remedy=_AGAIN,
        )
    (stream,) = found
    forms = (_JPEG, *_RAW) if name == "colour" else (_DEPTH,)
    with demuxing(source):
        codec = stream.codec_context
        form = "" if codec is None else str(codec.codec_tag)
        width, height = (0, 0) if codec is None else (codec.width, codec.height)
        unit_s = float(stream.time_base)
    if form not in forms or not unit_s > 0:
        raise CaptureError(
            f"this kind of {name} is not read",
            source=source,
            seen=form or "an unknown codec",
            needed=" or ".join(forms),
            remedy=_AGAIN,
        )
    check_frame_size(width, height, source)
    return _Track(name, stream.index, form, (height, width), unit_s)


def _attached(container: Any, source: str) -> bytes:
    """The bytes of calibration.json."""
    with demuxing(source):
        files = {file.name: file for file in container.streams.attachments}
        data = bytes(files[_CALIBRATION].data or b"") if _CALIBRATION in files else b""
    if not data or len(data) > MAX_TEXT_BYTES:
        raise CaptureError(
            "the calibration of the cameras is not in it",
            source=source,
            seen=f"{_CALIBRATION} of {len(data)} bytes"
            if _CALIBRATION in files
            else ", ".join(map(str, files)) or "nothing attached",
            needed=f"{_CALIBRATION} attached",
            remedy="record with k4arecorder; programs that convert recordings leave it out",
        )
    return data


def _with_times(container: Any, tracks: list[_Track], source: str) -> list[_Track]:
    """The tracks with the times of their frames, for which the file is read once."""
    shown: dict[int, set[int]] = {track.number: set() for track in tracks}
    with demuxing(source):
        for packet in container.demux([container.streams[number] for number in shown]):
            if packet.size and packet.pts is not None and not packet.is_corrupt:
                times = shown[packet.stream.index]
                times.add(packet.pts)
                check_count(len(times), source)
    for track in tracks:
        if not shown[track.number]:
            raise CaptureError(f"no {track.name} frames in it", source=source, remedy=_AGAIN)
    return [replace(track, pts=tuple(sorted(shown[track.number]))) for track in tracks]


def _stream(
    path: Path, track: _Track, start_s: float, pixels: Callable[[bytes, _Track, str], Array]
) -> Stream:
    def walk(wanted: Sequence[int]) -> Iterator[tuple[int, Array]]:
        left = list(wanted)
        for seeking in (True, False):  # a damaged index leads elsewhere
            with opened_container(path, str(path), "matroska") as container:
                for data in _packets(container, track, left, seeking, str(path)):
                    yield left[0], pixels(data, track, f"{path}, frame {left[0]} of {track.name}")
                    left = left[1:]
            if not left:
                return
        seen = f"frame {left[0]} of {track.name} cannot be found"
        raise damaged(str(path), seen)

    return Stream(np.array(track.pts) * track.unit_s - start_s, track.shape, walk)


def _packets(
    container: Any, track: _Track, wanted: Sequence[int], seeking: bool, source: str
) -> Iterator[bytes]:
    """The bytes of the wanted frames, up to the first that is not found.

    seeking : whether to go to far frames by the file's index
    """
    stream, before = container.streams[track.number], -1
    packets = container.demux(stream)
    for number in wanted:
        with demuxing(source):
            if seeking and number - before > _SEEK:
                try:
                    container.seek(track.pts[number], stream=stream)
                except (OSError, ValueError):  # as FFmpeg says that the index is of no use
                    return
                packets = container.demux(stream)
            later = (p for p in packets if p.pts is not None and p.pts >= track.pts[number])
            packet = next(later, None)
            data = bytes(packet) if packet is not None and packet.pts == track.pts[number] else b""
        if not data:
            return
        before = number
        yield data


def _color(data: bytes, track: _Track, source: str) -> Array:
    """(H, W, 3) uint8 RGB of a frame's bytes."""
    height, width = track.shape
    if track.form == _JPEG:
        pixels = as_rgb(decode_image(data, source))
        check_same(pixels, (height, width, 3), "uint8", source)
        return pixels
    rows, columns, how = _RAW[track.form]
    values = _values(data, int(rows * height) * width * columns, np.dtype(np.uint8), source)
    shape = (int(rows * height), width) if columns == 1 else (height, width, columns)
    return np.asarray(cv2.cvtColor(values.reshape(shape), how))


def _metres(data: bytes, track: _Track, source: str) -> Array:
    """(h, w) float32 metres of a frame's bytes, 16 bit with the high byte first; 0 is NaN."""
    height, width = track.shape
    values = _values(data, height * width, np.dtype(">u2"), source).reshape(height, width)
    return np.where(values > 0, values / _MILLIMETRES, np.nan).astype(np.float32)


def _values(data: bytes, count: int, dtype: np.dtype[Any], source: str) -> Array:
    if len(data) != count * dtype.itemsize:
        raise CaptureError(
            "its size is not what it says",
            source=source,
            seen=f"{len(data)} bytes",
            needed=f"{count * dtype.itemsize}",
            remedy=_AGAIN,
        )
    return np.frombuffer(data, dtype)


READER = Reader(
    "azure-kinect",
    "a recording of an Azure Kinect, or an Orbbec in its place: k4arecorder's .mkv",
    sniff,
    read,
    "recordings",
)

"""The frames of an mp4 or mov file, as stored: a phone's note of how it was held is ignored.

Depth beside a video is stored as the sensor sees it, and so is the video; only the note that
players follow turns it.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rakelight.capture.readers.containers import (
    DAMAGED,
    check_count,
    check_frame_size,
    damaged,
    demuxing,
    opened_container,
)
from rakelight.capture.recording import Stream
from rakelight.errors import CaptureError, parsing
from rakelight.extras import needs
from rakelight.model import Array

# Codes of ITU-T H.273: matrix, range, transfer, primaries.
_BT709, _BT601, _SMPTE240 = 1, (5, 6), 7
# Weights of red and blue in the luma, by the names of PyAV.
_WEIGHTS = {"ITU709": (0.2126, 0.0722), "ITU601": (0.299, 0.114), "SMPTE240M": (0.212, 0.087)}
_FULL_RANGE = 2
_HDR_TRANSFERS = {16: "PQ", 18: "HLG"}
_BT2020 = 9
# Height from which a video that does not name its matrix is BT.709, as players have it.
_HD_HEIGHT = 720


@dataclass(frozen=True)
class _Index:
    """Where the frames are: presentation times in the order in which they are shown.

    pts : in units of `unit_s` seconds; keys : those of the frames that decoding can start at
    """

    pts: list[int]
    keys: list[int]
    unit_s: float
    shape: tuple[int, int]


def video_stream(path: Path, source: str, hidden: bool = False) -> Stream:
    """The frames of a video, (H, W, 3) RGB, uint8, or uint16 where it has more than 8 bit.

    hidden : whether frames that the file's edit list hides from players count, too
    Colours are converted by the matrix and range that the video names.  Frames are decoded one
    after the other; where some are left out, from the key frame before the next.

    Raises CaptureError for a file that is damaged, no mp4 or mov, or high dynamic range (HLG, PQ,
    BT.2020), whose values are no plain sRGB; MissingExtraError where PyAV
    is not installed.
    """
    av = needs("av", "recordings", source)
    with _opened(path, source, hidden) as (container, stream):
        index = _indexed(container, stream, source)

    def walk(wanted: Sequence[int]) -> Iterator[tuple[int, Array]]:
        with _opened(path, source, hidden) as (container, stream):
            yield from _decoded(av, container, stream, index, wanted, source)

    times_s = (np.array(index.pts) - index.pts[0]) * index.unit_s
    return Stream(times_s, index.shape, walk)


@contextmanager
def _opened(path: Path, source: str, hidden: bool) -> Iterator[tuple[Any, Any]]:
    """The container and its video."""
    options = {"enable_drefs": "0", "ignore_editlist": str(int(hidden))}
    with opened_container(path, source, "mov", options) as container:
        if not container.streams.video:
            raise CaptureError("no video in it", source=source, remedy="copy the video again")
        stream = container.streams.video[0]
        if stream.codec_context is None:
            raise damaged(source, "an unknown codec")
        stream.thread_type = "AUTO"
        yield container, stream


def _indexed(container: Any, stream: Any, source: str) -> _Index:
    width, height = stream.codec_context.width, stream.codec_context.height
    check_frame_size(width, height, source)
    pts: set[int] = set()
    keys: set[int] = set()
    with demuxing(source):
        unit_s = float(stream.time_base)
        for packet in container.demux(stream):
            unshown = packet.pts is None or packet.is_corrupt or packet.is_discard
            if not packet.size or unshown:
                continue
            pts.add(packet.pts)
            if packet.is_keyframe:
                keys.add(packet.pts)
            check_count(len(pts), source)
    if not pts or not unit_s > 0:
        raise damaged(source, "no frames")
    return _Index(sorted(pts), sorted(keys), unit_s, (height, width))


def _decoded(
    av: Any, container: Any, stream: Any, index: _Index, wanted: Sequence[int], source: str
) -> Iterator[tuple[int, Array]]:
    frames = container.decode(stream)
    at, before = index.pts[0] - 1, -1  # of the last frame that was decoded
    for number in wanted:
        target = index.pts[number]
        key = bisect_right(index.keys, target) - 1
        if number > before + 1 and key >= 0 and index.keys[key] > at:
            with parsing(source, DAMAGED, CaptureError):
                container.seek(index.keys[key], stream=stream, backward=True)
                frames = container.decode(stream)
        before = number
        frame = None
        while at < target:
            with parsing(source, f"{DAMAGED}: frame {number} cannot be decoded", CaptureError):
                frame = next(frames, None)
            if frame is None:
                break
            at = frame.pts if frame.pts is not None else at
        if frame is None or at != target or frame.is_corrupt:
            raise damaged(source, f"frame {number} cannot be decoded")
        yield number, _rgb(av, frame, index.shape, f"{source} frame {number}")


def _rgb(av: Any, frame: Any, shape: tuple[int, int], source: str) -> Array:
    if frame.color_trc in _HDR_TRANSFERS or _BT2020 in (frame.color_primaries, frame.colorspace):
        raise CaptureError(
            "a video of high dynamic range",
            source=source,
            seen=_HDR_TRANSFERS.get(frame.color_trc, "BT.2020"),
            needed="standard dynamic range (BT.709)",
            remedy="switch HDR video off in the camera's settings",
        )
    if (frame.height, frame.width) != shape:
        raise CaptureError(
            "the frames are of different sizes",
            source=source,
            seen=f"{frame.width}x{frame.height}",
            needed=f"{shape[1]}x{shape[0]}",
            remedy="record it again without turning the phone",
        )
    reformatter = av.video.reformatter
    full = frame.color_range == _FULL_RANGE or frame.format.name.startswith("yuvj")
    ranges = reformatter.ColorRange
    how = reformatter.Interpolation
    exact = how.BILINEAR | how.ACCURATE_RND | how.FULL_CHR_H_INT
    stated, matrix = ranges.JPEG if full else ranges.MPEG, _matrix(frame)
    with parsing(source, DAMAGED, CaptureError):
        bits = max(component.bits for component in frame.format.components)
        if bits > 8 and not frame.format.is_rgb:
            # FFmpeg 8.1 makes RGB of it that is wrong by 6 of 255; by 180 if it is to be exact.
            yuv = frame.to_ndarray(
                format="yuv444p16le",
                src_color_range=stated,
                dst_color_range=stated,
                interpolation=exact,
            )
            return _deep_rgb(yuv, bits, full, _WEIGHTS[matrix])
        pixels = frame.to_ndarray(
            format="rgb48" if bits > 8 else "rgb24",
            src_colorspace=getattr(reformatter.Colorspace, matrix),
            src_color_range=stated,
            dst_color_range=ranges.JPEG,
            interpolation=how.BILINEAR if bits > 8 else exact,
        )
    return np.ascontiguousarray(pixels)


def _deep_rgb(yuv: Array, bits: int, full: bool, weights: tuple[float, float]) -> Array:
    """(H, W, 3) uint16 RGB of values with `bits` bits, which are the upper ones of 16.

    weights : of red and blue in the luma
    """
    top = (2**bits - 1) << (16 - bits)
    black, luma, chroma = (0, top, top) if full else (16 << 8, 219 << 8, 224 << 8)
    of_red, of_blue = weights
    of_green = 1 - of_red - of_blue
    blue, red = 2 * (1 - of_blue) / chroma, 2 * (1 - of_red) / chroma
    to_rgb = np.array(
        [
            [1 / luma, 0, red],
            [1 / luma, -blue * of_blue / of_green, -red * of_red / of_green],
            [1 / luma, blue, 0],
        ]
    )
    zero = to_rgb @ [black, 1 << 15, 1 << 15]
    # Rounded and clipped to 16 bits by OpenCV, in one pass.
    return np.asarray(cv2.transform(yuv, 65535 * np.column_stack([to_rgb, -zero])))


def _matrix(frame: Any) -> str:
    """Its name, as PyAV has it."""
    if frame.colorspace == _BT709:
        return "ITU709"
    if frame.colorspace in _BT601:
        return "ITU601"
    if frame.colorspace == _SMPTE240:
        return "SMPTE240M"
    return "ITU709" if frame.height >= _HD_HEIGHT else "ITU601"

"""Containers of video, opened by FFmpeg through our own file: it opens nothing else by itself."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rakelight.errors import CaptureError, parsing
from rakelight.extras import needs
from rakelight.files import clear_errors, open_regular

# Pixels of a frame, at most: 8K.  A decoder keeps 17 frames of what a damaged header states.
MOST_PIXELS = 36_000_000
# Frames of a video, at most: 9 hours at 30 a second.
MOST_FRAMES = 1_000_000
# Tracks whose decoders are limited to MOST_PIXELS; recorders write up to four and attachments.
_TRACKS = 8
DAMAGED = "the video is damaged"


def damaged(source: str, how: str) -> CaptureError:
    """The error of a video that is broken."""
    return CaptureError(
        DAMAGED, source=source, seen=how, remedy="copy it again, or record it again"
    )


@contextmanager
def opened_container(
    path: Path, source: str, form: str, options: Mapping[str, str] | None = None
) -> Iterator[Any]:
    """PyAV's container of a file in FFmpeg's format `form`, closed in the end.

    options : of FFmpeg's demuxer

    Raises CaptureError for a file that is damaged or of another format, MissingExtraError where
    PyAV is not installed.
    """
    av = needs("av", "recordings", source)
    with clear_errors(source, "cannot be read"):
        file = open_regular(path, source)
    with file:
        with demuxing(source):
            container = av.open(
                file,
                format=form,
                metadata_errors="replace",
                options=dict(options or {}),
                stream_options=[{"max_pixels": str(MOST_PIXELS)}] * _TRACKS,
            )
        with container:
            yield container


@contextmanager
def demuxing(source: str) -> Iterator[None]:
    """Turn FFmpeg's errors about a container into ours."""
    with parsing(source, DAMAGED, CaptureError):
        try:
            yield
        except MemoryError as error:  # FFmpeg's word for what states an impossible length
            raise damaged(source, "an impossible length") from error


def check_frame_size(width: int, height: int, source: str) -> None:
    """Raise CaptureError for frames of no or too many pixels.

    >>> check_frame_size(0, 480, "a.mp4")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: a.mp4: the video is damaged (seen a size of 0x480). Fix: ...
    """
    if not (0 < width * height <= MOST_PIXELS):
        raise damaged(source, f"a size of {width}x{height}")


def check_count(frames: int, source: str) -> None:
    """Raise CaptureError for more frames than are read.

    >>> check_count(1800, "a.mp4")
    """
    if frames > MOST_FRAMES:
        raise CaptureError(
            "the video is too long",
            source=source,
            seen=f"{frames}+",
            remedy="cut it to the part with the lamp",
        )

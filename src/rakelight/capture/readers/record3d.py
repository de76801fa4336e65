"""Record3D's .r3d: a ZIP of JPEG frames, LZFSE depth and confidence, and metadata.

Facts: github.com/marek-simonik/record3d, issues 7, 27 and 93.  Members are read by name and never
extracted.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rakelight.capture.headers import MAX_PIXELS, Header, read_header
from rakelight.capture.images import as_rgb, decode_image
from rakelight.capture.readers.base import Reader
from rakelight.capture.readers.depth_place import recording_of_one_view
from rakelight.capture.readers.image_files import check_same, compressed_finding
from rakelight.capture.readers.lzfse_blocks import stated_size, unpack
from rakelight.capture.readers.numbers import array_of, camera_of, json_table, number_in
from rakelight.capture.readers.r3d_archive import (
    EXPORT_AGAIN,
    MOST_FRAME,
    MOST_MAP,
    Archive,
    listed_frames,
    metadata_in,
    opened_zip,
)
from rakelight.capture.readers.tracked_frames import rising_times
from rakelight.capture.readers.tracking import Poses, reading_by
from rakelight.capture.recording import Recording, Stream
from rakelight.errors import CaptureError, InputError, parsing
from rakelight.files import MAX_TEXT_BYTES
from rakelight.model import Array, Camera, Finding, Floats

# Frames per second of the app, where metadata do not say.
_FPS = 60.0
# EXIF: quarter turns to the left by which a picture is to be turned, of stored and shown sides.
_TURNS = {6: 3, 8: 1}


def sniff(path: Path) -> bool:
    """Whether it is a ZIP with metadata and rgbd/."""
    if not path.is_file():
        return False
    try:
        with opened_zip(path) as opened:
            return metadata_in(opened.namelist()) is not None
    except InputError:
        return False


def recording(path: Path) -> tuple[Recording, Poses | None]:
    """The recording in an .r3d."""
    with opened_zip(path) as opened:
        archive = listed_frames(path, opened)
        metadata = f"{path}/{archive.metadata}"
        facts = json_table(archive.read(opened, archive.metadata, MAX_TEXT_BYTES), metadata)
        first = next(iter(archive.color.values()))
        header = read_header(archive.read(opened, first, MOST_FRAME), f"{path}/{first}")
        camera, turns = _camera(facts, header, metadata)
        shape = _depth_shape(facts, archive, opened, camera)
    color, depth = sorted(archive.color), sorted(archive.depth)
    made = recording_of_one_view(
        path,
        camera,
        Stream(_times(facts, color), camera.shape, _color_walk(archive, color, camera, turns)),
        Stream(_times(facts, depth), shape, _depth_walk(archive, depth, shape)),
        depth_source=str(path),
        names=[archive.color[number] for number in color],
        findings=(*compressed_finding([first]), *_turned_finding(header, turns)),
    )
    return made, _poses(facts, color, metadata)


def _camera(facts: Mapping[str, Any], header: Header, source: str) -> tuple[Camera, int]:
    """The camera of the frames, and the quarter turns to the left that they need.

    Metadata state w and h, which may be those of smaller frames, or exchanged.
    """
    width = int(number_in(facts.get("w"), 1, 1e5) or header.width)
    height = int(number_in(facts.get("h"), 1, 1e5) or header.height)
    turned = _turned(width, height, header.width, header.height)
    turns = _TURNS.get(header.orientation, 0) if turned else 0
    frames = (header.height, header.width) if turns else (header.width, header.height)
    shape = (width, height) if turned and not turns else (height, width)
    return _resized(camera_of(_matrix(facts, source), shape, source, "K"), *frames, source), turns


def _turned(width: int, height: int, stored_width: int, stored_height: int) -> bool:
    """Whether one is portrait and the other landscape."""
    return (width - height) * (stored_width - stored_height) < 0


def _resized(camera: Camera, width: int, height: int, source: str) -> Camera:
    if abs(camera.width * height - camera.height * width) > max(camera.width, camera.height):
        raise CaptureError(
            "K is for an image of other proportions",
            source=source,
            seen=f"w, h = {camera.width}, {camera.height}; frames of {width}x{height}",
            needed="the same proportions",
            remedy=EXPORT_AGAIN,
        )
    return camera.resized(width, height)


def _matrix(facts: Mapping[str, Any], source: str) -> object:
    """K; by the median of each frame's own focal length and centre, where there are any."""
    each = facts.get("perFrameIntrinsicCoeffs")
    if not isinstance(each, list) or not each:
        return facts.get("K")
    with parsing(source, "perFrameIntrinsicCoeffs are not four numbers each", CaptureError):
        fx, fy, cx, cy = np.median(np.array([row[:4] for row in each], np.float64), axis=0)
    return [fx, 0.0, 0.0, 0.0, fy, 0.0, cx, cy, 1.0]


def _depth_shape(
    facts: Mapping[str, Any], archive: Archive, opened: zipfile.ZipFile, camera: Camera
) -> tuple[int, int]:
    """(dh, dw); of metadata without them, what fits the first map's size and the frames' sides."""
    width, height = (number_in(facts.get(key), 1, 1e5) for key in ("dw", "dh"))
    if width is None or height is None:
        name = next(iter(archive.depth.values()))
        source = f"{archive.path}/{name}"
        count = stated_size(archive.read(opened, name, MOST_MAP), source) // 4
        width = round((count * camera.width / camera.height) ** 0.5)
        height = count // max(width, 1)
        if width * height != count:
            raise CaptureError(
                "the size of the depth is not known",
                source=f"{archive.path}/{archive.metadata}",
                seen=f"no dw and dh, {count} values",
                needed="dw and dh",
                remedy=EXPORT_AGAIN,
            )
    if width * height > MAX_PIXELS // 20:
        raise CaptureError(
            "the depth is too large",
            source=archive.source,
            seen=f"{width:g}x{height:g}",
            remedy=EXPORT_AGAIN,
        )
    return int(height), int(width)


def _times(facts: Mapping[str, Any], numbers: Sequence[int]) -> Floats:
    """Seconds of the frames: as stated where they rise, else by the frame rate."""
    stated = facts.get("frameTimestamps")
    known = stated if isinstance(stated, list) and len(stated) > numbers[-1] else []
    times = [number_in(known[number], -1e12, 1e12) for number in numbers] if known else [None]
    return rising_times(times, numbers, number_in(facts.get("fps"), 0.1, 1000) or _FPS)


def _poses(facts: Mapping[str, Any], numbers: Sequence[int], source: str) -> Poses | None:
    """Of qx, qy, qz, qw, x, y, z per frame; some exporters write the place first."""
    stated = facts.get("poses")
    if not isinstance(stated, list) or len(stated) <= numbers[-1]:
        return None
    rows = array_of([stated[number] for number in numbers], source, "poses", columns=7)
    with np.errstate(over="ignore"):
        first, last = (np.abs(np.linalg.norm(q, axis=1) - 1) for q in (rows[:, :4], rows[:, 3:]))
    if np.median(last) < 0.01 < np.median(first):
        rows = rows[:, [3, 4, 5, 6, 0, 1, 2]]
    return Poses(positions_m=rows[:, 4:], quaternions=rows[:, :4])


def _color_walk(archive: Archive, numbers: Sequence[int], camera: Camera, turns: int) -> Any:
    def walk(wanted: Sequence[int]) -> Iterator[tuple[int, Array]]:
        with opened_zip(archive.path) as opened:
            for at in wanted:
                name = archive.color[numbers[at]]
                source = f"{archive.path}/{name}"
                pixels = decode_image(archive.read(opened, name, MOST_FRAME), source)
                pixels = np.ascontiguousarray(np.rot90(as_rgb(pixels), turns))
                check_same(pixels, (*camera.shape, 3), "uint8", source)
                yield at, pixels

    return walk


def _depth_walk(archive: Archive, numbers: Sequence[int], shape: tuple[int, int]) -> Any:
    count = shape[0] * shape[1]

    def walk(wanted: Sequence[int]) -> Iterator[tuple[int, Array]]:
        with opened_zip(archive.path) as opened:

            def unpacked(name: str, size: int) -> bytes:
                return unpack(archive.read(opened, name, MOST_MAP), size, f"{archive.path}/{name}")

            for at in wanted:
                number = numbers[at]
                metres = np.frombuffer(unpacked(archive.depth[number], 4 * count), "<f4")
                measured = np.isfinite(metres) & (metres > 0)
                if number in archive.confidence:
                    sure = np.frombuffer(unpacked(archive.confidence[number], count), np.uint8)
                    measured &= sure > 0
                yield at, np.where(measured, metres, np.float32(np.nan)).reshape(shape)

    return walk


def _turned_finding(header: Header, turns: int) -> tuple[Finding, ...]:
    if header.orientation == 1 or turns:
        return ()
    message = "rgbd: EXIF orientation ignored: the frames are the way up that w and h say"
    return (Finding("note", "exif-orientation", message),)


READER = Reader(
    "record3d",
    "Record3D's .r3d, of a phone's LiDAR or face camera",
    sniff,
    reading_by(recording),
    "recordings",
)

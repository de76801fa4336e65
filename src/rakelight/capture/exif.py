"""What EXIF says of lens and exposure: of JPEG, PNG, TIFF and the raw files that are TIFFs."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from rakelight.capture.headers import PNG_MAGIC, png_chunks
from rakelight.errors import CaptureError
from rakelight.model import Camera

# Half the range, relative, in which the focal length in pixels lies when EXIF gives it: 35 mm
# equivalents are whole millimetres (2 % at 26), lenses move when they focus (f / distance, 2 % of a
# 26 mm equivalent's 6 mm at 0.3 m, more for cameras), and firmware crops some without saying so.
ROUGHNESS = 0.05
# Longer side over shorter of nearly all sensors, and the share by which images of whole ones are
# off these (4928x3264 by 0.7 %, a mosaic with its margins, 5344x3516, by 1.3 %).
_SENSORS, _SAME_PROPORTIONS = (4 / 3, 3 / 2), 0.02
_LONGEST = 3.0  # longer side over shorter, beyond that of all cameras (65:24): EXIF that is wrong
_FILM_DIAGONAL_MM = math.hypot(36.0, 24.0)  # 35 mm equivalents are by the diagonal (CIPA DCG-001)
_AGREEING = 0.15  # focal plane resolutions of firmware that differ by more are wrong
_FOCAL_PER_SIDE = (0.2, 50.0)  # over the longer side: 136 and 1 degrees
_UNITS_MM = {2: 25.4, 3: 10.0, 4: 1.0}  # FocalPlaneResolutionUnit: inch, centimetre, millimetre
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 7: 1, 9: 4, 10: 8}  # bytes of each type of value
_MAKE, _ORIENTATION, _EXIF = 271, 274, 34665
_FOCAL_MM, _FOCAL_35MM, _PLANE_X, _PLANE_UNIT = 37386, 41989, 41486, 41488
_WIDTH, _HEIGHT = 40962, 40963  # of the image that the resolution is of
_TIME_S, _F_NUMBER, _ISO, _FLASH = 33434, 33437, 34855, 37385
_READ = {
    _ORIENTATION, _EXIF, _FOCAL_MM, _FOCAL_35MM, _PLANE_X, _PLANE_UNIT, _WIDTH, _HEIGHT,
    _TIME_S, _F_NUMBER, _ISO, _FLASH,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Exif:
    """What is used of an EXIF block; 0 where it does not say.

    orientation : 1 = as stored
    focal_mm, focal_35mm : of the lens, and of the lens for 35 mm film with this field of view
    pixels_per_mm : on the sensor, of an image with the sides `longer`, `shorter` (0: of this one)
    exposure : how bright it shows light, beside others: seconds * ISO / f-number^2; of a flash that
        has fired ISO / f-number^2, since that is shorter than any exposure
    """

    orientation: int = 1
    focal_mm: float = 0.0
    focal_35mm: float = 0.0
    pixels_per_mm: float = 0.0
    longer: int = 0
    shorter: int = 0
    exposure: float = 0.0


def exif_of(data: bytes) -> Exif:
    """Of an image file: JPEG, PNG, TIFF or a raw file that is a TIFF; empty where it has none."""
    if data.startswith((b"II", b"MM")):
        return parse_exif(data)
    if data.startswith(b"\xff\xd8"):
        at = data.find(b"Exif\0\0", 0, 200_000)
        return parse_exif(data[at + 6 : at + 65_600]) if at >= 0 else Exif()
    if data.startswith(PNG_MAGIC):
        try:
            for kind, start, end in png_chunks(data):
                if kind == b"eXIf":
                    return parse_exif(data[start + 8 : end - 4])
        except CaptureError:
            return Exif()
    return Exif()


def parse_exif(block: bytes) -> Exif:
    """Of an EXIF block, which is a small TIFF; empty where it cannot be read.

    >>> parse_exif(b"no such thing")
    Exif(orientation=1, focal_mm=0.0, ..., longer=0, shorter=0, exposure=0.0)
    """
    if block.startswith(b"Exif\0\0"):  # as HEIC keeps it
        block = block[6:]
    order = {b"II": "<", b"MM": ">"}.get(block[:2])
    if order is None:
        return Exif()
    try:
        (start,) = struct.unpack_from(order + "I", block, 4)
        tags = _tags(block, order, start)
        if _EXIF in tags:
            tags |= _tags(block, order, int(tags[_EXIF]))
    except (struct.error, OverflowError, ValueError):
        return Exif()
    time_s = tags.get(_TIME_S, 0.0)
    if int(tags.get(_FLASH, 0)) & 1 and time_s:
        time_s = 1.0
    unit_mm = _UNITS_MM.get(int(tags.get(_PLANE_UNIT, 2)), 25.4)
    return Exif(
        orientation=int(tags.get(_ORIENTATION, 1)),
        focal_mm=tags.get(_FOCAL_MM, 0.0),
        focal_35mm=tags.get(_FOCAL_35MM, 0.0),
        pixels_per_mm=tags.get(_PLANE_X, 0.0) / unit_mm,
        longer=int(max(tags.get(_WIDTH, 0), tags.get(_HEIGHT, 0))),
        shorter=int(min(tags.get(_WIDTH, 0), tags.get(_HEIGHT, 0))),
        exposure=time_s * tags.get(_ISO, 1) / (tags.get(_F_NUMBER) or 1.0) ** 2,
    )


def _tags(block: bytes, order: str, start: int) -> dict[int, float]:
    """The first number of each tag of a directory; raises struct.error."""
    (count,) = struct.unpack_from(order + "H", block, start)
    found: dict[int, float] = {}
    for entry in range(start + 2, start + 2 + 12 * count, 12):
        tag, kind, values = struct.unpack_from(order + "HHI", block, entry)
        if tag not in _READ:
            continue
        at = entry + 8
        if _SIZES.get(kind, 1) * values > 4:
            (at,) = struct.unpack_from(order + "I", block, at)
        if kind in (3, 4):
            (found[tag],) = struct.unpack_from(order + ("H" if kind == 3 else "I"), block, at)
        elif kind == 5:
            above, below = struct.unpack_from(order + "II", block, at)
            found[tag] = above / below if below else 0.0
    return found


def camera_of(exif: Exif, width: int, height: int) -> tuple[Camera, str] | None:
    """The camera of an image by its EXIF, and from which figure; None where it says too little.

    The principal point is the middle of the image.

    >>> camera_of(Exif(focal_35mm=26.0), 4032, 3024)[0].fx.__round__()
    3029
    """
    longer = max(width, height)
    focal, why = _focal_px(exif, longer, min(width, height))
    if not _FOCAL_PER_SIDE[0] <= focal / longer <= _FOCAL_PER_SIDE[1]:
        return None
    return Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2), why


def roughness_of(exif: Exif, width: int, height: int) -> float:
    """By how much, relative, the focal length of `camera_of` may be off.

    More than ROUGHNESS where the image is, or looks, cut out of a whole one: its focal length is
    then taken for that of the whole one's field of view.

    >>> round(roughness_of(Exif(focal_35mm=26.0), 4032, 3024), 3)
    0.05
    >>> round(roughness_of(Exif(focal_35mm=26.0), 4032, 2268), 3)
    0.139
    """
    sides = max(width, height), min(width, height)
    focal, _ = _focal_px(exif, *sides)
    of_whole = (_focal_px(exif, *whole)[0] for whole in _wholes(exif, *sides))
    return ROUGHNESS + max(max(of_whole, default=focal) / focal - 1, 0)


def _focal_px(exif: Exif, longer: float, shorter: float) -> tuple[float, str]:
    """The focal length of an image with these sides, 0 where it is not said, and by what."""
    by_film = exif.focal_35mm * math.hypot(longer, shorter) / _FILM_DIAGONAL_MM
    by_plane = exif.focal_mm * exif.pixels_per_mm * longer / (exif.longer or longer)
    if by_plane and (not by_film or abs(by_plane / by_film - 1) < _AGREEING):
        return by_plane, f"{exif.focal_mm:g} mm and its focal plane resolution"
    return by_film, f"its 35 mm equivalent, {exif.focal_35mm:g} mm"


def _wholes(exif: Exif, longer: int, shorter: int) -> list[tuple[float, float]]:
    """Longer and shorter sides of the images that this one may be cut out of; none if it is whole.

    By the proportions that EXIF states where they are others, and a camera's, else by those of
    sensors.
    """

    def differs(proportions: float) -> bool:
        return abs(proportions * shorter / longer - 1) > _SAME_PROPORTIONS

    stated = exif.longer / exif.shorter if exif.shorter else longer / shorter
    if differs(stated) and stated <= _LONGEST:
        possible: tuple[float, ...] = (stated,)
    else:
        possible = _SENSORS if all(map(differs, _SENSORS)) else ()
    return [(max(longer, each * shorter), max(shorter, longer / each)) for each in possible]

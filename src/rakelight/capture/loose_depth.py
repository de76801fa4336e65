"""Depth maps of any of the formats, to metres."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from rakelight.capture.decoder_process import DecoderProcess
from rakelight.capture.depth import check_depth_header, refuse_8_bit
from rakelight.capture.images import decode_image
from rakelight.capture.intrinsics import small_texts
from rakelight.capture.listing import allocate
from rakelight.capture.loose_files import LooseFile, LooseFiles
from rakelight.capture.npy import decode_npy
from rakelight.capture.pfm import decode_pfm
from rakelight.capture.text_tables import text_of
from rakelight.capture.validate import PLAUSIBLE_M, plausible_scales
from rakelight.capture.z16 import decode_z16
from rakelight.errors import CaptureError, listed
from rakelight.files import read_bytes
from rakelight.model import Array, Capture, Finding, Floats

SCALE = "depth_scale.txt"

MILLIMETRES = 1000.0
"""Depth values per metre of 16-bit depth that does not say: what nearly all programs write."""

# A scale of depth by the names of ORB-SLAM, stella_vslam, NICE-SLAM, Open3D, BOP, nerfstudio and
# instant-ngp.
_STATED = re.compile(
    r"\b\w{0,20}?depth_?(?:map_?|unit_?)?(?:scale|factor|units?)(?:_?factor)?[\"']?"
    r"[ \t]{0,20}[:=][ \t]{0,20}[\"']?([0-9]{0,20}\.?[0-9]{1,20}(?:e[-+]?[0-9]{1,2})?)",
    re.IGNORECASE,
)
_LARGEST_HALF = 65504.0
_POSSIBLE = (100.0, 200_000.0)  # values per metre: of centimetres, and of 65535 at 0.33 m


def read_loose_depth(
    files: LooseFiles, decoder: DecoderProcess
) -> tuple[Floats, tuple[Finding, ...]]:
    """(K, h, w) float32 metres, NaN = no measurement, and how the unit was found.

    Raises CaptureError for another kind of image, several sizes, or integers whose unit is not
    given and not millimetres.
    """
    first, *others = files.depth
    raw = _pixels(first, decoder)
    maps = allocate((len(files.depth), *raw.shape), "float32", first.source)
    stated = None if files.depth_scale is None else depth_scale(files.depth_scale)
    if stated is None and raw.dtype.kind in "iu":
        stated = stated_scale(small_texts(files.texts).values(), raw, first.source)
    scale, findings = _unit(raw, stated, first)
    maps[0] = _metres(raw, scale)
    for into, file in zip(maps[1:], others, strict=True):
        pixels = _pixels(file, decoder)
        if pixels.shape != raw.shape or pixels.dtype.kind != raw.dtype.kind:
            raise CaptureError(
                "depth maps of different kinds",
                source=file.source,
                seen=f"{pixels.shape} {pixels.dtype}",
                needed=f"{raw.shape} {raw.dtype}, as {first.name}",
                remedy="keep those of one size and format",
            )
        into[:] = _metres(pixels, scale)
    return maps, findings


def depth_noted(findings: tuple[Finding, ...], capture: Capture) -> tuple[Finding, ...]:
    """The findings, the assumed unit with the median depth that it gives."""
    median_m = float(np.nanmedian(capture.depth_m))
    return tuple(
        Finding(f.severity, f.code, f.message.format(median_m=median_m), f.remedy) for f in findings
    )


def _pixels(file: LooseFile, decoder: DecoderProcess) -> Array:
    """(h, w) as stored."""
    data = read_bytes(file.path, source=file.source)
    if file.header is not None:
        check_depth_header(file.header, file.source)
        return decode_image(data, file.source)
    if file.shape is not None:
        return decode_z16(data, file.shape, file.source)
    if file.kind == "pfm":
        return decode_pfm(data, file.source)
    if file.kind == "npy":
        array = decode_npy(data, file.source)
        refuse_8_bit(str(array.dtype), file.source)
        return array
    if file.exr is None or not file.one_channel:
        raise CaptureError(
            "this kind of depth is not read",
            source=file.source,
            seen="colour" if file.exr else file.kind.upper(),
            needed="16-bit PNG or TIFF, float TIFF, PFM, NPY, EXR with a channel Z",
            remedy="export the depth as one of these",
        )
    arrays = decoder.decode("exr", data, file.source).arrays
    return arrays["depth"] if "depth" in arrays else arrays["color"][..., 0]


def depth_scale(path: Path) -> float:
    """Depth values per metre, a number in a text file such as `SCALE`; raises CaptureError."""
    source = str(path)
    text = (text_of(read_bytes(path, source=source, max_bytes=1000)) or "").strip()
    stated = re.fullmatch(r"[0-9]{1,9}(\.[0-9]{0,9})?(e\+?[0-9]{1,2})?", text, re.IGNORECASE)
    number = float(text) if stated else 0.0
    if number <= 0:
        raise CaptureError(
            "no depth scale", source=source, seen=text[:40], needed="depth values per metre",
            remedy="write 1000 where they are millimetres",
        )  # fmt: skip
    return number


def stated_scale(texts: Iterable[bytes], values: Array, source: str) -> float | None:
    """Depth values per metre by the files of other programs; None where they do not say.

    Some mean values per metre, some metres, BOP millimetres per value: the one is taken that makes
    the median of the `values` a distance.  Raises CaptureError where none or several do.

    >>> stated_scale([b"RGBD.DepthMapFactor: 5000.0"], np.full(9, 3100, np.uint16), "depth.png")
    5000.0
    >>> stated_scale([b'{"depth_scale": 0.1}'], np.full(9, 6200, np.uint16), "depth.png")
    10000.0
    """
    stated = {
        float(number) for text in texts for number in _STATED.findall(text_of(text) or "")
    } - {0.0}
    if not stated:
        return None
    median = _median(values)
    possible = {
        float(f"{scale:.6g}")  # of 32 bits: 0.001 is 0.0010000000475 in them
        for number in stated
        for scale in (number, 1 / number, MILLIMETRES / number)
        if _POSSIBLE[0] <= scale <= _POSSIBLE[1]
        and (not median or PLAUSIBLE_M[0] <= median / scale <= PLAUSIBLE_M[1])
    }
    if len(possible) != 1:
        raise CaptureError(
            f"{'several scales' if possible else 'no possible scale'} of the depth",
            source=source,
            seen=f"{listed([f'{n:g}' for n in sorted(stated)])}; median value {median:g}",
            needed="one that makes it a distance",
            remedy=f"write the depth values per metre into {SCALE}",
        )
    return possible.pop()


def _measured(raw: Array) -> Array:
    """(n,) The values that are measurements."""
    return raw[(raw > 0) & (raw < _nothing_from(raw))]


def _median(raw: Array) -> float:
    """Of the values that are measurements; 0 where there is none."""
    measured = _measured(raw)
    return float(np.median(measured)) if measured.size else 0.0


def _unit(raw: Array, stated: float | None, file: LooseFile) -> tuple[float, tuple[Finding, ...]]:
    """Depth values per metre, and a note where they were assumed."""
    if raw.dtype.kind == "f":
        # Most of a picture may be far: what the object's distance is shows with the mask.
        measured = _measured(raw)
        if stated is None and measured.size and measured.min() > PLAUSIBLE_M[1]:
            raise _wrong_unit(_median(raw), None, "in metres", file)
        return stated or 1.0, ()
    median = _median(raw)
    if median and not PLAUSIBLE_M[0] <= median / (stated or MILLIMETRES) <= PLAUSIBLE_M[1]:
        at = "in millimetres" if stated is None else f"at {stated:g} values per metre"
        raise _wrong_unit(median, stated, at, file)
    if stated is not None:
        return stated, ()
    message = "16-bit depth taken for millimetres: median {median_m:.3g} m"
    remedy = f"where that is wrong, write the depth values per metre into {SCALE}"
    return MILLIMETRES, (Finding("note", "depth-unit-assumed", message, remedy),)


def _wrong_unit(median: float, stated: float | None, at: str, file: LooseFile) -> CaptureError:
    """The error for depth whose median value is no distance."""
    return CaptureError(
        "the unit of the depth is not known" if stated is None else "not the unit of the depth",
        source=file.source,
        seen=f"median value {median:g}, which is no distance {at}",
        needed="depth values per metre",
        remedy=f"write the number into {SCALE} beside it; " + plausible_scales(median),
    )


def _nothing_from(raw: Array) -> float:
    """A sensor's "too far", and a renderer's: Blender writes 1e10, of half floats the largest."""
    return np.iinfo(raw.dtype).max if raw.dtype.kind in "iu" else _LARGEST_HALF


def _metres(raw: Array, scale: float) -> Floats:
    """(h, w) float32 metres, NaN = no measurement."""
    with np.errstate(over="ignore", invalid="ignore"):  # of wild values, NaN afterwards
        metres = (raw / scale).astype(np.float32)
        nothing = ~(np.isfinite(metres) & (metres != 0))
    nothing |= raw >= _nothing_from(raw)
    metres[nothing] = np.nan
    return metres

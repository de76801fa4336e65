"""Depth maps of any of the formats, to metres."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from rakelight.capture.decoder_process import DecoderProcess
from rakelight.capture.depth import check_depth_header, refuse_8_bit
from rakelight.capture.images import decode_image
from rakelight.capture.listing import allocate
from rakelight.capture.loose_files import LooseFile, LooseFiles
from rakelight.capture.npy import decode_npy
from rakelight.capture.pfm import decode_pfm
from rakelight.capture.validate import PLAUSIBLE_M, plausible_scales
from rakelight.errors import CaptureError
from rakelight.files import read_bytes
from rakelight.model import Array, Capture, Finding, Floats

SCALE = "depth_scale.txt"

MILLIMETRES = 1000.0
"""Depth values per metre of 16-bit depth that does not say: what nearly all programs write."""


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
    text = read_bytes(path, source=source, max_bytes=1000).decode("latin-1").strip()
    number = float(text) if re.fullmatch(r"[0-9]{1,9}(\.[0-9]{1,9})?", text) else 0.0
    if number <= 0:
        raise CaptureError(
            "no depth scale", source=source, seen=text[:40], needed="depth values per metre",
            remedy="write 1000 where they are millimetres",
        )  # fmt: skip
    return number


def _unit(raw: Array, stated: float | None, file: LooseFile) -> tuple[float, tuple[Finding, ...]]:
    """Depth values per metre, and a note where they were assumed."""
    if raw.dtype.kind == "f":
        return stated or 1.0, ()
    measured = raw[(raw > 0) & (raw < np.iinfo(raw.dtype).max)]
    median = float(np.median(measured)) if measured.size else 0.0
    metres = median / (stated or MILLIMETRES)
    if measured.size and not PLAUSIBLE_M[0] <= metres <= PLAUSIBLE_M[1]:
        at = "in millimetres" if stated is None else f"at {stated:g} values per metre"
        raise CaptureError(
            "the unit of the depth is not known" if stated is None else "not the unit of the depth",
            source=file.source,
            seen=f"median value {median:g}, which is no distance {at}",
            needed="depth values per metre",
            remedy=f"write the number into {SCALE} beside it; " + plausible_scales(median),
        )
    if stated is not None:
        return stated, ()
    message = "16-bit depth taken for millimetres: median {median_m:.3g} m"
    remedy = f"where that is wrong, write the depth values per metre into {SCALE}"
    return MILLIMETRES, (Finding("note", "depth-unit-assumed", message, remedy),)


def _metres(raw: Array, scale: float) -> Floats:
    """(h, w) float32 metres, NaN = no measurement."""
    with np.errstate(over="ignore", invalid="ignore"):  # of wild values, NaN afterwards
        metres = (raw / scale).astype(np.float32)
        nothing = ~(np.isfinite(metres) & (metres != 0))
    if raw.dtype.kind in "iu":
        nothing |= raw == np.iinfo(raw.dtype).max  # a sensor's "too far"
    metres[nothing] = np.nan
    return metres

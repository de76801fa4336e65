"""Photographs of any of the formats, all alike, to one array."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rakelight.capture.decoder_process import DecoderProcess
from rakelight.capture.exif import Exif, exif_of, parse_exif
from rakelight.capture.headers import check_size
from rakelight.capture.images import as_rgb, decode_image
from rakelight.capture.listing import allocate
from rakelight.capture.loose_files import LooseFile, LooseFiles
from rakelight.capture.tone_curve import stated_encoding
from rakelight.capture.validate import check_same_kind
from rakelight.capture.white_level import WHITE_16_BIT
from rakelight.errors import CaptureError, listed
from rakelight.files import read_bytes
from rakelight.model import Array, Encoding, Finding, Floats, Progress, ProgressCallback

_ENCODINGS: dict[str, Encoding] = {"heic": "srgb", "raw": "linear", "exr": "linear"}

# Columns of a raw photograph for each one of the depth map, from which on each 2 x 2 of its mosaic
# becomes one pixel: twice as fine as depth is still left, and a mosaic measures red and blue at no
# finer than that.
HALF_FROM = 4

# Longest exposure over shortest, by EXIF, that is the same: it says 1/30 s of 1/33.
_SAME_EXPOSURE = 1.15

# Of light beyond 1 (EXR), what is brighter than this share of all values is a highlight.
_HIGHLIGHTS = 0.001
_BELOW_SATURATED = 0.97  # where the rest ends


@dataclass(frozen=True, slots=True)
class Photos:
    """Photographs, decoded.

    pixels : (N, H, W, 3) uint8 or uint16; encoding : None where it goes by their bits
    full : (width, height) of which the intrinsics speak: of raw files the whole mosaic
    ambient, flat : (H, W, 3), where there are such files
    exif : of the first
    exposures : of all, beside the first's, as EXIF says; empty where they are alike, or not known
    """

    pixels: Array
    encoding: Encoding | None
    full: tuple[int, int]
    exif: Exif
    ambient: Array | None
    flat: Array | None
    findings: tuple[Finding, ...]
    exposures: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class _One:
    """One picture: uint8, uint16 or float32 (H, W, 3), and what its file says."""

    pixels: Array
    exif: Exif
    facts: dict[str, Any]

    @property
    def turned(self) -> str:
        """What is done about its orientation by EXIF; nothing where it says none."""
        if self.exif.orientation == 1:
            return ""
        return "applied" if self.facts.get("turned") else "ignored"


def read_loose_photographs(
    files: LooseFiles, decoder: DecoderProcess, depth_width: int, progress: ProgressCallback
) -> Photos:
    """All photographs of the folder, and the pictures that correct their light.

    depth_width : of the depth maps, by which raw files are developed at half their size

    Raises CaptureError where one is damaged or of another size or kind than the first.
    """
    # Alpha is dropped; grey beside colour is another camera's, infrared for one.
    kinds = {1: 1, 2: 1, 3: 3, 4: 3}
    headers = {
        f.name: replace(f.header, channels=kinds[f.header.channels])
        for f in files.photographs
        if f.header
    }
    folder, stated = str(files.photographs[0].path.parent), None
    if len(headers) == len(files.photographs):  # the others' sizes are known when they are decoded
        check_same_kind(headers, folder)
        stated = stated_encoding(headers, folder)
    extra = [file for file in (files.ambient, files.flat) if file is not None]
    everything = [*files.photographs, *extra]
    ones = _decoded(everything, decoder, depth_width)
    first = next(ones)
    shape, dtype = first.pixels.shape, str(first.pixels.dtype)
    count = len(files.photographs)
    stack = allocate((len(everything), *shape), dtype, folder)
    stack[0] = first.pixels
    turned, exposures = [first.turned], [first.exif.exposure]
    for i, one in enumerate(ones, start=1):
        progress(Progress("read", i, len(everything)))
        if one.pixels.shape != shape or str(one.pixels.dtype) != dtype:
            raise CaptureError(
                "photographs of different kinds",
                source=everything[i].source,
                seen=_kind(one.pixels),
                needed=f"{_kind(first.pixels)}, as {everything[0].name}",
                remedy="take all with the same settings, and leave out the odd ones"
                if i < count
                else "save it as the photographs are, or move it away",
            )
        stack[i] = one.pixels
        turned.append(one.turned)
        exposures.append(one.exif.exposure)
    changed = _changed(exposures[:count])
    findings = _findings(files.photographs, turned[:count], first) + _exposure_finding(changed)
    if dtype == "float32":
        stack, scaled = _sixteen_bit(stack, count)
        findings += scaled
    corrections = dict(zip((file.name for file in extra), stack[count:], strict=True))
    full = first.facts.get("full") or [shape[1], shape[0]]
    kind = files.photographs[0].kind
    return Photos(
        pixels=stack[:count],
        encoding=_ENCODINGS.get(kind, stated),
        full=(int(full[0]), int(full[1])),
        exif=first.exif,
        ambient=corrections.get(files.ambient.name) if files.ambient else None,
        flat=corrections.get(files.flat.name) if files.flat else None,
        findings=findings,
        exposures=changed,
    )


def _decoded(
    files: Sequence[LooseFile], decoder: DecoderProcess, depth_width: int
) -> Iterator[_One]:
    """Each file's picture; of raw files all with the white balance of the first."""
    white_balance: list[float] | None = None
    for file in files:
        data = read_bytes(file.path, source=file.source)
        if file.header is not None:
            check_size(file.header.width, file.header.height, file.source)
            pixels = as_rgb(decode_image(data, file.source))
            if pixels.dtype.kind == "f":
                with np.errstate(over="ignore"):
                    pixels = pixels.astype(np.float32)
            elif pixels.dtype not in (np.uint8, np.uint16):
                raise CaptureError(
                    "this kind of photograph is not read",
                    source=file.source,
                    seen=str(pixels.dtype),
                    needed="8 or 16 bit, or floating point",
                    remedy="export it as 16-bit PNG",
                )
            yield _One(pixels, exif_of(data), {})
        elif file.kind == "raw":
            half = HALF_FROM // 2 * depth_width
            options = {"half": half, "white_balance": white_balance}
            made = decoder.decode("raw", data, file.source, **options)
            white_balance = made.facts.get("white_balance")
            yield _One(made.arrays["pixels"], exif_of(data), made.facts)
        elif file.kind == "heic":
            made = decoder.decode("heic", data, file.source)
            exif = parse_exif(made.arrays["exif"].tobytes())
            yield _One(made.arrays["pixels"], exif, made.facts)
        else:
            arrays = decoder.decode("exr", data, file.source).arrays if file.exr else {}
            if "color" not in arrays:
                raise CaptureError(
                    "no photograph",
                    source=file.source,
                    seen=file.kind.upper(),
                    remedy="move it away, or name it depth where it is depth",
                )
            yield _One(arrays["color"], Exif(), {})


def _kind(pixels: Array) -> str:
    height, width = pixels.shape[:2]
    return f"{width}x{height} {pixels.dtype}"


def _sixteen_bit(light: Floats, count: int) -> tuple[Array, tuple[Finding, ...]]:
    """Floating-point light as uint16, 1 being white; all by one factor where it goes beyond.

    count : how many of them are photographs; only these are looked at
    """
    photographs = light[:count]
    finite = np.isfinite(photographs)
    findings: tuple[Finding, ...] = ()
    scale = 1.0
    brightest = float(photographs.max(initial=0, where=finite))
    if brightest > 1:
        few = photographs[:, ::4, ::4]
        top = float(np.quantile(few[np.isfinite(few)], 1 - _HIGHLIGHTS)) if few.size else brightest
        scale = _BELOW_SATURATED / max(top, 1e-3 * brightest)
        message = (
            f"light beyond 1 (up to {brightest:.3g}): all photographs multiplied by {scale:.3g}; "
            f"the brightest {_HIGHLIGHTS:.1%} count as saturated"
        )
        findings = (Finding("note", "light-scaled", message),)
    stored = allocate(light.shape, "uint16", "photographs")
    for into, image in zip(stored, light, strict=True):
        # What is not a number is no light; infinite light is saturated.
        values = np.nan_to_num(WHITE_16_BIT * scale * image.astype(np.float64), nan=0.0)
        into[:] = np.clip(np.rint(values), 0, WHITE_16_BIT)
    return stored, findings


def _changed(exposures: Sequence[float]) -> tuple[float, ...]:
    """Exposures beside the first, where they differ and all are known; else none.

    >>> _changed([0.01, 0.04, 0.01]), _changed([0.01, 0.0, 0.04]), _changed([1 / 30, 1 / 33])
    ((1.0, 4.0, 1.0), (), ())
    """
    if not min(exposures) > 0 or max(exposures) < _SAME_EXPOSURE * min(exposures):
        return ()
    return tuple(float(f"{each / exposures[0]:.6g}") for each in exposures)


def _exposure_finding(exposures: tuple[float, ...]) -> tuple[Finding, ...]:
    """A note where exposures differ."""
    if not exposures:
        return ()
    message = (
        "the camera changed its exposure between the photographs, by "
        f"{max(exposures) / min(exposures):.1f} times (EXIF): that is taken into account where "
        "lamps are compared"
    )
    return (Finding("note", "exposure-changed", message, "lock exposure and ISO"),)


def _findings(
    files: Sequence[LooseFile], turned: Sequence[str], first: _One
) -> tuple[Finding, ...]:
    """What a person should know of the photographs' formats.

    turned : of each file, what was done about its orientation
    """
    found: list[Finding] = []
    names, kind = [file.name for file in files], files[0].kind
    if any(turned):
        each = (
            f"{how} in {listed(names, [one == how for one in turned])}"
            for how in ("applied", "ignored")
            if how in turned
        )
        message = f"orientation {', '.join(each)}"
        remedy = "make sure that depth and photographs are the same way up"
        found.append(Finding("warning", "exif-orientation", message, remedy))
    if kind in ("JPEG", "heic"):
        what = "JPEG" if kind == "JPEG" else "HEIC"
        message = f"{len(files)} {what} photographs; their compression looks like relief"
        found.append(Finding("warning", "jpeg", message, "use raw or PNG"))
    if first.facts.get("display_p3"):
        message = "the photographs' colours are Display P3's; they are not converted to sRGB's"
        found.append(Finding("note", "display-p3", message))
    if kind == "raw":
        factors = ", ".join(f"{f:.3g}" for f in (first.facts.get("white_balance") or [1, 1, 1])[:3])
        height, width = first.pixels.shape[:2]
        message = (
            f"raw files developed linearly to {width}x{height}, in the camera's own colours, all "
            f"with the white balance of {names[0]} (red, green, blue: {factors})"
        )
        found.append(Finding("note", "raw", message))
    return tuple(found)

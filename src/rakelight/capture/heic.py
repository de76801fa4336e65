"""HEIC: the photographs of phones, decoded by libheif."""

from __future__ import annotations

import io
import re
from typing import Any

import numpy as np

from rakelight.capture.headers import check_size
from rakelight.errors import CaptureError
from rakelight.model import Array

BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")
"""Of the files' ftyp box."""

# ITU-T H.273, transfer_characteristics: neither is the sRGB curve that we undo.
_HDR = {16: "PQ", 18: "HLG"}
_DISPLAY_P3 = 12  # ITU-T H.273, colour_primaries
# ISO/IEC 23008-12, 6.5.10 and 6.5.12: boxes of 9 bytes, turned by quarters, and mirrored.
_TURNED = re.compile(rb"\0\0\0\x09(irot[\1-\3]|imir)")


def decode(data: bytes) -> tuple[dict[str, Array], dict[str, Any]]:
    """`pixels` (H, W, 3) uint8, or uint16 where the file has more than 8 bits; `exif` (n,) uint8.

    As the file shows them: turned and mirrored as its container says, whatever EXIF says.  Facts:
    `display_p3`, `turned`.
    To be called in `decoder_child` only.
    """
    import pillow_heif

    pillow_heif.options.DISABLE_SECURITY_LIMITS = False
    pillow_heif.options.THUMBNAILS = False
    pillow_heif.options.DEPTH_IMAGES = False
    pillow_heif.options.AUX_IMAGES = False
    images = pillow_heif.open_heif(io.BytesIO(data), convert_hdr_to_8bit=False)
    image = images[images.primary_index]
    check_size(*image.size, "")
    info: dict[str, Any] = image.info
    nclx = info.get("nclx_profile") or {}
    transfer = nclx.get("transfer_characteristics")
    if transfer in _HDR:
        raise CaptureError(
            "this kind of HEIC is not read",
            seen=f"high dynamic range ({_HDR[transfer]})",
            needed="the sRGB curve",
            remedy="switch HDR off in the camera, or export 16-bit TIFF",
        )
    pixels = np.asarray(image)
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[..., None], 3, axis=2)
    profile = bytes(info.get("icc_profile") or b"")
    wide = b"Display P3" in profile or "Display P3".encode("utf-16-be") in profile
    facts = {
        "display_p3": wide or nclx.get("color_primaries") == _DISPLAY_P3,
        "turned": _TURNED.search(data) is not None,
    }
    exif = np.frombuffer(info.get("exif") or b"", np.uint8)
    return {"pixels": np.ascontiguousarray(pixels[..., :3]), "exif": exif}, facts

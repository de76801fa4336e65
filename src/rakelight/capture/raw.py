"""Raw files (DNG, CR2, CR3, NEF, ARW): light as the sensor counted it, developed by LibRaw.

Linear, 16 bit, the maker's black level subtracted, the maker's white level the largest value,
nothing brightened, in the camera's own colours (no matrix mixes a clipped channel into others).
"""

from __future__ import annotations

import io
from typing import Any

from rakelight.capture.headers import check_size
from rakelight.model import Array

SUFFIXES = (".dng", ".cr2", ".cr3", ".nef", ".arw")


def decode(
    data: bytes, half: bool | int = False, white_balance: list[float] | None = None
) -> tuple[dict[str, Array], dict[str, Any]]:
    """`pixels` (H, W, 3) uint16 linear, not turned by the file's orientation.

    half : one pixel for each 2 x 2 of the mosaic; a number: where that leaves at least so many
        columns
    white_balance : factors of red, green, blue, green; None for those of the file, or of daylight
        where it has none.  The smallest becomes 1, so that what clipped on the sensor is 65535 in
        every channel

    Facts: `white_balance` used, `full` [width, height] of the whole mosaic, `flip` (0: as stored).
    To be called in `decoder_child` only.
    """
    import rawpy

    with rawpy.imread(io.BytesIO(data)) as raw:
        sizes = raw.sizes
        check_size(sizes.raw_width, sizes.raw_height, "")
        check_size(sizes.width, sizes.height, "")
        if white_balance is None:
            white_balance = _factors(raw.camera_whitebalance) or _factors(raw.daylight_whitebalance)
        halved = half if isinstance(half, bool) else sizes.width // 2 >= half
        pixels = raw.postprocess(
            # Bilinear: the same linear mixture of pixels in every photograph.  Others choose
            # directions by the light, and what they choose looks like relief.
            demosaic_algorithm=rawpy.DemosaicAlgorithm.LINEAR,
            half_size=halved,
            gamma=(1, 1),
            no_auto_bright=True,
            # No white level of each photograph's own, by its brightest pixel.
            adjust_maximum_thr=0.0,
            output_bps=16,
            output_color=rawpy.ColorSpace.raw,
            user_wb=white_balance or [1.0, 1.0, 1.0, 1.0],
            highlight_mode=rawpy.HighlightMode.Clip,
            user_flip=0,
        )
        facts = {
            "white_balance": white_balance,
            "full": [int(sizes.width), int(sizes.height)],
            "flip": int(sizes.flip),
        }
    return {"pixels": pixels}, facts


def _factors(white_balance: Any) -> list[float] | None:
    """Factors of red, green, blue, green; None where the file has none."""
    red, green, blue, *_ = (float(factor) for factor in white_balance)
    # Beyond a factor of 8 it is no light that photographs are taken in.
    sound = min(red, green, blue) > 0 and max(red, green, blue) < 8 * min(red, green, blue)
    return [red, green, blue, green] if sound else None

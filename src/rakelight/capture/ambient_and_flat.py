"""What light did before it came to the file: light that is not the lamp's, and vignetting.

    light of the lamp = (photograph - ambient) / flat

in linear light, once, when a capture is read; what comes out is linear with 16 bit.  What was
saturated in the photograph is saturated (65535) in the result.  What is not stays below the level
that counts as saturated: where dividing by `flat` lifts it above, all photographs are scaled by one
factor.  What noise leaves below zero becomes 0; that is no bias, as all below the level that counts
as black is left out anyway.
"""

from __future__ import annotations

import numpy as np

from rakelight.capture.listing import allocate
from rakelight.capture.white_level import WHITE_16_BIT
from rakelight.errors import CaptureError
from rakelight.model import BLACK, SATURATED, Array, Encoding, Finding, Floats
from rakelight.prepare.linear import linear_table

# What is not saturated ends here, of white: below SATURATED by more than rounding.
_BRIGHTEST = 0.97

# A card darker than this somewhere, of its brightest level, is no card before a lens: vignetting
# leaves a quarter in the corners of the worst.
_DARKEST_FLAT = 0.1
_LEAST_CARD_LIGHT = 0.02  # of white, median: below it a card's noise is what is seen
_MOST_SATURATED = 0.01  # share of the card's values

# A flat is smoothed to so many cells along its longer side, with this standard deviation in cells:
# the card's texture and noise go, the lens's fall-off varies much more slowly.
_CELLS = 48
_SIGMA_CELLS = 1.0

# A pixel is lit by the lamp where that adds this share of its light in some photograph; fewer such
# values than this share of the image are none.
_LEAST_LAMP = 0.1
_LEAST_AREA = 0.01
_STRONG = 0.5  # of the light on what the lamp lights: the noise of ambient light is then the larger

Corrected = tuple[Array, tuple[Finding, ...]]


def corrected(
    photographs: Array,
    encoding: Encoding,
    ambient: Array | None,
    flat: Array | None,
    sources: tuple[str, str] = ("ambient", "flat"),
) -> Corrected:
    """The photographs (N, H, W, 3) as uint16 linear light without ambient light and vignetting.

    photographs : uint8 or uint16, encoded as `encoding` says
    ambient : (H, W, 3) of the photographs' type: one with the lamp off; None for none
    flat : (H, W, 3) uint8 or uint16, of a white card that fills the image, evenly lit, with this
        encoding; None for none
    sources : names of both, for messages

    Raises CaptureError where one is of another size or type, hides the photographs, or is no card.
    """
    findings: list[Finding] = []
    table = linear_table(photographs.dtype, encoding)
    offset: Floats | float = 0.0
    if ambient is not None:
        check_fits(ambient.shape, str(ambient.dtype), photographs, sources[0], same_type=True)
        offset = table[ambient]
        findings.append(_ambient_finding(photographs, offset, table, sources[0]))
    level: Floats | float = 1.0
    if flat is not None:
        check_fits(flat.shape, str(flat.dtype), photographs, sources[1], same_type=False)
        level = vignetting(flat, encoding, sources[1])
        darkest = float(level.min())
        message = f"vignetting divided out by {sources[1]}: {darkest:.0%} at the darkest"
        findings.append(Finding("note", "flat-divided", message))
    result = allocate(photographs.shape, "uint16", "photographs")
    brightest = max(_brightest(_light(p, ambient, table, offset, level)) for p in photographs)
    scale = WHITE_16_BIT * min(1.0, _BRIGHTEST / max(brightest, 1e-6))
    for into, photograph in zip(result, photographs, strict=True):
        light = _light(photograph, ambient, table, offset, level)
        values = np.clip(np.rint(scale * light), 0, WHITE_16_BIT)
        into[:] = np.where(np.isinf(light), WHITE_16_BIT, values)
    return result, tuple(findings)


def _light(
    photograph: Array,
    ambient: Array | None,
    table: Floats,
    offset: Floats | float,
    level: Floats | float,
) -> Floats:
    """(H, W, 3) linear light of the lamp, infinite where the photograph is saturated."""
    top = SATURATED * np.iinfo(photograph.dtype).max
    saturated = photograph >= top
    if ambient is not None:
        saturated |= ambient >= top
    return np.where(saturated, np.float32(np.inf), (table[photograph] - offset) / level)


def _brightest(light: Floats) -> float:
    return float(light.max(initial=0.0, where=np.isfinite(light)))


def vignetting(flat: Array, encoding: Encoding, source: str = "flat") -> Floats:
    """(H, W, 3) float32: how bright the lens shows each pixel, 1 at the brightest smooth level.

    flat : (H, W, 3) of a white card; its texture and noise are smoothed away, its colour is not
        kept: each channel is 1 at its own brightest level

    Raises CaptureError where it is saturated, dark, or falls off as no lens does.

    >>> card = np.full((60, 80, 3), 40000, np.uint16)
    >>> float(vignetting(card, "linear").min())
    1.0
    """
    top = SATURATED * np.iinfo(flat.dtype).max
    saturated = float(np.mean(flat >= top))
    light = linear_table(flat.dtype, encoding)[flat]
    median = float(np.median(light))
    if saturated > _MOST_SATURATED or median < _LEAST_CARD_LIGHT:
        raise CaptureError(
            "the white card is saturated" if median >= _LEAST_CARD_LIGHT else "the card is dark",
            source=source,
            seen=f"{saturated:.0%} of its values saturated, median {median:.1%} of white",
            needed="a card of middle brightness",
            remedy="expose shorter" if median >= _LEAST_CARD_LIGHT else "expose longer",
        )
    level = _smoothed(light)
    level /= level.max(axis=(0, 1))
    if level.min() < _DARKEST_FLAT:
        raise CaptureError(
            "no white card that fills the image",
            source=source,
            seen=f"{float(level.min()):.0%} of its brightest level somewhere",
            needed=f"at least {_DARKEST_FLAT:.0%}",
            remedy="photograph a white sheet that fills the image, evenly lit, out of focus",
        )
    return level


def _smoothed(light: Floats) -> Floats:
    """(H, W, 3) without what varies within a few cells of a coarse grid."""
    import cv2

    height, width = light.shape[:2]
    cell = max(1.0, max(height, width) / _CELLS)
    rows, columns = max(1, round(height / cell)), max(1, round(width / cell))
    small = cv2.resize(light, (columns, rows), interpolation=cv2.INTER_AREA)
    # Carried on beyond the rim with its slope, so that smoothing does not flatten it there.
    margin = min(3, rows - 1, columns - 1)
    wide = small
    if margin > 0:
        around = ((margin, margin), (margin, margin), (0, 0))
        wide = np.pad(small, around, mode="reflect", reflect_type="odd")
        wide = cv2.GaussianBlur(wide, (0, 0), _SIGMA_CELLS, borderType=cv2.BORDER_REPLICATE)
    down = _interpolation(height, rows, margin)
    across = _interpolation(width, columns, margin)
    whole = np.einsum("ij,jkc,lk->ilc", down, wide, across, optimize=True)
    return np.asarray(whole, np.float32)


def _interpolation(pixels: int, cells: int, margin: int) -> Floats:
    """(pixels, cells + 2 margin): weights of linear interpolation between the cells' centres."""
    at = (np.arange(pixels) + 0.5) * cells / pixels - 0.5 + margin
    weights = 1 - np.abs(at[:, None] - np.arange(cells + 2 * margin))
    return np.asarray(np.maximum(0, weights), np.float32)


def check_fits(
    shape: tuple[int, ...], dtype: str, photographs: Array, source: str, *, same_type: bool
) -> None:
    """Raise CaptureError unless a picture is of the photographs' size (H, W, 3) and type.

    same_type : or else of 8 or 16 bit
    """
    types = (str(photographs.dtype),) if same_type else ("uint8", "uint16")
    if shape != photographs.shape[1:] or dtype not in types:
        raise CaptureError(
            "this picture does not fit the photographs",
            source=source,
            seen=f"{shape} {dtype}",
            needed=f"{photographs.shape[1:]} {' or '.join(types)}",
            remedy="take it with the same camera and settings, and store it in the same way",
        )


def _ambient_finding(photographs: Array, offset: Floats, table: Floats, source: str) -> Finding:
    """Says how strong the ambient light is; raises CaptureError where it is nearly all there is."""
    few = (slice(None, None, 4),) * 2
    brightest, ambient = table[photographs[:, *few].max(axis=0)], offset[few]
    by_lamp = brightest - ambient > _LEAST_LAMP * np.maximum(brightest, BLACK)
    if by_lamp.mean() < _LEAST_AREA:
        raise CaptureError(
            "nearly all light is there without the lamp, too",
            source=source,
            seen=f"{by_lamp.mean():.1%} of the image lit by the lamp",
            needed="a photograph with the lamp off",
            remedy="take it with the lamp off and the settings of the others, or leave it away",
        )
    share = float(ambient[by_lamp].sum() / brightest[by_lamp].sum())
    message = f"ambient light subtracted by {source}: {share:.0%} of the brightest light"
    if share > _STRONG:
        return Finding("warning", "ambient-subtracted", message, "darken the room: its noise stays")
    return Finding("note", "ambient-subtracted", message)

"""One picture that shows which frames of a recording were taken and which dropped, and why."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from rakelight.capture.video.frames import Frames
from rakelight.capture.video.judging import Reasons
from rakelight.model import Array, Floats
from rakelight.prepare.linear import srgb

# Columns, and the width of the sheet at most, pixels; the height of a line of text.
COLUMNS, WIDTH_PX, LINE_PX = 8, 1640, 26
GAP_PX = 8
# Dropped frames that are shown for each reason.
SAMPLES = 8
BACKGROUND, TEXT, TAKEN, DROPPED = (24, 26, 30), (235, 235, 235), (70, 190, 110), (225, 95, 70)

Colour = tuple[int, int, int]


@dataclass(frozen=True)
class Tile:
    """A small picture with a line of text below."""

    frame: int
    text: str
    light: Floats | None = None
    """(2,) right and down towards the light, shorter than 1; None = not known"""


def contact_sheet(
    frames: Frames, groups: list[list[int]], reasons: Reasons, names: list[str]
) -> Array:
    """(H, W, 3) uint8 sRGB: the frames taken, those averaged with them counted, and the dropped.

    groups : frames of each photograph, the chosen one first; names : (N,) of the frames
    """
    dropped = sum(int(these.sum()) for these in reasons.values())
    spare = len(frames) - dropped - sum(map(len, groups))
    head = f"{len(frames)} frames: {len(groups)} photographs taken, {dropped} dropped"
    parts = [
        _line(head, TEXT, 1.0),
        _line("Taken (with how many frames of the same light it is averaged)", TAKEN),
        _tiles(frames, [_taken(frames, group, names) for group in groups], TAKEN),
    ]
    for reason, these in reasons.items():
        numbers = np.flatnonzero(these)
        if not numbers.size:
            continue
        some = numbers[np.unique(np.linspace(0, len(numbers) - 1, SAMPLES).round().astype(int))]
        shown = f", {len(some)} of them shown" if len(some) < len(numbers) else ""
        parts.append(_line(f"Dropped, {reason}: {len(numbers)}{shown}", DROPPED))
        tiles = [Tile(int(i), _named(frames, names, int(i))) for i in some]
        parts.append(_tiles(frames, tiles, DROPPED))
    if spare > 0:
        parts.append(_line(f"Good, but not needed: {spare}", TEXT))
    return np.concatenate(parts)


def _taken(frames: Frames, group: list[int], names: list[str]) -> Tile:
    own = group[0]
    more = f"  +{len(group) - 1}" if len(group) > 1 else ""
    return Tile(own, _named(frames, names, own) + more, _towards(frames, own))


def _named(frames: Frames, names: list[str], frame: int) -> str:
    """The frame's name, and its time where times are stated."""
    return names[frame] + (f"  {frames.times_s[frame]:.1f} s" if frames.timed else "")


def _towards(frames: Frames, frame: int) -> Floats:
    """(2,) where the light comes from, roughly: where the object is brighter than usual.

    Right and down.  True of convex objects, which is what most are as a whole.
    """
    grey = frames.small[frame].mean(axis=-1)
    usual = np.median(frames.small[:: -(-len(frames) // 60)].mean(axis=-1), axis=0)
    ratio = np.log((grey[frames.mask] + 1e-3) / (usual[frames.mask] + 1e-3))
    y, x = (np.array(each, float) for each in np.nonzero(frames.mask))
    x, y = ((each - each.mean()) / max(float(each.std()), 1e-9) for each in (x, y))
    slope = np.array([np.mean(ratio * x), np.mean(ratio * y)])
    return np.asarray(slope / max(0.3, float(np.linalg.norm(slope))))


def _tiles(frames: Frames, tiles: list[Tile], edge: Colour) -> Array:
    """(h, WIDTH_PX, 3) the tiles in rows."""
    side = (WIDTH_PX - GAP_PX) // COLUMNS - GAP_PX
    height = max(round(side * frames.mask.shape[0] / frames.mask.shape[1]), 1)
    rows = -(-len(tiles) // COLUMNS)
    step = height + LINE_PX + GAP_PX
    sheet = np.full((rows * step + GAP_PX, WIDTH_PX, 3), BACKGROUND, np.uint8)
    for k, tile in enumerate(tiles):
        top, left = GAP_PX + k // COLUMNS * step, GAP_PX + k % COLUMNS * (side + GAP_PX)
        small = np.rint(255 * srgb(frames.small[tile.frame])).astype(np.uint8)
        sheet[top : top + height, left : left + side] = cv2.resize(
            small, (side, height), interpolation=cv2.INTER_CUBIC
        )
        corner = (left + side - 1, top + height - 1)
        cv2.rectangle(sheet, (left, top), corner, edge, 2)
        if tile.light is not None:
            middle = np.array([left + side - 22, top + 22])
            cv2.circle(sheet, middle.tolist(), 16, BACKGROUND, -1, cv2.LINE_AA)
            end = np.rint(middle + 14 * tile.light).astype(int).tolist()
            cv2.line(sheet, middle.tolist(), end, TEXT, 1, cv2.LINE_AA)
            cv2.circle(sheet, end, 3, (255, 220, 90), -1, cv2.LINE_AA)
        _write(sheet, tile.text, (left, top + height + LINE_PX - 9), TEXT, 0.5, side)
    return sheet


def _line(text: str, colour: Colour, size: float = 0.7) -> Array:
    """(h, WIDTH_PX, 3) a line of text."""
    strip = np.full((round(LINE_PX * 1.5 * max(size, 0.8)), WIDTH_PX, 3), BACKGROUND, np.uint8)
    _write(strip, text, (GAP_PX, len(strip) - 11), colour, size, WIDTH_PX - 2 * GAP_PX)
    return strip


def _write(
    picture: Array, text: str, at: tuple[int, int], colour: Colour, size: float, width: int
) -> None:
    """Text from its lower left corner, smaller where it is wider than `width`."""
    plain = text.encode("ascii", "replace").decode()  # all that the font has
    font = cv2.FONT_HERSHEY_SIMPLEX
    length = cv2.getTextSize(plain, font, size, 1)[0][0]
    size *= min(1.0, width / max(length, 1))
    cv2.putText(picture, plain, at, font, size, colour, 1, cv2.LINE_AA)

"""What a capture may leave open, in a folder or in Python: encoding, lighting, the mask."""

from __future__ import annotations

from typing import get_args

import numpy as np

from rakelight.capture.validate import check_word
from rakelight.errors import CaptureError
from rakelight.model import Capture, Encoding, Finding, Lighting, Mask
from rakelight.prepare.sensor import SensorGrid


def chosen_encoding(
    given: Encoding | None, kind: str, remedy: str
) -> tuple[Encoding, tuple[Finding, ...]]:
    """The encoding of photographs, with a note where it was not given, or is hardly right.

    kind : of their values: "8-bit" counts as sRGB, everything else as linear; remedy : for the note

    Raises CaptureError for an unknown encoding.

    >>> chosen_encoding(None, "8-bit", "")[0], chosen_encoding(None, "16-bit", "")[0]
    ('srgb', 'linear')
    """
    if given is not None:
        check_word("encoding", given, get_args(Encoding))
    if given == "linear" and kind == "8-bit":
        message = "8-bit photographs are said to be linear; those of cameras and phones are srgb"
        remedy = "say srgb, unless these values are proportional to light"
        return given, (Finding("note", "linear-8-bit", message, remedy),)
    if given is not None:
        return given, ()
    encoding: Encoding = "srgb" if kind == "8-bit" else "linear"
    message = f"{kind} photographs without a given encoding count as {encoding}"
    return encoding, (Finding("note", "encoding-assumed", message, remedy),)


def chosen_lighting(given: Lighting | None, photographs: int) -> Lighting:
    """The lighting as given, or by the number of photographs.

    >>> chosen_lighting(None, 1), chosen_lighting(None, 12)
    ('ambient', 'moving-lamp')
    """
    if given is not None:
        return given
    return "ambient" if photographs == 1 else "moving-lamp"


def object_mask(
    capture: Capture, depth_source: str, remedy: str
) -> tuple[Mask, tuple[Finding, ...]]:
    """The mask (H, W) of the nearest object, for a capture without one, and a finding about it.

    capture : its mask is not looked at
    depth_source : names the depth in messages; remedy : for depth that the photographs do not show

    Raises CaptureError where there is no depth, or none that the colour camera sees.
    """
    from rakelight.prepare.mask import cut_out
    from rakelight.prepare.undistort import shown_by_lens, undistorted

    if not np.isfinite(capture.depth_m).any():
        raise CaptureError(
            "no depth at all",
            source=depth_source,
            seen="no positive finite value",
            needed="metres on the object",
            remedy="look at the depth before it is handed over",
        )
    ideal = undistorted(capture, whole=False)
    mask, findings = cut_out(ideal)
    if ideal.camera != capture.camera:
        mask = shown_by_lens(mask, ideal.camera, capture.camera)
    if not mask.any():
        raise CaptureError(
            "the colour camera sees nothing of what has depth",
            source=depth_source,
            seen="no pixel of the depth inside the photographs",
            needed="depth and photographs of one object",
            remedy=remedy,
        )
    return mask, findings


def on_depth_grid(mask: Mask, factor: float | None, shape: tuple[int, int]) -> Mask | None:
    """(h, w) True where a depth pixel sees the object alone; None for another camera's depth.

    True where it sees some of the object if none sees it alone.

    factor : colour pixels per depth pixel along each side, None for another camera's depth

    >>> on_depth_grid(np.eye(4, dtype=bool), 2, (2, 2)).tolist()
    [[True, False], [False, True]]
    >>> on_depth_grid(np.eye(3, dtype=bool), 1.5, (2, 2)).tolist()
    [[True, True], [True, True]]
    """
    return None if factor is None else SensorGrid(shape, mask.shape).of_object(mask)

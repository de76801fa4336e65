"""Holes in the depth: which ones are filled by the photographs, and which have neither."""

from __future__ import annotations

import numpy as np

from rakelight.geometry.grid import has_gradient
from rakelight.geometry.masks import dilate
from rakelight.model import Array, Finding, Mask
from rakelight.prepare.linear import usable

# Distance, depth pixels, up to which a hole is filled.  Photographs determine slopes: over 16 depth
# pixels (16 mm for 1 mm pixels) a slope error of 2 degrees adds up to half a millimetre, the noise
# of a good sensor.
REACH_PX = 16
# Share of the result without depth of its own above which that is a warning: most of it then rests
# on slopes alone, which photographs know up to a bas-relief transform.  With 50, 70 and 90 % lost,
# in patches, normals are 1.1, 1.3 and 2.6 times as far off (ablation.md).
MOSTLY_CARRIED = 0.5
LISTED = 4  # parts that a message names


def within_reach(measured: Mask, mask: Mask) -> Mask:
    """The part of a mask (h, w) that is at most 16 pixels from a measurement, inside the mask.

    >>> measured = np.zeros((1, 40), bool); measured[0, 0] = True
    >>> int(within_reach(measured, np.ones((1, 40), bool)).sum())
    17
    """
    from scipy.ndimage import binary_dilation

    near = binary_dilation(measured & mask, np.ones((3, 3), bool), iterations=REACH_PX, mask=mask)
    return np.asarray(near)


def unseen(photographs: Array, unmeasured: Mask, margin: int) -> Mask:
    """Which of the pixels without depth (h, w) no photograph shows either.

    photographs : (N, h, w, 3) as stored
    margin : pixels around what is seen that count as seen
    """
    rows, columns = np.nonzero(unmeasured)
    shown = np.zeros(len(rows), dtype=bool)
    for photograph in photographs:
        shown |= usable(photograph[rows, columns]).any(axis=1)
    dark = np.zeros(unmeasured.shape, dtype=bool)
    dark[rows, columns] = ~shown
    return dark & ~dilate(~dark, max(margin, 1)) if dark.any() else dark


def thin_finding(mask: Mask) -> tuple[Finding, ...]:
    """What to say of parts of a mask (h, w) that are nowhere two pixels wide, if others are.

    >>> mask = np.array([[1, 1, 0, 1], [1, 1, 0, 0]], bool)
    >>> thin_finding(mask)[0].message.endswith("the prepared depth: 1 pixel at (3, 0)")
    True
    """
    from scipy.ndimage import label

    components, _ = label(mask)
    wide = np.unique(components[has_gradient(mask)])
    degenerate = mask & ~np.isin(components, wide)
    if not (len(wide) and degenerate.any()):
        return ()
    message = (
        f"parts of the mask nowhere two pixels wide keep the prepared depth: {_places(degenerate)}"
    )
    return (Finding("note", "thin-parts", message, "leave them out of mask.png"),)


def hole_findings(
    mask: Mask, seen: Mask, measured: Mask, side_px: float = 1.0
) -> tuple[Finding, ...]:
    """What to say of holes: those that were left out, those that the photographs carry.

    side_px : of one of these pixels, in pixels of the photographs, in which places are named
    """
    findings = []
    left_out = mask & ~seen
    if left_out.any():
        findings.append(
            Finding(
                "warning",
                "holes-left-out",
                f"{left_out.sum() / mask.sum():.1%} of the object left out: no depth within "
                f"{REACH_PX} depth pixels, or seen by no camera ({_places(left_out, side_px)})",
                "let the sensor see these parts (other distance or angle, matt spray), or leave "
                "them out of mask.png",
            )
        )
    carried = seen & ~measured
    if carried.any():
        share = float(carried.sum() / seen.sum())
        message = (
            f"{share:.1%} of the result has no depth of its own: the photographs carry it, its "
            "confidence is halved"
        )
        if share > MOSTLY_CARRIED:
            remedy = "let the sensor see more of it: other distance or angle, matt spray, more maps"
            findings.append(Finding("warning", "holes-carried", message, remedy))
        else:
            findings.append(Finding("note", "holes-carried", message))
    return tuple(findings)


def _places(mask: Mask, side_px: float = 1.0) -> str:
    """Where the components of a mask (h, w) lie, the largest of many, column and row.

    >>> _places(np.array([[1, 1, 0, 0, 1]], bool))
    '2 pixels at (0, 0), 1 at (4, 0)'
    >>> _places(np.array([[1, 1, 0, 0, 1]], bool), 2.0)
    '8 pixels at (0, 0), 4 at (8, 0)'
    """
    from scipy.ndimage import find_objects, label

    components, count = label(mask, np.ones((3, 3)))
    sizes = np.rint(side_px**2 * np.bincount(components.ravel())[1:]).astype(int)
    corners = [
        (round(side_px * columns.start), round(side_px * rows.start))
        for rows, columns in find_objects(components)
    ]
    first, *others = np.argsort(-sizes, kind="stable")[:LISTED]
    words = [f"{sizes[first]} pixel{'s' if sizes[first] > 1 else ''} at {corners[first]}"]
    words += [f"{sizes[i]} at {corners[i]}" for i in others]
    return ", ".join(words) + (f" and {count - LISTED} more" if count > LISTED else "")

"""Whether the mask shows the background in place of the object.

An object stands before its background.  A mask that takes the image's four sides, and leaves out
what is nearer along all of its outline, is that of the background: white and black are exchanged.
An object that fills the picture leaves out what is behind it.
"""

from __future__ import annotations

from rakelight.check.evidence import LIKELY
from rakelight.check.inside_out import holds_the_frame, outline_of
from rakelight.check.measured import Measured
from rakelight.model import Finding


def mask_inverted(measured: Measured) -> tuple[Finding, ...]:
    """A warning where object and background seem to be exchanged in the mask."""
    mask = measured.capture.mask
    if not holds_the_frame(mask):
        return ()
    outline = measured(outline_of)
    if outline is None or outline.nearer < LIKELY:
        return ()
    message = (
        f"is the mask inverted? It holds the image's four sides, {mask.mean():.0%} of the image, "
        "and what it leaves out is nearer"
    )
    remedy = "draw the object white, all else black (mask=~mask in Python)"
    return (Finding("warning", "mask-inverted", message, remedy),)

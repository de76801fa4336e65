"""The lower resolution at which the whole of large photographs is refined first."""

from __future__ import annotations

from dataclasses import replace
from math import ceil

from rakelight.memory import available_memory, require_memory
from rakelight.methods.base import Method
from rakelight.model import Capture
from rakelight.prepare import PreparedView, shrunk_view
from rakelight.prepare.reduced import joined, shrunk_camera
from rakelight.prepare.sensor import depth_camera_of

# Factors by which the resolution may be lowered for the whole object.
SHRINKS = range(2, 33)
# Most pixels of the whole object at the lower resolution.  The finer, the nearer to what comes out
# at once, and the longer it takes (scale.md): at 1.6 megapixels a twentieth of the time of 24.
MOST_COARSE_PIXELS = 1_600_000
# Bytes of compiled kernels and libraries that are loaded on the way.
FIXED_BYTES = 2e8
# Share of the memory that may be had which the lower resolution takes.
COARSE_SHARE = 0.8
REMEDY = "close other programs, choose a smaller --scale, or crop to the object"


def lower_resolution(capture: Capture, view: PreparedView, chosen: Method) -> int:
    """By how much the resolution is lowered for the whole object, so that it fits the memory.

    Raises MachineError where it fits at none.
    """
    pixels = view.window_pixels
    room = COARSE_SHARE * (available_memory() - FIXED_BYTES) / chosen.bytes_per_pixel
    possible = [s for s in SHRINKS if pixels <= s**2 * room]
    if not possible:
        least = pixels / SHRINKS[-1] ** 2 * chosen.bytes_per_pixel / COARSE_SHARE + FIXED_BYTES
        require_memory(least, source=capture.source, remedy=REMEDY)
        possible = [SHRINKS[-1]]  # memory that has become free meanwhile
    quick = [s for s in possible if pixels <= s**2 * MOST_COARSE_PIXELS] or possible[-1:]
    whole, sides = view_shrink(capture, view), capture.mask.shape
    exact = [s for s in quick if s <= 2 * quick[0] and not any(n % (s * whole) for n in sides)]
    return (exact or quick)[0]


def view_shrink(capture: Capture, view: PreparedView) -> int:
    """The photographs' pixels along each side of an output pixel."""
    return capture.camera.width // view.camera.width


def coarse_view(capture: Capture, view: PreparedView, shrink: int) -> PreparedView:
    """The view at a resolution `shrink` times lower; what fills no pixel of it is cut off.

    Depth whose pixels are narrower than that is averaged over blocks.  Depth that covers the
    photographs' view gets a camera of its own where the blocks, or the photographs, are cut.
    """
    total = shrink * view_shrink(capture, view)
    height, width = (side // total * total for side in capture.mask.shape)
    join = ceil(shrink / view.grid.factor * (1 - 1e-9))  # depth pixels along a block
    cut = (height, width) != capture.mask.shape or any(n % join for n in capture.depth_m.shape[1:])
    own, pose = depth_camera_of(capture)
    if cut or capture.depth_camera is not None:
        capture = replace(capture, depth_camera=shrunk_camera(own, join), depth_to_color=pose)
    part = slice(0, height), slice(0, width)
    capture = replace(
        capture,
        photographs=capture.photographs[:, *part],
        mask=capture.mask[part],
        camera=capture.camera.cropped(*part),
        depth_m=joined(capture.depth_m, join),
    )
    return shrunk_view(capture, total)

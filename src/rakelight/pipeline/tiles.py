"""Large photographs: the whole object at a lower resolution, then its detail tile by tile.

Memory holds the lower resolution's solve, or the result's maps and one tile.  Tiles overlap; their
answers are blended where they do, with weights that add up to one, so that no seam is seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from rakelight.jit import one_blas_thread
from rakelight.memory import available_memory, require_memory
from rakelight.methods.base import Estimate, Method, brightest, lights_unused
from rakelight.model import Capture, Finding, Floats, Progress, ProgressCallback
from rakelight.pipeline.guarded import surface
from rakelight.pipeline.saturated_albedo import bound_findings, with_lower_bounds
from rakelight.prepare import Prepared, PreparedView, shrunk_view
from rakelight.prepare.sensor import depth_camera_of
from rakelight.scratch import release

if TYPE_CHECKING:
    from rakelight.methods.multi_light.tiles import Whole

# Pixels of the lower resolution by which a tile reaches beyond its share: agreement with the lower
# resolution makes the influence of a tile's border fade within a few.
MARGIN = 12
# Factors by which the resolution is lowered, the first that fits first: at 4 the whole takes a
# sixteenth of the time, and 1 to 4 megapixels come out as when all is refined at once (scale.md).
SHRINKS = (4, 3, 2, *range(5, 33))
# Bytes of the maps for each pixel of the image, and of a tile for each of its own.
MAP_BYTES, TILE_BYTES = 48, 2000
# Most pixels of a tile: larger ones save no time.
LARGEST_TILE = 700_000
# Bytes of compiled kernels and libraries that are loaded on the way.
FIXED_BYTES = 2e8
# Shares of the memory that may be had which the lower resolution, and a tile, take.
COARSE_SHARE, TILE_SHARE = 0.8, 0.7
REMEDY = "close other programs, choose a smaller --scale, or crop to the object"
# Rows of a map that are finished at a time.
ROWS = 256
# Pixels whose albedo is looked at for its 99th percentile.
SAMPLE = 1_000_000


@dataclass(frozen=True, eq=False)
class Maps:
    """A result's maps (H, W[, C]), float32, of the whole image, while tiles are added to them."""

    depth_m: Floats
    normals: Floats
    albedo: Floats
    confidence: Floats
    prepared_m: Floats
    depth_sigma_m: Floats | None
    normal_sigma_deg: Floats | None

    @classmethod
    def empty(cls, shape: tuple[int, int], with_sigmas: bool) -> Maps:
        """Maps of zeros."""
        channels = (0, 3, 3, 0, 0)
        maps = (np.zeros((*shape, *[c] * (c > 0)), np.float32) for c in channels)
        sigmas = (np.zeros(shape, np.float32) if with_sigmas else None for _ in range(2))
        return cls(*maps, *sigmas)

    def add(self, part: tuple[slice, slice], share: Floats, *images: Floats | None) -> None:
        """Add a tile's images, in the order of the fields, with the share (h, w) that it has."""
        fields = (
            self.depth_m, self.normals, self.albedo, self.confidence, self.prepared_m,
            self.depth_sigma_m, self.normal_sigma_deg,
        )  # fmt: skip
        for into, image in zip(fields, images, strict=True):
            if into is not None and image is not None:
                own = share.reshape(*share.shape, *[1] * (image.ndim - 2))
                into[part] += np.where(own > 0, own * image, 0.0)


@dataclass(frozen=True, slots=True)
class Span:
    """A tile's rows, or columns: those it is blended into, and those it is refined on.

    ramp : pixels to both sides of an inner end over which it is blended with the next tile
    """

    first: int
    last: int
    inner: tuple[bool, bool]
    refined: slice
    ramp: int

    def share(self) -> Floats:
        """(n,) the share of this tile in the rows that it is refined on."""
        at = np.arange(self.refined.start, self.refined.stop) + 0.5
        rise = np.clip((at - self.first) / (2 * self.ramp) + 0.5, 0, 1)
        fall = np.clip((self.last - at) / (2 * self.ramp) + 0.5, 0, 1)
        return (rise if self.inner[0] else 1.0) * (fall if self.inner[1] else np.ones(len(at)))


def spans(window: slice, side: int, shrink: int, most: int) -> list[Span]:
    """The tiles of at most about `most` pixels, margins included, along one side of a window.

    >>> [(s.first, s.last, s.refined) for s in spans(slice(3, 203), 210, 2, 148)]
    [(2, 104, slice(2, 128, None)), (104, 204, slice(80, 204, None))]
    """
    margin = MARGIN * shrink
    first, last = window.start // shrink, -(-window.stop // shrink)
    count = max(1, -(-(last - first) * shrink // max(most - 2 * margin, margin)))
    ends = [first + (2 * i * (last - first) + count) // (2 * count) for i in range(count + 1)]
    found = []
    for i, (begin, end) in enumerate(pairwise(ends)):
        inner = (i > 0, i < count - 1)
        refined = slice(
            max(begin * shrink - margin * inner[0], 0), min(end * shrink + margin * inner[1], side)
        )
        found.append(Span(begin * shrink, end * shrink, inner, refined, margin // 2))
    return found


def tiled_maps(
    capture: Capture, view: PreparedView, chosen: Method, options: Any, progress: ProgressCallback
) -> tuple[tuple[Finding, ...], Prepared, Estimate, Maps]:
    """Findings, the lower resolution and its estimate, and the maps of the whole image.

    view : of the capture, at the output resolution

    Raises MachineError where the memory does not suffice for the lower resolution, or for a tile.
    """
    from rakelight.pipeline import estimated

    shrink = lower_resolution(capture, view, chosen)
    coarse = coarse_view(capture, view, shrink)
    prepared = coarse.window(*coarse.object_window)
    unused = lights_unused(prepared, chosen)
    prepared, estimate = estimated(chosen, prepared, options, progress)
    del coarse
    maps_bytes = MAP_BYTES * view.mask.size
    least, most = (TILE_BYTES * pixels for pixels in ((3 * MARGIN * shrink) ** 2, LARGEST_TILE))
    require_memory(maps_bytes + least, source=capture.source, remedy=REMEDY)
    room = min(most, max(least, TILE_SHARE * (available_memory() - maps_bytes)))
    maps, estimate = refined_in_tiles(
        view, prepared, estimate, shrink, int(room / TILE_BYTES), progress
    )
    return unused + estimate.findings, prepared, estimate, maps


def lower_resolution(capture: Capture, view: PreparedView, chosen: Method) -> int:
    """By how much the resolution is lowered for the whole object, so that it fits the memory.

    Raises MachineError where it fits at none that the depth sensor's pixels allow.
    """
    rows, columns = view.object_window
    pixels = (rows.stop - rows.start) * (columns.stop - columns.start)
    room = COARSE_SHARE * (available_memory() - FIXED_BYTES) / chosen.bytes_per_pixel
    possible = [
        shrink
        for shrink in SHRINKS
        if shrink <= view.grid.factor * (1 + 1e-9) and pixels <= shrink**2 * room
    ]
    if not possible:
        finest = max(1, int(view.grid.factor))
        require_memory(
            pixels / finest**2 * chosen.bytes_per_pixel / COARSE_SHARE + FIXED_BYTES,
            source=capture.source, remedy=REMEDY,
        )  # fmt: skip
    whole = view_shrink(capture, view)
    exact = [s for s in possible if not any(side % (s * whole) for side in capture.mask.shape)]
    return (exact or possible)[0]


def view_shrink(capture: Capture, view: PreparedView) -> int:
    """The photographs' pixels along each side of an output pixel."""
    return capture.camera.width // view.camera.width


def coarse_view(capture: Capture, view: PreparedView, shrink: int) -> PreparedView:
    """The view at a resolution `shrink` times lower; what fills no pixel of it is cut off.

    Depth that covers the photographs' view gets a camera of its own there.
    """
    total = shrink * view_shrink(capture, view)
    height, width = (side // total * total for side in capture.mask.shape)
    if (height, width) != capture.mask.shape:
        own, pose = depth_camera_of(capture)
        part = slice(0, height), slice(0, width)
        capture = replace(
            capture,
            photographs=capture.photographs[:, *part],
            mask=capture.mask[part],
            camera=capture.camera.cropped(*part),
            depth_camera=own,
            depth_to_color=pose,
        )
    return shrunk_view(capture, total)


def refined_in_tiles(
    view: PreparedView,
    prepared: Prepared,
    estimate: Estimate,
    shrink: int,
    most_pixels: int,
    progress: ProgressCallback,
) -> tuple[Maps, Estimate]:
    """The maps of the whole object, and the estimate with the lights in the albedo's scale.

    view : at the output resolution; prepared, estimate : of the lower resolution
    most_pixels : of a tile, with its margin
    """
    from rakelight.methods.multi_light.tiles import whole_of

    whole = whole_of(prepared, estimate, shrink)
    maps, bounded = Maps.empty(view.mask.shape, estimate.depth_sigma is not None), 0.0
    side = int(np.sqrt(most_pixels))
    rows, columns = (
        spans(part, length, shrink, side)
        for part, length in zip(view.object_window, view.mask.shape, strict=True)
    )
    tiles = [(row, column) for row in rows for column in columns]
    for number, (row, column) in enumerate(tiles):
        progress(Progress("refine tiles", number + 1, len(tiles)))
        part = row.refined, column.refined
        if view.mask[part].any():
            share = np.outer(row.share(), column.share())
            tile = view.window(*part, photographs=prepared.numbers)
            release(view.photographs)
            with one_blas_thread():
                bounded += add_tile(maps, tile, whole, share, moved=estimate.iterations > 0)
    gain = finish(maps, view)
    lights = estimate.lights
    lights = replace(lights, vector=gain * lights.vector, ambient=gain * lights.ambient)
    note = Finding(
        "note",
        "refined-in-tiles",
        f"the whole object refined at 1/{shrink} of the resolution, its detail in {len(tiles)} "
        "tiles",
        "give it more --memory to refine all at once",
    )
    findings = (*estimate.findings, *bound_findings(bounded / np.count_nonzero(view.mask)), note)
    return maps, replace(estimate, lights=lights, findings=findings)


def add_tile(maps: Maps, tile: Prepared, whole: Whole, share: Floats, moved: bool) -> float:
    """Refine a tile and add it to the maps; returns the pixels whose albedo is a lower bound."""
    from rakelight.methods.multi_light.tiles import refine_tile, unmoved_tile

    found = (refine_tile if moved else unmoved_tile)(tile, whole)
    depth_m, normals = surface(tile, found)
    albedo, bounded = with_lower_bounds(tile, depth_m, normals, found)
    own = share * tile.mask
    maps.add(
        (tile.rows, tile.columns), own, depth_m, normals, np.maximum(albedo, 0),
        tile.marked(found.confidence), tile.depth_m, found.depth_sigma, found.normal_sigma,
    )  # fmt: skip
    return float((own * bounded).sum())


def finish(maps: Maps, view: PreparedView) -> float:
    """Make normals unit vectors, the albedo's 99th percentile 1, and what is outside NaN.

    Returns the factor by which the albedo was divided.
    """
    inside = np.flatnonzero(view.mask)[:: max(1, np.count_nonzero(view.mask) // SAMPLE)]
    gain = brightest(maps.albedo.reshape(-1, 3)[inside])
    for first in range(0, len(view.mask), ROWS):
        strip = slice(first, first + ROWS)
        outside = ~view.mask[strip]
        length = np.linalg.norm(maps.normals[strip], axis=-1, keepdims=True)
        maps.normals[strip] /= np.maximum(length, 1e-12)
        maps.albedo[strip] /= gain
        for each in (
            maps.depth_m, maps.normals, maps.prepared_m, maps.depth_sigma_m, maps.normal_sigma_deg
        ):  # fmt: skip
            if each is not None:
                each[strip][outside] = np.nan
    return gain

"""Large photographs: the whole object at a lower resolution, then its detail tile by tile.

Memory holds the lower resolution's solve, or the result's maps and one tile.  Tiles overlap; their
answers are blended where they do, with weights that add up to one, so that no seam is seen.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from rakelight.geometry.grid import row_strips
from rakelight.jit import side_by_side, worth_side_by_side
from rakelight.memory import available_memory, give_memory_back, require_memory
from rakelight.methods.base import Estimate, Method, brightest, lights_unused
from rakelight.model import Capture, Finding, Floats, Mask, Progress, ProgressCallback
from rakelight.pipeline.guarded import estimated, surface
from rakelight.pipeline.lower_resolution import REMEDY, coarse_view, lower_resolution
from rakelight.pipeline.saturated_albedo import bound_findings, with_lower_bounds
from rakelight.prepare import Prepared, PreparedView
from rakelight.scratch import release

if TYPE_CHECKING:
    from rakelight.methods.multi_light.tiles import Whole

# Pixels of the lower resolution by which a tile reaches beyond its share: agreement with the lower
# resolution makes the influence of a tile's border fade within four.  12 is no better, 4 shows at
# rims (scale.md).
MARGIN = 8
# Bytes of the maps for each pixel of the image, and of a tile for each of its own.
MAP_BYTES, TILE_BYTES = 48, 2000
# Most pixels of a tile: larger ones save little time.
LARGEST_TILE = 500_000
# Share of the memory that may be had which the tiles take.
TILE_SHARE = 0.7
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

    def add(self, part: tuple[slice, slice], share: Floats, answer: Answer) -> None:
        """Add a tile's maps in its part of the image, with the share (h, w) that it has there."""
        fields = (
            self.depth_m, self.normals, self.albedo, self.confidence, self.prepared_m,
            self.depth_sigma_m, self.normal_sigma_deg,
        )  # fmt: skip
        share = share.astype(np.float32)
        for into, image in zip(fields, answer.maps, strict=True):
            if into is not None and image is not None:
                own = share.reshape(*share.shape, *[1] * (image.ndim - 2))
                into[part] += np.where(own > 0, own * image, np.float32(0))


@dataclass(frozen=True, eq=False)
class Answer:
    """What a tile (h, w) adds to the maps.

    mask : the object; bounded : where its albedo is a lower bound
    maps : in the order of `Maps`, float32; None for what the method does not say
    """

    mask: Mask
    bounded: Mask
    maps: tuple[Floats | None, ...]


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

    >>> [(s.first, s.last, s.refined) for s in spans(slice(3, 203), 210, 2, 150)]
    [(2, 104, slice(2, 120, None)), (104, 204, slice(88, 204, None))]
    """
    margin = MARGIN * shrink
    first, last = window.start // shrink, -(-window.stop // shrink)
    count = -(-(last - first) * shrink // max(most - 2 * margin, margin))
    count = max(1, min(count, (last - first) // (MARGIN + 1)))  # no ramp reaches the next one
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
    shrink = lower_resolution(capture, view, chosen)
    maps_bytes, least = MAP_BYTES * view.mask.size, TILE_BYTES * (3 * MARGIN * shrink) ** 2
    # Before the work, and again of what it leaves.
    require_memory(maps_bytes + least, source=capture.source, remedy=REMEDY)
    coarse = coarse_view(capture, view, shrink)
    prepared = coarse.window(*coarse.object_window)
    unused = lights_unused(prepared, chosen)
    prepared, estimate = estimated(chosen, prepared, options, progress)
    del coarse
    give_memory_back()
    require_memory(maps_bytes + least, source=capture.source, remedy=REMEDY)
    room = TILE_SHARE * (available_memory() - maps_bytes)
    workers = worth_side_by_side() if room > 2 * least else 1
    most_pixels = min(LARGEST_TILE, int(max(least, room / workers) / TILE_BYTES))
    maps, estimate = refined_in_tiles(
        view, prepared, estimate, shrink, most_pixels, workers, progress
    )
    return unused + estimate.findings, prepared, estimate, maps


def refined_in_tiles(
    view: PreparedView,
    prepared: Prepared,
    estimate: Estimate,
    shrink: int,
    most_pixels: int,
    workers: int,
    progress: ProgressCallback,
) -> tuple[Maps, Estimate]:
    """The maps of the whole object, and the estimate with the lights in the albedo's scale.

    view : at the output resolution; prepared, estimate : of the lower resolution
    most_pixels : of a tile, with its margin; workers : how many tiles are refined side by side
    """
    from rakelight.methods.multi_light.tiles import whole_of

    whole = whole_of(prepared, estimate, shrink)
    maps, bounded = Maps.empty(view.mask.shape, estimate.depth_sigma is not None), 0.0
    rows, columns = (
        spans(part, length, shrink, int(np.sqrt(most_pixels)))
        for part, length in zip(view.object_window, view.mask.shape, strict=True)
    )
    places = [(row, column) for row in rows for column in columns]
    places = [each for each in places if view.mask[each[0].refined, each[1].refined].any()]

    def refined(place: tuple[Span, Span], check: Callable[[], None]) -> Answer:
        row, column = place
        tile = view.window(row.refined, column.refined, prepared.numbers)
        release(view.photographs)
        return answer(tile, whole, check, moved=estimate.iterations > 0)

    progress(Progress("refine tiles", 1, len(places)))
    answers = side_by_side(refined, places, workers)
    for number, ((row, column), found) in enumerate(zip(places, answers, strict=True)):
        share = np.outer(row.share(), column.share()) * found.mask
        maps.add((row.refined, column.refined), share, found)
        bounded += float((share * found.bounded).sum())
        progress(Progress("refine tiles", min(number + 2, len(places)), len(places)))
    gain = finish(maps, view)
    lights = estimate.lights
    lights = replace(lights, vector=gain * lights.vector, ambient=gain * lights.ambient)
    note = Finding(
        "note",
        "refined-in-tiles",
        f"the whole object refined at 1/{shrink} of the resolution, its detail in {len(places)} "
        "tiles",
        "give it more --memory to refine all at once",
    )
    findings = (*estimate.findings, *bound_findings(bounded / np.count_nonzero(view.mask)), note)
    return maps, replace(estimate, lights=lights, findings=findings)


def answer(tile: Prepared, whole: Whole, check: Callable[[], None], moved: bool) -> Answer:
    """A tile refined, or as it was prepared where the photographs say nothing."""
    from rakelight.methods.multi_light.tiles import refine_tile, unmoved_tile

    found = refine_tile(tile, whole, check) if moved else unmoved_tile(tile, whole)
    depth_m, normals = surface(tile, found)
    albedo, bounded = with_lower_bounds(tile, depth_m, normals, found)
    images = (
        depth_m, normals, np.maximum(albedo, 0), tile.marked(found.confidence), tile.depth_m,
        found.depth_sigma, found.normal_sigma,
    )  # fmt: skip
    return Answer(
        tile.mask,
        bounded,
        tuple(None if each is None else each.astype(np.float32) for each in images),
    )


def finish(maps: Maps, view: PreparedView) -> float:
    """Make normals unit vectors, the albedo's 99th percentile 1, and what is outside NaN.

    Returns the factor by which the albedo was divided.
    """
    inside = np.flatnonzero(view.mask)[:: max(1, np.count_nonzero(view.mask) // SAMPLE)]
    gain = brightest(maps.albedo.reshape(-1, 3)[inside])
    for strip in row_strips(len(view.mask)):
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

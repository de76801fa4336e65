"""The object nearest to the camera, segmented by depth and colour where there is no mask."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from rakelight.geometry.camera import focal_px, pixel_rays
from rakelight.geometry.grid import bounding_window
from rakelight.geometry.masks import dilate
from rakelight.model import Array, Camera, Capture, Finding, Floats, Mask
from rakelight.prepare.linear import to_linear
from rakelight.prepare.sensor import SensorGrid, sensed
from rakelight.prepare.surfaces import surfaces

REMEDY = (
    "draw the object white on black at the photographs' size and save it as mask.png, or give "
    "mask=, (H, W) bool, with the arrays"
)
# Width of the frame, over the image's side, which background reaches; depth may end before it.
FRAME = 0.04
# Of tables and walls: least fraction of the depth, least fraction of the frame, flatness in metres.
PLANE_SHARE, PLANE_FRAME, FLAT_M = 0.08, 0.04, 0.005
# Most planes; random trials for each (MSAC), and points in the sample.
PLANES, TRIALS, SAMPLE = 4, 300, 3000
# Where a plane's squared distances are truncated, over what still lies on it: below sqrt(1/2) no
# plane between a table and the top of an object, that far apart, fits better than the two.
TRUNCATED = 0.5
# Least fraction of the image's pixels of an object; exponent of nearness against size.
SMALLEST, NEARNESS = 0.002, 6
# Largest gap, pixels, between parts of one object; largest jump between them, over the object's
# width; or the object's fraction of the surroundings of a component.
GAP_PX, PART_JUMP, PART_WITHIN = 4, 0.05, 0.5
# Distance, depth pixels, from the outline by depth, within which colour decides.
COLOUR_PX = 4
# Iterations of GrabCut, and least number of pixels for a colour model.
GRABCUTS, FEWEST_COLOURS = 3, 50
# Limits for a warning: score of the second choice over the first's; agreement of depth and colour;
# fraction of the outline at the frame; fraction of the image.
RIVAL, AGREEMENT, AT_FRAME, SMALL = 0.3, 0.8, 0.03, 0.005


def cut_out(capture: Capture) -> tuple[Mask, tuple[Finding, ...]]:
    """The mask (H, W) of the object nearest to the camera, and a finding that says so.

    capture : its mask is not looked at

    From depth: planes that reach the frame are tables and walls; of what stands before them the
    surface that is nearest for its size, with the parts beside it.  From colour: the outline,
    within a few depth pixels (GrabCut; Rother et al. 2004).  The finding is a warning where
    another choice was nearly as good, where the object reaches the frame, is very small or not
    what colours say, or where nothing stands out: then all that has depth is the object.
    """
    depth, sigma = sensed(capture)
    grid = SensorGrid(depth.shape, capture.camera.shape)
    camera = capture.camera.resized(*depth.shape[::-1])
    measured = np.isfinite(depth)
    found = nearest_object(depth, sigma, camera)
    if found is None:
        mask = grid.nearest_upsample(measured)
        message = (
            "no mask, and nothing stands out from what is around it: every pixel with depth "
            f"counts as object ({mask.mean():.0%} of the image)"
        )
        return mask, (Finding("warning", "no-mask", message, REMEDY),)
    mask, agreement = outlined(found.mask, measured, _picture(capture), grid)
    reasons = list(found.reasons)
    if agreement < AGREEMENT:
        mask = grid.nearest_upsample(found.mask)
        reasons.append("its colours are those of what is around it")
    if mask.mean() < SMALL:
        reasons.append("it is very small")
    low_m, high_m = np.quantile(depth[found.mask & measured], [0.02, 0.98])
    message = (
        f"no mask: the nearest object was cut out, {mask.mean():.1%} of the image, "
        f"{low_m:.2f} to {high_m:.2f} m away"
    )
    if reasons:
        message += "; doubtful: " + ", ".join(reasons)
    return mask, (Finding("warning" if reasons else "note", "no-mask", message, REMEDY),)


@dataclass(frozen=True, slots=True)
class Found:
    """An object's mask (hs, ws) on the depth map, and why it may be the wrong one."""

    mask: Mask
    reasons: tuple[str, ...] = ()


def nearest_object(depth_m: Floats, sigma_m: Floats, camera: Camera) -> Found | None:
    """The object nearest to the camera in a depth map (h, w); None where nothing stands out.

    depth_m, sigma_m : metres, NaN = no measurement; camera : of the depth map
    """
    from scipy.ndimage import median

    measured = np.isfinite(depth_m)
    if not measured.any():
        return None
    frame = _frame(measured.shape)
    before = measured & ~behind_planes(depth_m, sigma_m, camera, frame)
    components, count = surfaces(np.where(before, depth_m, np.nan), camera)
    if count == 0:
        return None
    area = np.bincount(components[before], minlength=count)
    at_frame = np.bincount(components[before & frame], minlength=count) / np.count_nonzero(frame)
    middle_m = np.asarray(median(depth_m[before], components[before], np.arange(count)))
    large = area >= SMALLEST * measured.size
    if not large.any():
        return None
    near_weight = (middle_m[large].min() / middle_m) ** NEARNESS
    score = np.where(large, area * near_weight * np.clip(1 - 4 * at_frame, 0, 1), 0.0)
    best = int(np.argmax(score))
    # What is all there is stands out from nothing, unless nothing is all around it.
    if score[best] == 0 or (at_frame[best] > AT_FRAME and area[best] > 0.9 * measured.sum()):
        return None
    chosen = _with_its_parts(best, components, area, at_frame, depth_m, camera)
    others = np.setdiff1d(np.flatnonzero(large), chosen)
    reasons = []
    if others.size and score[others].max() > RIVAL * score[best]:
        rival = others[np.argmax(score[others])]
        reasons.append(f"another one is {middle_m[rival]:.2f} m away")
    if at_frame[chosen].sum() > AT_FRAME:
        reasons.append("it reaches the edge of the image")
    return Found(_closed(np.isin(components, chosen) & before, measured), tuple(reasons))


def behind_planes(depth_m: Floats, sigma_m: Floats, camera: Camera, frame: Mask) -> Mask:
    """Which measurements (h, w) lie on, or behind, planes that reach the frame: tables, walls.

    Inverse depth is linear in the image on a plane; planes are found by MSAC (Torr & Zisserman
    2000).
    """
    x, y = np.broadcast_arrays(*pixel_rays(camera))
    measured = np.isfinite(depth_m)
    rows = np.stack(
        [x[measured] / camera.fx, y[measured] / camera.fy, np.ones(measured.sum())], axis=-1
    )
    inverse = 1 / depth_m[measured]
    # What a deviation in depth is in inverse depth.
    allowed = (3 * sigma_m[measured] + FLAT_M) * inverse**2
    random = np.random.default_rng(0)
    left = np.ones(len(rows), dtype=bool)
    behind = np.zeros(len(rows), dtype=bool)
    for _ in range(PLANES):
        if left.sum() < PLANE_SHARE * len(rows):
            break
        plane = _largest_plane(rows[left], inverse[left], allowed[left], random)
        if plane is None:
            break
        height = inverse - rows @ plane
        on = left & (np.abs(height) <= allowed)
        if on.sum() < PLANE_SHARE * len(rows):
            break
        left &= ~on
        if _reaches(_image(on, measured), frame):
            behind |= height <= allowed
            left &= ~behind
    return _image(behind, measured)


def _image(values: Mask, measured: Mask) -> Mask:
    """Values of the measurements as an image (h, w), False where there is none."""
    image = np.zeros(measured.shape, dtype=bool)
    image[measured] = values
    return image


def _reaches(plane: Mask, frame: Mask) -> bool:
    """Whether the largest connected part of a plane's measurements (h, w) reaches the frame.

    What lies at the frame as high as the top of an object makes no table of that.
    """
    from scipy.ndimage import label

    parts, _ = label(plane)
    largest = plane & (parts == np.argmax(np.bincount(parts[plane])))
    return bool((largest & frame).sum() >= PLANE_FRAME * np.count_nonzero(frame))


def _largest_plane(
    rows: Floats, inverse: Floats, allowed: Floats, random: np.random.Generator
) -> Floats | None:
    """(3,) the plane with the least sum of truncated squared distances (MSAC).

    A count of the points within a distance would be largest for a plane tilted between two others.
    """
    few = random.choice(len(rows), min(SAMPLE, len(rows)), replace=False)
    corners = random.choice(few, (TRIALS, 3))
    sound = np.abs(np.linalg.det(rows[corners])) > 1e-6
    if not sound.any():
        return None
    planes = np.linalg.solve(rows[corners[sound]], inverse[corners[sound]][..., None])[..., 0]
    off = np.abs(planes @ rows[few].T - inverse[few]) / (TRUNCATED * allowed[few])
    plane = planes[np.argmin(np.minimum(off**2, 1).sum(axis=1))]
    for _ in range(2):
        on = np.abs(rows @ plane - inverse) <= TRUNCATED * allowed
        weighted = rows[on] / allowed[on, None], inverse[on] / allowed[on]
        plane = np.linalg.lstsq(*weighted, rcond=None)[0]
    return np.asarray(plane)


def _with_its_parts(
    best: int, components: Array, area: Array, at_frame: Floats, depth_m: Floats, camera: Camera
) -> Array:
    """The numbers of the surfaces that make up the object: beside it, at about its depth."""
    chosen, mask = [best], components == best
    width_m = np.sqrt(area[best]) * float(np.median(depth_m[mask])) / focal_px(camera)
    while True:
        around = dilate(mask, GAP_PX) & ~mask & (components >= 0)
        fresh = []
        for other in np.setdiff1d(np.unique(components[around]), chosen):
            if area[other] > area[best] or at_frame[other] > AT_FRAME:
                continue
            component = components == other
            beside = dilate(component, GAP_PX) & ~component
            within = np.count_nonzero(beside & mask) / np.count_nonzero(beside)
            near_m, far_m = (
                float(np.median(depth_m[side])) for side in (around & component, beside & mask)
            )
            if within >= PART_WITHIN or abs(near_m - far_m) <= PART_JUMP * width_m:
                fresh.append(int(other))
        if not fresh:
            return np.array(chosen)
        chosen += fresh
        mask |= np.isin(components, fresh)


def _closed(mask: Mask, measured: Mask) -> Mask:
    """The mask with its holes, but for those in which depth shows something else."""
    from scipy.ndimage import binary_fill_holes

    return np.asarray(mask | (binary_fill_holes(mask) & ~measured))


def _frame(shape: tuple[int, int]) -> Mask:
    width = max(round(FRAME * max(shape)), 1)
    frame = np.ones(shape, dtype=bool)
    frame[width:-width, width:-width] = False
    return frame


def _picture(capture: Capture) -> Array:
    """(H, W, 3) uint8, blue green red: the mean photograph, as bright as eyes like it."""
    mean = np.zeros((*capture.camera.shape, 3), dtype=np.float32)
    for photograph in capture.photographs:
        mean += to_linear(photograph, capture.encoding)
    brightest = max(float(np.quantile(mean[::4, ::4], 0.99)), 1e-6)
    return np.asarray(255 * np.sqrt(np.clip(mean / brightest, 0, 1)), np.uint8)[..., ::-1]


def outlined(mask: Mask, measured: Mask, picture: Array, grid: SensorGrid) -> tuple[Mask, float]:
    """The mask (hs, ws) at the picture's resolution with the outline where colours change.

    measured : (hs, ws) where there is depth; picture : (H, W, 3) uint8

    Also how much of both masks agrees: their intersection over their union.
    """
    from scipy.ndimage import binary_erosion, distance_transform_edt

    square = np.ones((3, 3), dtype=bool)
    inner = binary_erosion(mask, square, iterations=2, border_value=1)
    # Narrow parts have no interior; there the depth decides.
    thin = mask & ~dilate(inner, 4)
    elsewhere = binary_erosion(measured & ~mask, square, iterations=1, border_value=1)
    elsewhere |= distance_transform_edt(~mask) > COLOUR_PX
    window = bounding_window(grid.nearest_upsample(dilate(mask, 3 * COLOUR_PX)))
    coarse = grid.nearest_upsample(mask)[window]
    trimap = np.where(coarse, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    trimap[grid.nearest_upsample(inner | thin)[window]] = cv2.GC_FGD
    trimap[grid.nearest_upsample(elsewhere)[window]] = cv2.GC_BGD
    if min(np.count_nonzero(trimap == side) for side in (cv2.GC_FGD, cv2.GC_BGD)) >= FEWEST_COLOURS:
        colours = np.zeros((1, 65)), np.zeros((1, 65))
        cv2.setRNGSeed(0)
        image = np.ascontiguousarray(picture[window])
        cv2.grabCut(image, trimap, (0, 0, 0, 0), *colours, GRABCUTS, cv2.GC_INIT_WITH_MASK)
    fine = (trimap == cv2.GC_FGD) | (trimap == cv2.GC_PR_FGD)
    full = np.zeros(grid.shape, dtype=bool)
    full[window] = _tidy(fine, coarse)
    agreement = (full[window] & coarse).sum() / max((full[window] | coarse).sum(), 1)
    return full, float(agreement)


def _tidy(fine: Mask, coarse: Mask) -> Mask:
    """Without specks and pinholes: no component or hole smaller than a hundredth of the object."""
    from scipy.ndimage import label

    fine = fine.copy()
    for value in (True, False):
        labels, _ = label(fine == value)
        small = np.bincount(labels.ravel()) < 0.01 * coarse.sum()
        small[0] = False
        fine[small[labels]] = not value
    return fine

"""Implicit registration: a small correction of the depth camera's pose, from the photographs.

The photographs align detail of the refined depth with the colour camera: relief, limbs, creases.
The sensor's measurements show the same detail where the depth camera's pose puts it.  With xi a
rotation about the object's middle and a translation, both small, the measurement at pixel q is

    log z(q) = (K log p)(q) - J(q) xi + B(q) b + noise

p the refined depth, J xi its change at a fixed pixel by the motion xi (Lucas & Kanade 1981, for
depth), B b the bas-relief transform that photographs under unknown lights leave open, 1/z -> a/z +
b.(x, y, 1) (Belhumeur et al. 1999, in perspective).  Refining with a small depth weight and solving
for xi and b take turns until xi has converged.  Other differences between sensor and photographs
are smooth, so both sides are compared without their low frequencies.

Combinations that the data do not determine stay as given: pitch, yaw and forward motion look like
B b, roll is undetermined for a body of revolution.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rakelight.errors import CaptureError
from rakelight.geometry.camera import back_project, pixel_rays
from rakelight.geometry.grid import mean_gradient, surface_links
from rakelight.methods.multi_light import MultiLight, multi_light
from rakelight.model import (
    MAD_TO_SIGMA,
    Camera,
    Capture,
    Finding,
    Floats,
    Lights,
    Mask,
    Progress,
    ProgressCallback,
    RigidTransform,
    silent,
)
from rakelight.pipeline.degenerate import without_normals
from rakelight.prepare import Prepared, coarsest_scale, prepare
from rakelight.prepare.sensor import depth_camera_of
from rakelight.solve.robust import CAUCHY

# Rounds of refining and registering; iterations of reweighted least squares in each; most steps of
# refining in each.
ROUNDS, ROBUST_STEPS, BRIEF = 10, 15, 6
# Depth weight while registering, so small that the surface follows the photographs: the smaller,
# the fewer rounds it takes.
DEPTH_WEIGHT = 1.0
# Shift by a round, depth pixels, root mean square over the object, below which it has converged.
CONVERGED_PX = 0.05
# Prior standard deviations of the pose: each rotation, shift, forward motion over distance; and how
# many of these a correction may be.
ROTATION_RAD, SHIFT_PX, FORWARD = np.radians(1.0), 4.0, 0.0025
FARTHEST = 3.0
# Prior standard deviation of the bas-relief transform's four numbers, so large that they are free.
OPEN = 0.3
# Standard deviation, depth pixels, of the blur whose result is subtracted as low frequencies.
COARSE_PX = 8.0
# The model's own error of position, depth pixels: it adds to the variance where the depth is steep.
PLACE_PX = 0.5
# Area, depth pixels, over which errors are correlated, and the most independent errors: those of
# the refined surface are as large as the object, whatever the resolution.
CORRELATION_AREA_PX, INDEPENDENT = 20.0, 200.0
# Information on a combination of the six, over the prior's, above which it is determined.
LEAST_INFORMATION = 5.0


@dataclass(frozen=True, slots=True)
class PoseUpdate:
    """The update of the pose by one round, in prior standard deviations.

    xi : (6,) the correction from here; determined : (6,) share of each that data determine, 0..1
    """

    xi: Floats
    determined: Floats


def registered(
    capture: Capture, options: MultiLight, progress: ProgressCallback = silent
) -> Capture:
    """The capture with the pose of its depth camera corrected, and a finding that says by what.

    Depth that covers the colour image's view gets a camera of its own.  A capture whose pose is
    right to a twentieth of a pixel is returned with it unchanged, and so is one of an object that
    has no normals at the depth's resolution.
    """
    own, start = depth_camera_of(capture)
    scale = coarsest_scale(capture)
    options = replace(
        options, depth_weight=DEPTH_WEIGHT, max_iterations=min(options.max_iterations, BRIEF)
    )
    first = _comparable(capture, scale)
    if first is None:
        finding = _doubtful("the object is nowhere two depth pixels wide")
        return replace(capture, findings=(*capture.findings, finding))
    pose = start
    middle: Floats = np.zeros(3)
    total: Floats = np.zeros(6)
    unit: Floats = np.ones(6)
    determined, moved_px = total, np.inf
    for step in range(ROUNDS):
        progress(Progress("register", step + 1, ROUNDS))
        placed = replace(capture, depth_camera=own, depth_to_color=pose)
        prepared = prepare(placed, scale) if step else first
        estimate = multi_light(prepared, options, silent)
        log_depth = estimate.log_depth
        if step == 0:
            options = of_kind(options, estimate.lights)
            middle = back_project(np.exp(log_depth), prepared.camera)[prepared.mask].mean(axis=0)
            shift_m = SHIFT_PX * middle[2] / own.fx
            unit = np.array([*[ROTATION_RAD] * 3, shift_m, shift_m, FORWARD * middle[2]])
        update = correction(prepared, log_depth, middle, unit, total)
        before = total
        total = np.clip(total + update.xi, -FARTHEST, FARTHEST)
        determined = update.determined
        pose = rotated(start, total * unit, middle)
        moved_px = in_plane_px(prepared, log_depth, middle, (total - before) * unit)
        if moved_px < CONVERGED_PX:
            break
    off_px = in_plane_px(prepared, log_depth, middle, total * unit)
    findings = (
        *capture.findings,
        _found(total * unit, off_px, determined),
        *_registration_findings(total, moved_px, determined),
    )
    if off_px < CONVERGED_PX:
        return replace(capture, findings=findings)
    return replace(capture, depth_camera=own, depth_to_color=pose, findings=findings)


def of_kind(options: MultiLight, lights: Lights) -> MultiLight:
    """The options with the kind of these lights, so that no other kind is tried again.

    But for beams, which make up for some of what a wrong pose does.
    """
    return replace(
        options,
        lights="white" if lights.ambient.shape[1] == 1 else "coloured",
        distance="distant" if lights.position_m is None else "near",
    )


def rotated(pose: RigidTransform, xi: Floats, middle_m: Floats) -> RigidTransform:
    """A pose followed by a rotation by xi[:3] about a point, then a translation by xi[3:].

    xi : (6,) rotation vector, radians, and translation, metres; middle_m : (3,) the point

    >>> here = RigidTransform(np.eye(3), np.zeros(3))
    >>> roll = np.array([0, 0, np.pi / 2, 0, 0, 0.1])
    >>> found = rotated(here, roll, np.array([1.0, 0.0, 2.0]))
    >>> (found.rotation @ [2.0, 0.0, 2.0] + found.translation_m).round(9).tolist()
    [1.0, 1.0, 2.1]
    """
    from scipy.spatial import transform

    rotation = transform.Rotation.from_rotvec(xi[:3]).as_matrix()
    there = rotation @ (pose.translation_m - middle_m) + middle_m + xi[3:]
    return RigidTransform(rotation @ pose.rotation, there)


def correction(
    prepared: Prepared, log_depth: Floats, middle_m: Floats, unit: Floats, total: Floats
) -> PoseUpdate:
    """How far the sensor's measurements are from a refined log depth (h, w), as a motion.

    unit : (6,) the standard deviations of the pose; total : (6,) its correction so far, in these

    Robust Gauss-Newton; combinations of the six that the data do not determine go back to 0.
    """
    averaging = prepared.sensor.averaging(prepared.mask)
    change = averaged_change(prepared, log_depth, middle_m) * np.append(unit, [OPEN] * 4)
    area = averaging.total(np.ones(prepared.mask.shape))
    seen = prepared.sensor.measured & (area > 0.999 * area.max())
    measured = np.log(np.where(seen, prepared.sensor.depth_m, 1.0))
    error = fine(averaging.down(log_depth) - measured, seen)[seen]
    slopes = np.stack([fine(change[..., k], seen)[seen] for k in range(10)], axis=-1)
    gradient = mean_gradient(log_depth, prepared.mask)
    steep = averaging.down(gradient[0] ** 2 + gradient[1] ** 2)[seen]
    correlation_area = max(CORRELATION_AREA_PX, len(error) / INDEPENDENT)
    place = (PLACE_PX * prepared.factor) ** 2 * steep

    step = np.zeros(10)
    for _ in range(ROBUST_STEPS):
        residual = error - slopes @ step
        noise = MAD_TO_SIGMA * float(np.median(np.abs(residual)))
        variance = max(noise, 1e-9) ** 2 + place
        weight = 1 / (variance + (residual / CAUCHY) ** 2) / correlation_area
        hessian = (slopes * weight[:, None]).T @ slopes
        slope = (slopes * weight[:, None]).T @ error
        # The bas-relief transform is eliminated; the pose moves in the determined directions.
        rest = hessian[6:, 6:] + np.eye(4)
        across = np.linalg.solve(rest, hessian[6:, :6])
        information, directions = np.linalg.eigh(hessian[:6, :6] - hessian[:6, 6:] @ across)
        informed, to_prior = (
            directions.T @ (slope[:6] - across.T @ slope[6:]),
            -directions.T @ total,
        )
        determined = information > LEAST_INFORMATION
        along = np.where(
            determined, informed / np.maximum(information, LEAST_INFORMATION), to_prior
        )
        xi = directions @ along
        step = np.append(xi, np.linalg.solve(rest, slope[6:] - hessian[6:, :6] @ xi))
    return PoseUpdate(step[:6], (directions**2 * determined).sum(axis=1))


def averaged_change(prepared: Prepared, log_depth: Floats, middle_m: Floats) -> Floats:
    """(hs, ws, 10) derivatives of log depth at the sensor's pixels with motions and what is open.

    The six motions of `image_motion`, then the four of 1/z -> a/z + b.(x, y, 1).
    """
    camera, mask = prepared.camera, prepared.mask
    depth_m = np.exp(log_depth)
    u, v, ahead = image_motion(depth_m, camera, middle_m)
    links = surface_links(depth_m, mask, camera)
    along_u, along_v = (slope[..., None] for slope in mean_gradient(log_depth, links))
    x, y = pixel_rays(camera)
    relative = depth_m / middle_m[2]
    width = mask.shape[1] / camera.fx
    free = np.stack(
        [np.ones(mask.shape), relative, relative * x / camera.fx / width,
         relative * y / camera.fy / width], axis=-1,
    )  # fmt: skip
    change = np.concatenate([ahead - along_u * u - along_v * v, free], axis=-1)
    averaging = prepared.sensor.averaging(mask)
    return np.stack([averaging.down(change[..., k]) for k in range(10)], axis=-1)


def image_motion(
    depth_m: Floats, camera: Camera, middle_m: Floats
) -> tuple[Floats, Floats, Floats]:
    """How points (h, w) move in the picture, u and v in pixels, and away, in log depth.

    Each (h, w, 6): per radian about the axes through `middle_m` (3,), per metre along them.
    """
    points = back_project(depth_m, camera)
    axes = np.eye(3)
    rotations = [np.cross(axis, points - middle_m) for axis in axes]
    shifts = [np.broadcast_to(axis, points.shape) for axis in axes]
    x, y, z = np.moveaxis(np.stack([*rotations, *shifts], axis=-1) / depth_m[..., None, None], 2, 0)
    across, down = (ray[..., None] for ray in pixel_rays(camera))
    return camera.fx * x - across * z, camera.fy * y - down * z, z


def in_plane_px(prepared: Prepared, log_depth: Floats, middle_m: Floats, xi: Floats) -> float:
    """Root mean square, in depth pixels, of the object's shift in the picture by xi."""
    u, v, _ = image_motion(np.exp(log_depth), prepared.camera, middle_m)
    square = ((u @ xi) ** 2 + (v @ xi) ** 2)[prepared.mask]
    return float(np.sqrt(square.mean())) / prepared.factor


def fine(image: Floats, seen: Mask) -> Floats:
    """An image (hs, ws) without its low frequencies, those of the pixels that are seen."""
    from scipy.ndimage import gaussian_filter

    smooth, share = (
        gaussian_filter(np.where(seen, each, 0.0), COARSE_PX, mode="constant")
        for each in (image, np.ones(seen.shape))
    )
    return np.asarray(image - smooth / np.maximum(share, 1e-9))


def _found(xi: Floats, off_px: float, determined: Floats) -> Finding:
    degrees = ", ".join(f"{value:.2f}" for value in np.degrees(xi[:3]))
    millimetres = ", ".join(f"{value:.2f}" for value in 1000 * xi[3:])
    names = np.array(["pitch", "yaw", "roll", "right", "down", "forward"])
    unchanged = ", ".join(names[determined < 0.5])
    message = (
        f"depth camera moved by {off_px:.2f} depth pixels: turned by ({degrees}) degrees about "
        f"the object's middle, shifted by ({millimetres}) mm"
    )
    return Finding(
        "note", "registered", message + (f"; left as given: {unchanged}" if unchanged else "")
    )


def _registration_findings(
    total: Floats, moved_px: float, determined: Floats
) -> tuple[Finding, ...]:
    """A warning where the correction is at its bounds, has not converged, or is undetermined."""
    if (determined[3:5] < 0.5).any():
        why = "the object's relief does not say where the depth lies in the picture"
    elif (np.abs(total) >= FARTHEST).any():
        why = f"more than {FARTHEST * SHIFT_PX:g} depth pixels or {FARTHEST:g} degrees"
    elif moved_px >= CONVERGED_PX:
        why = f"still moving by {moved_px:.2f} depth pixels after {ROUNDS} rounds"
    else:
        return ()
    return (_doubtful(why),)


def _doubtful(why: str) -> Finding:
    fix = "calibrate the cameras, or take register = true out of capture.toml"
    return Finding("warning", "registration-doubtful", f"registration: {why}", fix)


def _comparable(capture: Capture, scale: int) -> Prepared | None:
    """The capture prepared; None without normals at this scale, or photographs that show them."""
    try:
        prepared = prepare(capture, scale)
        return prepared if without_normals(prepared) is None else None
    except CaptureError:  # refining raises it again, where it is not due to the scale
        return None

"""The depth sensor's measurements on its own grid, and how its pixels lie on the photographs'."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.errors import CaptureError
from rakelight.geometry.averaging import LEAST_SHARE, Averaging, overlaps
from rakelight.geometry.camera import back_project, require_ideal
from rakelight.geometry.grid import bounding_window
from rakelight.model import Array, Camera, Capture, Floats, Mask, RigidTransform, SensorNoise
from rakelight.prepare.average import NEIGHBOURHOOD_PX, noise_sigma, robust_average
from rakelight.prepare.flying import flying, stray
from rakelight.prepare.mixed_holes import mixed_with_holes
from rakelight.prepare.register import project, register, sensor_grid
from rakelight.prepare.soft_edges import mixed_with_background

# By how much rounding to whole pixels changes the side of a depth map, pixels.
ROUNDED_PX = 0.5


@dataclass(frozen=True, slots=True)
class SensorDepth:
    """What the sensor measured of the object, at the sensor's resolution, and where that lies.

    depth_m : (hs, ws) metres, NaN = no measurement; not filled, not smoothed
    sigma_m : (hs, ws) its standard deviation, metres, NaN where there is no measurement
    row_edges, column_edges : (hs + 1,), (ws + 1,) where its pixels begin and end, in pixels of the
        output window from its upper left corner: pixel (i, j) covers rows row_edges[i] to
        row_edges[i + 1].  Whole numbers where the ratio is one; the outermost pixels may reach
        beyond the window.
    """

    depth_m: Floats
    sigma_m: Floats
    row_edges: Floats
    column_edges: Floats

    @property
    def measured(self) -> Mask:
        """(hs, ws) where there is a measurement."""
        return np.isfinite(self.depth_m)

    def averaging(self, mask: Mask) -> Averaging:
        """The averaging operator K of a window with that mask (h, w)."""
        return Averaging.on(mask, self.row_edges, self.column_edges)

    def nearest_upsample(self, image: Floats, shape: tuple[int, ...]) -> Floats:
        """(h, w) the value of the sensor pixel (hs, ws) that holds each window pixel's centre."""
        return at_centres(image, (self.row_edges, self.column_edges), shape)


def no_depth(capture: Capture) -> CaptureError:
    """The error for a capture whose depth lies beside its object, or has holes there.

    >>> camera = Camera(2, 2, 2.0, 2.0, 0.5, 0.5)
    >>> beside = np.array([[[np.nan, np.nan], [0.6, 0.6]]])
    >>> raise no_depth(Capture(np.zeros((1, 2, 2, 3), np.uint8), beside, np.eye(2) > 0, camera))
    Traceback (most recent call last):
    rakelight.errors.CaptureError: no depth on the object (seen 2 depth pixels measured, none of
    them on it, needed depth where the mask marks the object). Fix: check that depth and mask ...
    """
    count = int(np.isfinite(capture.depth_m).any(axis=0).sum())
    remedy = "check that depth and mask belong together"
    if capture.depth_camera is not None:
        remedy += ", and depth_intrinsics and depth_to_color: they put the depth beside the object"
    return CaptureError(
        "no depth on the object",
        source=capture.source,
        seen=f"{count} depth pixels measured, none of them on it",
        needed="depth where the mask marks the object",
        remedy=remedy,
    )


@dataclass(frozen=True, slots=True)
class SensorGrid:
    """A sensor's pixels (hs, ws) over the same view as an image's (h, w).

    Where `shape` is a multiple of `sensor`, sensor pixels are blocks; else they share image pixels
    at their edges, by area.
    """

    sensor: tuple[int, int]
    shape: tuple[int, int]

    @property
    def factor(self) -> float:
        """Image pixels per sensor pixel, along each side; the geometric mean of both."""
        rows, columns = (side / small for side, small in zip(self.shape, self.sensor, strict=True))
        return rows if rows == columns else float(np.sqrt(rows * columns))

    @property
    def fits(self) -> bool:
        """Whether both can show one view: no sensor pixel is narrower, and the proportions agree.

        Along the side where they agree better, to `ROUNDED_PX`.

        >>> SensorGrid((192, 256), (3024, 4032)).fits, SensorGrid((192, 256), (720, 1280)).fits
        (True, False)
        >>> SensorGrid((188, 250), (750, 1000)).fits, SensorGrid((480, 639), (960, 1280)).fits
        (True, False)
        """
        (small_h, small_w), (height, width) = self.sensor, self.shape
        off = min(abs(small_w - small_h * width / height), abs(small_h - small_w * height / width))
        return off <= ROUNDED_PX and small_h <= height and small_w <= width

    def edges(self, axis: int) -> Floats:
        """Where the sensor's pixels begin and end along an axis, in image pixels."""
        count, side = self.sensor[axis], self.shape[axis]
        return np.arange(count + 1) * side / count

    def touched(self, mask: Mask) -> Mask:
        """(hs, ws) the sensor pixels that any of the mask's (h, w) lies in.

        >>> SensorGrid((1, 2), (2, 3)).touched(np.array([[0, 1, 0], [0, 0, 0]], bool)).tolist()
        [[True, True]]
        """
        return self._area(mask) > LEAST_SHARE

    def covered(self, mask: Mask) -> Mask:
        """(hs, ws) the sensor pixels that lie in the mask (h, w) whole.

        >>> SensorGrid((1, 2), (2, 3)).covered(np.array([[1, 1, 0], [1, 1, 0]], bool)).tolist()
        [[True, False]]
        """
        return self._area(~mask) <= LEAST_SHARE

    def share(self, mask: Mask) -> Floats:
        """(hs, ws) how much of each sensor pixel lies in the mask (h, w), 0 to 1.

        >>> SensorGrid((1, 2), (2, 3)).share(np.array([[1, 1, 0], [1, 1, 0]], bool)).round(3)
        array([[1.   , 0.333]])
        """
        return self._area(mask) * np.prod(self.sensor) / np.prod(self.shape)

    def of_object(self, mask: Mask) -> Mask:
        """(hs, ws) the sensor pixels that show the object alone; if none does, all that touch it.

        >>> SensorGrid((1, 2), (2, 3)).of_object(np.array([[1, 1, 0], [1, 1, 0]], bool)).tolist()
        [[True, False]]
        >>> SensorGrid((1, 1), (2, 3)).of_object(np.array([[1, 1, 0], [1, 1, 0]], bool)).tolist()
        [[True]]
        """
        whole = self.covered(mask)
        return whole if whole.any() else self.touched(mask)

    def _area(self, mask: Mask) -> Floats:
        """(hs, ws) how many of the mask's pixels (h, w) lie in each sensor pixel."""
        rows, columns = (overlaps(self.edges(axis), self.shape[axis]) for axis in (0, 1))
        return np.asarray(rows @ mask.astype(float) @ columns.T)

    def nearest_upsample(self, image: Array, window: tuple[slice, slice] = np.s_[:, :]) -> Array:
        """(h, w) the value of the sensor pixel (hs, ws) that holds each pixel's centre.

        window : rows and columns of which it is wanted

        >>> SensorGrid((1, 2), (1, 3)).nearest_upsample(np.array([[5, 6]])).tolist()
        [[5, 6, 6]]
        """
        return at_centres(image, (self.edges(0), self.edges(1)), self.shape, window)

    def window(
        self, depth_m: Floats, sigma_m: Floats, measured: Mask, rows: slice, columns: slice
    ) -> SensorDepth:
        """The sensor's pixels (hs, ws) that reach into a window of the image."""
        parts, ends = [], []
        for axis, part in enumerate((rows, columns)):
            edges = self.edges(axis)
            first = int(np.searchsorted(edges, part.start + LEAST_SHARE, "right")) - 1
            last = int(np.searchsorted(edges, part.stop - LEAST_SHARE, "left"))
            parts.append(slice(first, last))
            ends.append(edges[first : last + 1] - part.start)
        depth, sigma = (np.where(measured, image, np.nan)[*parts] for image in (depth_m, sigma_m))
        return SensorDepth(depth, sigma, *ends)


def at_centres(
    image: Array,
    edges: tuple[Floats, Floats],
    shape: tuple[int, ...],
    window: tuple[slice, slice] = np.s_[:, :],
) -> Array:
    """(h, w) an image (hs, ws) whose pixels have those edges, at the pixel centres of `shape`.

    window : rows and columns of `shape` that are wanted
    """
    rows, columns = (
        np.searchsorted(each, np.arange(side)[part] + 0.5, "right") - 1
        for each, side, part in zip(edges, shape, window, strict=True)
    )
    return image[np.ix_(rows, columns)]


def depth_camera_of(capture: Capture) -> tuple[Camera, RigidTransform]:
    """The depth camera and its pose: of aligned depth, one at the colour camera's place.

    >>> capture = Capture(np.zeros((3, 6, 9, 3), np.uint8), np.ones((1, 2, 3)),
    ...                   np.ones((6, 9), bool), Camera(9, 6, 12.0, 12.0, 4.0, 2.5))
    >>> camera, pose = depth_camera_of(capture)
    >>> camera.shape, camera.fx, pose.translation_m.tolist()
    ((2, 3), 4.0, [0.0, 0.0, 0.0])
    """
    own = capture.depth_camera or capture.camera.resized(*capture.depth_m.shape[:0:-1])
    return own, capture.depth_to_color or RigidTransform(np.eye(3), np.zeros(3))


def sensor_shape(capture: Capture) -> tuple[int, int]:
    """(hs, ws) of the grid that `sensed` answers on.

    Raises CaptureError where the capture's arrays do not fit each other.
    """
    if capture.depth_camera is None:
        if capture.depth_to_color is not None:
            raise CaptureError(
                "depth_to_color without depth_camera",
                source=capture.source,
                remedy="give both, or neither when the depth is aligned to the colour",
            )
        maps = capture.depth_m.shape
        if len(maps) == 3 and SensorGrid(maps[1:], capture.camera.shape).fits:
            return maps[1], maps[2]
        raise CaptureError(
            "depth_m and colour camera are of different size",
            source=capture.source,
            seen=str(maps[1:]),
            needed=f"the proportions of {capture.camera.shape}, and no more pixels",
            remedy="give depth_camera, where the depth is another camera's",
        )
    _require_size(capture, "depth_m", capture.depth_m.shape[1:], capture.depth_camera.shape)
    return sensor_grid(capture.camera, capture.depth_camera).shape


def check_sizes(capture: Capture) -> None:
    """Photographs and mask have the colour camera's size; raises CaptureError.

    InputError for a colour camera with lens distortion: `undistorted` comes first.
    """
    require_ideal(capture.camera, capture.source or "camera")
    size = capture.camera.shape
    _require_size(capture, "photographs", capture.photographs.shape[1:], (*size, 3))
    _require_size(capture, "mask", capture.mask.shape, size)


def _require_size(
    capture: Capture, name: str, seen: tuple[int, ...], needed: tuple[int, ...]
) -> None:
    if seen != needed:
        camera = "depth" if name == "depth_m" else "colour"
        raise CaptureError(
            f"{name} and {camera} camera are of different size",
            source=capture.source,
            seen=str(seen),
            needed=str(needed),
        )


def sensed(capture: Capture, mask: Mask | None = None) -> tuple[Floats, Floats]:
    """The sensor's depth and its standard deviation (hs, ws), metres, before the colour camera.

    Of several maps the average; stray and flying pixels left out, of an object's those that were
    mixed with holes, and of depth that is aligned with the photographs those that were mixed with
    the background; depth of a camera of its own registered to the colour camera, on the pixels of
    `sensor_grid`.

    mask : (H, W) the object in the photographs; None for everything.  What is further than a few
        pixels from it may be missing, and its noise is that which counts.
    """
    require_ideal(capture.camera, capture.source or "camera")
    shape = sensor_shape(capture)
    if capture.depth_camera is not None:
        own, pose = depth_camera_of(capture)
        average = robust_average(capture.depth_m)
        points = project(back_project(average, own), pose, capture.camera)
        on_object = _lookup(mask, points)
        if mask is not None:
            average = np.where(mixed_with_holes(average, on_object), np.nan, average)
        depth, sigma = _without_outliers(average, capture, capture.depth_m, own, on_object)
        return register(depth, sigma, own, pose, sensor_grid(capture.camera, own))
    on_object = (
        np.ones(shape, bool) if mask is None else SensorGrid(shape, mask.shape).touched(mask)
    )
    depth, sigma = np.full(shape, np.nan), np.full(shape, np.nan)
    if on_object.any():
        part = bounding_window(on_object, margin=NEIGHBOURHOOD_PX)
        maps_m = capture.depth_m[:, *part]
        camera = capture.camera.resized(shape[1], shape[0]).cropped(*part)
        average = robust_average(maps_m)
        if mask is not None:
            first, noise = capture.depth_m[0], capture.depth_noise or SensorNoise()
            share = SensorGrid(shape, mask.shape).share(mask)
            mixed = mixed_with_background(first, noise.at(first), share)[part]
            mixed |= mixed_with_holes(average, on_object[part])
            average = np.where(mixed, np.nan, average)
        depth[part], sigma[part] = _without_outliers(
            average, capture, maps_m, camera, on_object[part]
        )
    return depth, sigma


def _without_outliers(
    average: Floats, capture: Capture, maps_m: Floats, camera: Camera, on_object: Mask
) -> tuple[Floats, Floats]:
    """The average (h, w) of maps and its noise, without stray and flying pixels."""
    model = capture.depth_noise or SensorNoise()
    average = np.where(stray(average, model.at(average), camera), np.nan, average)
    sigma = noise_sigma(average, capture.depth_noise, maps_m, on_object)
    between = flying(average, sigma, camera)
    return np.where(between, np.nan, average), np.where(between, np.nan, sigma)


def _lookup(mask: Mask | None, points: Floats) -> Mask:
    """Which of the pixel positions (h, w, 3) as u, v, z lie in a mask; all without one."""
    if mask is None:
        return np.isfinite(points[..., 2])
    height, width = mask.shape
    u, v = (np.rint(np.nan_to_num(points[..., i], nan=-9)) for i in (0, 1))
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    hit = np.zeros(inside.shape, dtype=bool)
    hit[inside] = mask[v[inside].astype(int), u[inside].astype(int)]
    return hit

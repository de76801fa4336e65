"""What is kept of every frame of a recording while it is walked through: small pictures, figures.

Of 60 seconds at 30 frames a second no more than 400 MB stay, whatever the frames' size.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from rakelight.capture.recording import Recording, evenly
from rakelight.errors import CaptureError
from rakelight.geometry.grid import bounding_window
from rakelight.model import SATURATED, Array, Capture, Floats, Mask, Progress, ProgressCallback
from rakelight.prepare.detail import detail, grey
from rakelight.prepare.linear import linear_table

# Frames that are looked at, at most: 60 seconds at 30 a second.  Of more, every second or third.
MOST_FRAMES = 1800
# Margin around the object, over its width, for the background behind it.
MARGIN = 0.1
# Longest sides, pixels, of the pictures that are kept: in linear light and colour, for what light
# explains; of detail, for motion; and of that on which sharpness is measured and which is not kept.
SMALL_PX, DETAIL_PX, SHARP_PX = 96, 320, 640
# Bytes of each kind that are kept of all frames, at most: the pictures are smaller where need be.
SMALL_BYTES, DETAIL_BYTES = 240e6, 160e6
# Of every so many pixels along each side one is looked at for saturation.
STRIDE = 8
# Depth maps whose average shows which object is meant.
OBJECT_MAPS = 9


@dataclass(frozen=True)
class Frames:
    """What is kept of N frames, cut to the object and a margin around it.

    numbers : (N,) of the frames in the recording; times_s : (N,) from its first frame
    small : (N, h, w, 3) float32 linear light
    detail : (N, hd, wd) uint8 what light changes least
    sharpness : (N,) gradients of the finest scale over those of a coarser one
    saturated : (N,) fraction of the object's pixels
    brightness : (N,) the object's 90th percentile, linear light
    mask, detail_mask : (h, w), (hd, wd) where the object is
    window : rows and columns of the recording that the pictures show
    timed : whether `times_s` are stated
    """

    numbers: Array
    times_s: Floats
    small: Floats
    detail: Array
    sharpness: Floats
    saturated: Floats
    brightness: Floats
    mask: Mask
    detail_mask: Mask
    window: tuple[slice, slice]
    timed: bool = True

    def __len__(self) -> int:
        return len(self.numbers)


def look_through(recording: Recording, progress: ProgressCallback) -> Frames:
    """Walk the colour stream once and keep small pictures and figures of its frames."""
    total = len(recording.color)
    numbers = np.arange(0, total, -(-total // MOST_FRAMES))
    mask = wanted_object(recording)
    window = bounding_window(mask, round(MARGIN * np.sqrt(mask.sum())))
    inside = mask[window]
    sharp, fine, small = _sizes(inside.shape, len(numbers))
    kept = Frames(
        numbers=numbers,
        times_s=recording.color.times_s[numbers] - recording.color.times_s[0],
        small=np.empty((len(numbers), *small, 3), np.float32),
        detail=np.empty((len(numbers), *fine), np.uint8),
        sharpness=np.empty(len(numbers)),
        saturated=np.empty(len(numbers)),
        brightness=np.empty(len(numbers)),
        mask=_shown(inside, small),
        detail_mask=_shown(inside, fine),
        window=window,
        timed=recording.color.timed,
    )
    sharp_mask = _shown(inside, sharp)
    step = STRIDE if inside[::STRIDE, ::STRIDE].any() else 1
    strided = inside[::step, ::step]
    seen = 0
    for k, (number, image) in enumerate(recording.color.walk(numbers.tolist())):
        if k >= len(numbers) or number != numbers[k]:
            break
        part = image[window]
        top = np.iinfo(part.dtype).max
        kept.saturated[k] = (part[::step, ::step][strided] >= SATURATED * top).any(axis=-1).mean()
        medium = _resized(part, sharp)
        kept.sharpness[k] = sharpness(medium, sharp_mask)
        little = _resized(medium, fine)
        kept.detail[k] = detail(little)
        linear = linear_table(little.dtype, recording.color.encoding).take(little)
        kept.small[k] = _resized(linear, small)
        kept.brightness[k] = np.quantile(kept.small[k][kept.mask].max(axis=-1), 0.9)
        seen = k + 1
        if seen % 10 == 0 or seen == len(numbers):
            progress(Progress("read", seen, len(numbers)))
    if seen < len(numbers):
        raise _missing(recording, seen, len(numbers))
    return kept


def _missing(recording: Recording, seen: int, needed: int) -> CaptureError:
    return CaptureError(
        "frames are missing",
        source=recording.source,
        seen=f"{seen} of {needed}",
        remedy="record it again, or copy it again from the camera",
    )


def wanted_object(recording: Recording) -> Mask:
    """(H, W) the nearest object by the depth of a few frames; everything where none is found."""
    from rakelight.capture.defaults import object_mask

    maps = evenly(len(recording.depth), OBJECT_MAPS)
    frame = [len(recording.color) // 2]
    photographs = [image for _, image in recording.color.walk(frame)]
    depth = [each for _, each in recording.depth.walk(maps)]
    if not photographs or not depth:
        raise _missing(recording, 0, 1)
    everything = np.ones(recording.color.shape, bool)
    capture = Capture(
        photographs=np.stack(photographs),
        depth_m=np.stack(depth),
        mask=everything,
        camera=recording.camera,
        encoding=recording.color.encoding,
        depth_camera=recording.depth_camera,
        depth_to_color=recording.depth_to_color,
        depth_noise=recording.depth_noise,
        source=recording.source,
    )
    try:
        mask, _ = object_mask(capture, recording.source, "")
    except CaptureError:  # said again, with its reason, of the depth of the frames that are taken
        return everything
    return mask


def sharpness(image: Array, mask: Mask) -> float:
    """Gradients of the finest scale over those twice as coarse, the smaller of both axes.

    image : (h, w, 3) as stored; mask : (h, w) where it counts.  A ratio of both scales changes
    less with the light than either.  Moved along one axis, an image is blurred along that.
    """
    values = grey(image)
    coarse = cv2.GaussianBlur(values, (0, 0), 2.0)
    ratios = []
    for first, second in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        inside = np.ascontiguousarray(mask[second], np.uint8)
        fine_step, coarse_step = (
            cv2.mean(cv2.absdiff(each[second], each[first]), inside)[0] for each in (values, coarse)
        )
        ratios.append(fine_step / max(coarse_step, 1e-9))
    return min(ratios)


def _sizes(
    shape: tuple[int, ...], frames: int
) -> tuple[tuple[int, int], tuple[int, int], tuple[int, int]]:
    """(rows, columns) of the pictures for sharpness, of detail, and of the small ones."""
    height, width = shape

    def fitting(longest: float, pixels: float = np.inf) -> tuple[int, int]:
        ratio = min(1.0, longest / max(height, width), np.sqrt(pixels / (height * width)))
        return max(round(ratio * height), 1), max(round(ratio * width), 1)

    return (
        fitting(SHARP_PX),
        fitting(DETAIL_PX, DETAIL_BYTES / frames),
        fitting(SMALL_PX, SMALL_BYTES / (12 * frames)),
    )


def _resized(image: Array, shape: tuple[int, int]) -> Array:
    """(h, w, ...) area means of an image that is no smaller."""
    if image.shape[:2] == shape:
        return image
    size = shape[1], shape[0]
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def _shown(mask: Mask, shape: tuple[int, int]) -> Mask:
    """(h, w) the pixels of a smaller picture that a mask covers by half; of a thin one, by most."""
    share = _resized(mask.astype(np.float32), shape)
    return np.asarray(share > min(0.5, 0.5 * float(share.max())))

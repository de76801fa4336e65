"""Videos of a lamp that a hand moves round an object, in memory, with whatever goes wrong."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from rakelight.capture.recording import Recording, Stream
from rakelight.geometry.camera import back_project
from rakelight.photometry.cast_shadows import in_sight
from rakelight.prepare.linear import srgb
from rakelight.synthetic import make_albedo, make_shape, random_capture
from rakelight.synthetic.noise import DepthNoise
from rakelight.synthetic.scene import SceneOptions, render_scene

FPS = 30.0
SKIN = np.array([0.45, 0.28, 0.2])
PLAIN = {
    "wall": False, "depth_factor": 2, "near_radii": 0.0, "bits": 16, "photographs": 4,
    "depth_maps": 1, "mask_px": 0, "corner": 1.0, "lighting": "moving-lamp", "depth_bend_mm": 0.0,
    "cast_shadows": False, "bounce": False, "shift_x": 0.0, "shift_y": 0.0, "depth_scale": 1.0,
}  # fmt: skip
WALL_M = 0.15
"""How far behind the object a wall stands."""


@dataclass
class Video:
    """A recording, its frames (N, H, W, 3) uint8 sRGB, what is wrong with which, and the truth.

    wrong : name of the fault -> numbers of the frames
    lamp : (N, 3) direction times brightness
    """

    recording: Recording
    frames: np.ndarray
    lamp: np.ndarray
    truth: object
    clean: np.ndarray
    """(N, H, W, 3) float32 linear light before noise, clipping and the file."""
    wrong: dict[str, list[int]] = field(default_factory=dict)

    @property
    def bad(self):
        return sorted({i for faults in self.wrong.values() for i in faults})


def hand_path(count, rng, *, still=False):
    """(N, 3) lamp vectors of a hand that goes round, dwells, and comes back."""
    speed = np.clip(smooth(count, rng, 12) + 0.6, 0, None)  # 0: it dwells
    turns = rng.uniform(1.5, 2.5) * np.cumsum(speed) / max(speed.sum(), 1e-9)
    azimuth = 2 * np.pi * (turns + rng.random()) * rng.choice([-1, 1])
    moving = (speed > 0) + 0.02
    tilt = np.radians(np.clip(42 + 14 * smooth(count, rng, 18), 12, 68))
    hold = np.maximum.accumulate(np.where(speed > 0, np.arange(count), 0))
    tilt = tilt[hold]
    gain = np.exp(0.15 * smooth(count, rng, 20))[hold] * np.exp(0.002 * rng.standard_normal(count))
    if still:
        azimuth, tilt, gain = azimuth[:1] + 0 * moving, tilt[:1] + 0 * moving, 1 + 0 * gain
    way = [np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), -np.cos(tilt)]
    return gain[:, None] * np.stack(way, axis=-1)


def single_shots(count, rng):
    """(N, 3) lamp vectors, each put where it is: up a spiral, or anywhere between two tilts."""
    lowest, highest = np.radians(rng.uniform(15, 35)), np.radians(rng.uniform(45, 65))
    if rng.random() < 0.5:
        tilt = np.linspace(lowest, highest, count)
        azimuth = 2 * np.pi * (rng.uniform(1, 3) * np.arange(count) / count + rng.random())
    else:
        tilt = np.arccos(rng.uniform(np.cos(highest), np.cos(lowest), count))
        azimuth = rng.uniform(0, 2 * np.pi, count)
    gain = np.exp(0.1 * rng.standard_normal(count))
    way = [np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), -np.cos(tilt)]
    return gain[:, None] * np.stack(way, axis=-1)


def smooth(count, rng, width):
    """(N,) noise of variance 1, smooth over `width` frames."""
    white = rng.standard_normal(count + 8 * width)
    kernel = np.exp(-0.5 * (np.arange(-4 * width, 4 * width + 1) / width) ** 2)
    return np.convolve(white, kernel / np.linalg.norm(kernel), "valid")[:count]


def rendered(capture, truth, lamp, rng, *, shadows=True, ambient=0.08, gloss=0.05):
    """(N, H, W, 3) float32 linear light of the object before a textured wall."""
    mask, camera = truth.mask, capture.camera
    depth = np.where(mask, truth.depth, np.nanmax(truth.depth) + WALL_M)
    normals = np.where(mask[..., None], truth.normals, [0, 0, -1.0])
    texture = cv2.GaussianBlur(rng.standard_normal((*mask.shape, 1)), (0, 0), 1.5)[..., None]
    wall = np.clip(0.35 + 0.12 * texture / texture.std() * np.array([1, 0.9, 0.8]), 0.05, 1)
    paint = np.where(mask[..., None], truth.albedo, wall)
    points = back_project(depth, camera)
    view = -points / np.linalg.norm(points, axis=-1, keepdims=True)
    images = np.empty((len(lamp), *mask.shape, 3), np.float32)
    for image, s in zip(images, lamp, strict=True):
        shading = np.maximum(normals @ s, 0)
        strength = np.linalg.norm(s)
        if shadows:
            way = np.broadcast_to(100 * s / strength, (mask.sum(), 3))
            shading[mask] *= in_sight(truth.depth, camera, points[mask], way)
        half = view + s / strength
        half /= np.linalg.norm(half, axis=-1, keepdims=True)
        shine = gloss * strength * np.maximum((half * normals).sum(-1), 0) ** 30 * (shading > 0)
        image[:] = paint * (shading + ambient)[..., None] + shine[..., None] * mask[..., None]
    return images


def with_arm(image, rng, lamp, at):
    """A band as an arm looks before the picture, from a side to where `at` (0..1) says."""
    height, width = image.shape[:2]
    angle = rng.uniform(0, 2 * np.pi)
    y, x = np.mgrid[:height, :width]
    middle = np.array([width / 2, height / 2])
    tip = middle + (0.5 - at) * min(height, width) * 0.6 * np.array([np.cos(angle), np.sin(angle)])
    along = (x - tip[0]) * np.cos(angle) + (y - tip[1]) * np.sin(angle)
    across = -(x - tip[0]) * np.sin(angle) + (y - tip[1]) * np.cos(angle)
    half = min(height, width) * rng.uniform(0.07, 0.16)
    band = (along > 0) & (np.abs(across) < half)
    round_ = np.sqrt(np.clip(1 - (across / half) ** 2, 0, 1))
    paint = SKIN * rng.uniform(0.4, 1.2) * (1 + 0.15 * rng.standard_normal())
    lit = (np.linalg.norm(lamp) * round_ * rng.uniform(0.3, 1.2) + 0.05)[..., None] * paint
    soft = cv2.GaussianBlur(band.astype(np.float32), (0, 0), 1.0)[..., None]
    return (1 - soft) * image + soft * lit


def stored(light, rng, *, noise=0.006, quality=0):
    """Linear light to uint8 sRGB: photon-like noise, clipping, and JPEG of a quality."""
    seen = light + noise * np.sqrt(0.2 + np.clip(light, 0, 1)) * rng.standard_normal(light.shape)
    code = np.rint(255 * srgb(np.clip(seen, 0, 1))).astype(np.uint8)
    if not quality:
        return code
    coded = cv2.imencode(".jpg", code[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return cv2.imdecode(coded, cv2.IMREAD_COLOR)[..., ::-1].copy()


def some_spans(count, rng, share, length, taken):
    """Frames in spans of about `length` that cover a share, none of them in `taken`."""
    chosen = set()
    for _ in range(200):
        if len(chosen) >= share * count:
            break
        start = int(rng.integers(0, count))
        span = range(start, min(start + int(rng.integers(1, 2 * length)), count))
        if not taken & set(span):
            chosen |= set(span)
    taken |= chosen
    return sorted(chosen)


def make_video(
    seed, count=120, *, size=1.0, arm=0.0, blurred=0.0, over=0.0, bump=None, bump_px=4.0,
    flicker=0.0, quality=0, still=False, shadows=True, shape=None, lamp=None, shake=0, noise=0.006,
):  # fmt: skip
    """A video; shares of frames with a fault, and the frame from which the picture is shifted."""
    rng = np.random.default_rng([seed, 77])
    drawn = dict(PLAIN, **({"shape": shape} if shape else {}))
    capture, truth = random_capture(seed, size=size, **drawn)
    lamp = hand_path(count, rng, still=still) if lamp is None else lamp
    light = rendered(capture, truth, lamp, rng, shadows=shadows)
    light *= 0.85 / np.quantile(light[:, truth.mask], 0.99)
    clean = light.copy()
    wrong, taken = {}, set()
    for name, share, length in (("arm", arm, 6), ("blurred", blurred, 3), ("over", over, 4)):
        wrong[name] = some_spans(count, rng, share, length, taken)
    for i in wrong["arm"]:
        light[i] = with_arm(light[i], rng, lamp[i], rng.uniform(0.15, 0.9))
    for i in wrong["blurred"]:
        length = int(rng.integers(5, 10))
        kernel = np.eye(length) if rng.random() < 0.5 else np.ones((1, length))
        light[i] = cv2.filter2D(light[i], -1, kernel / kernel.sum())
    for i in wrong["over"]:
        light[i] *= rng.uniform(3, 6)
    if flicker:
        light *= np.exp(flicker * smooth(count, rng, 4))[:, None, None, None].astype(np.float32)
    if bump is not None:
        angle = rng.uniform(0, 2 * np.pi)
        for i in range(bump, count):
            early = i - bump < shake
            x, y = bump_px * np.array([np.cos(angle), np.sin(angle)]) + early * rng.normal(0, 3, 2)
            move = np.float32([[1, 0, x], [0, 1, y]])
            light[i] = cv2.warpAffine(light[i], move, light[i].shape[1::-1], borderMode=1)
        moved = range(bump, count) if bump > count / 2 else range(bump)
        wrong["bump"] = sorted({*moved, *range(bump, min(bump + shake, count))})
    frames = np.stack([stored(image, rng, quality=quality, noise=noise) for image in light])
    behind_m = float(np.nanmax(truth.depth)) + WALL_M
    depth = np.where(np.isfinite(capture.depth_m[0]), capture.depth_m[0], behind_m)
    depth = depth.astype(np.float32)
    return Video(
        recording_of(frames, depth, capture.camera, rng), frames, lamp, truth, clean, wrong
    )


def recording_of(frames, depth, camera, rng):
    """A recording of frames (N, H, W, 3) and as many maps of `depth` with half a mm of noise."""
    times = np.arange(len(frames)) / FPS

    def colour(wanted):
        yield from ((i, frames[i]) for i in wanted)

    def metres(wanted):
        for i in wanted:
            noise = np.random.default_rng(i).standard_normal(depth.shape)
            yield i, (depth + 0.0005 * noise).astype(np.float32)

    return Recording(
        "video", camera, Stream(times, frames.shape[1:3], colour),
        Stream(times, depth.shape, metres),
    )  # fmt: skip


def head_seen_by_two_cameras(scale, depth_factor, depth_to_color):
    """A capture of 16 photographs of 8 bit, with depth of a camera beside; and its truth."""
    shape = make_shape("head")
    options = SceneOptions(
        camera=shape.camera.scaled(scale),
        photographs=16,
        bits=8,
        encoding="srgb",
        image_noise=0.005,
        depth_factor=depth_factor,
        depth_to_color=depth_to_color,
        depth_frames=16,
        depth_noise=DepthNoise(rms_mm=2.0, correlation_length_px=1.0),
    )
    return render_scene(shape, make_albedo("white"), options)

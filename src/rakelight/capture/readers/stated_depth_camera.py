"""The depth camera that a file beside photographs or frames states: its intrinsics and its pose."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from rakelight.capture import validate
from rakelight.capture.extrinsics import depth_to_color, is_identity
from rakelight.capture.intrinsics import (
    alike,
    parse_depth_intrinsics,
    parse_intrinsics,
    small_texts,
)
from rakelight.capture.intrinsics.names import named_intrinsics, names_depth
from rakelight.capture.readers.stated_camera import camera_or_lens, with_lenses
from rakelight.capture.text_tables import text_of
from rakelight.errors import InputError, listed, printable
from rakelight.model import Camera, Distortion, Finding, Mask, RigidTransform

# Pixels of depth by which focal lengths and centres of one view may differ: rounding.
_SAME_VIEW_PX = 0.5
_SAME_POSE = 1e-4  # radians and metres by which one pose differs in two files: rounding
# Files that hold a pose, by their names; those of a camera that moves are other ones.
_POSES = re.compile(r"extrinsic|stereo|calib\w*pose")
_IN_TOML = "write [depth_intrinsics] and [depth_to_color] into a capture.toml"
_AS_JSON = (
    'write {"rotation": [three rows], "translation": [metres]} into depth_to_color.json: '
    "X_color = rotation X_depth + translation"
)


@dataclass(frozen=True)
class StatedDepthCamera:
    """camera, to_color : None where no file states one that fits; findings : what was not used."""

    camera: Camera | None = None
    to_color: RigidTransform | None = None
    findings: tuple[Finding, ...] = ()


def stated_depth_camera(
    folder: Path,
    texts: Sequence[Path],
    color: Camera,
    shape: tuple[int, int],
    measured: Mask | None = None,
    *,
    raw: bool = False,
) -> StatedDepthCamera:
    """The depth camera of maps of this shape, (h, w), beside photographs by `color`.

    texts : files in the folder that may state it; raw : whether depth is known not to be registered
    measured : (h, w) where the maps measure something, and a lens may not fold; None where that is
        not known yet, and checked later

    Depth of the photographs' size is taken to be registered to them: programs that register it
    write the sensor's own intrinsics beside it all the same.  The RealSense Viewer's never is.
    """
    data = _of_depth(folder, texts)
    cameras, unused = _cameras(folder, data, shape, measured)
    poses, unclear = _poses(folder, data)
    if cameras and not alike(cameras.values()):
        unused |= dict.fromkeys(cameras, "several depth cameras")
        cameras = {}
    if not cameras:
        unused = dict.fromkeys((*poses, *unclear), "no depth intrinsics beside it") | unused
        silent = (name for name in data if name not in unused and _meant(name))
        unused |= dict.fromkeys(silent, "no intrinsics found in it")
        unused = _unnamed(folder, texts, color, shape) | unused
        return StatedDepthCamera(findings=_not_used(unused))
    camera = next(iter(cameras.values()))
    if not poses and _same_view(camera, color):
        return StatedDepthCamera(findings=_not_used(unused))
    if shape == color.shape and not raw:
        registered = "depth of the photographs' size is taken to be registered to them"
        unused |= dict.fromkeys([*cameras, *poses], registered)
        return StatedDepthCamera(findings=_not_used(unused))
    beside = [path for path in texts if _POSES.search(path.stem.lower())]
    still = [is_identity(text) for text in small_texts(beside).values()]
    if not poses and beside and len(still) == len(beside) and all(still):
        poses = {path.name: RigidTransform(np.eye(3), np.zeros(3)) for path in beside}
    if not poses:
        unclear += [path.name for path in beside]
        pose = RigidTransform(np.eye(3), np.zeros(3))
        findings = (_pose_assumed(list(cameras), unclear), *_not_used(unused))
        return StatedDepthCamera(camera, pose, findings)
    pose = next(iter(poses.values()))
    names = listed(list(dict.fromkeys([*cameras, *poses])))
    baseline_mm = 1000 * float(np.linalg.norm(pose.translation_m))
    message = f"depth by a camera of its own, as {names} has it: {baseline_mm:.3g} mm away"
    used = Finding("note", "depth-camera", message)
    return StatedDepthCamera(camera, pose, (used, *_not_used(unused)))


def _of_depth(folder: Path, texts: Sequence[Path]) -> dict[str, bytes]:
    """The texts that speak of depth, in their names or their words, by their names."""
    found = {}
    for path, data in small_texts(texts).items():
        words = f"{path.stem} {text_of(data) or ''}".lower()
        if names_depth(path.stem) or "depth" in words or "infra" in words:
            found[path.relative_to(folder).as_posix()] = data
    return found


def _cameras(
    folder: Path, data: dict[str, bytes], shape: tuple[int, int], measured: Mask | None
) -> tuple[dict[str, Camera], dict[str, str]]:
    """Depth cameras by the names of the files that state them, and why others are not used."""
    (h, w), found, unused = shape, dict[str, Camera](), dict[str, str]()
    lenses = dict[str, Distortion]()
    for name, text in data.items():
        source, stem = f"{folder}/{name}", Path(name).stem
        whole = names_depth(stem)
        parse = partial(parse_depth_intrinsics, text, source, whole, size=(w, h))
        try:
            read = camera_or_lens(stem, text, source, parse) if whole else parse(False)
            if isinstance(read, Distortion):
                lenses[name] = read
            elif read is not None and read.width and read.shape != (h, w):
                unused[name] = f"for {read.width}x{read.height}, the depth is {w}x{h}"
            elif read is not None:
                found[name] = replace(read, width=w, height=h)
        except InputError as error:
            unused[name] = error.what
    try:
        found = with_lenses(found, lenses, str(folder))
    except InputError as error:
        return {}, unused | dict.fromkeys((*found, *lenses), error.what)
    for name, camera in list(found.items()):
        try:
            source = f"{folder}/{name}"
            validate.check_camera(camera, camera.shape, source, "intrinsics", of_depth=True)
            if measured is not None:
                validate.check_distortion(camera, source, "lens distortion", measured)
        except InputError as error:
            unused[name] = error.what
            del found[name]
    if not found:
        unused = dict.fromkeys(lenses, "no depth intrinsics beside it") | unused
    return found, unused


def _unnamed(
    folder: Path, texts: Sequence[Path], color: Camera, shape: tuple[int, int]
) -> dict[str, str]:
    """Files that state a camera of the depth's size, which no name says to be the depth's."""
    (h, w), found = shape, dict[str, str]()
    if shape == color.shape:  # it is the photographs'
        return found
    for path, text in small_texts(texts).items():
        with suppress(InputError):  # the reader of the photographs' camera says what is wrong
            camera = parse_intrinsics(text, size=(w, h))
            if camera and camera.shape == shape and not _same_view(camera, color):
                name = path.relative_to(folder).as_posix()
                found[name] = f"a camera for {w}x{h}, as the depth is, that is not named depth"
    return found


def _poses(folder: Path, data: dict[str, bytes]) -> tuple[dict[str, RigidTransform], list[str]]:
    """Poses by the names of the files that state them, and the files whose pose is not clear."""
    found, unclear = dict[str, RigidTransform](), list[str]()
    for name, text in data.items():
        stated: list[RigidTransform | None] = []
        with suppress(InputError):  # damaged, of which its intrinsics tell
            stated = depth_to_color(text, f"{folder}/{name}", Path(name).stem)
        clear = [pose for pose in stated if pose is not None]
        if clear:
            found[name] = clear[0]
        elif stated:
            unclear.append(name)
    numbers = [[*pose.rotation.ravel(), *pose.translation_m] for pose in found.values()]
    if numbers and np.ptp(np.array(numbers), axis=0).max() > _SAME_POSE:
        return {}, [*unclear, *found]
    return found, unclear


def _meant(name: str) -> bool:
    """Whether a file's name says that it holds intrinsics of the depth."""
    stem = Path(name).stem
    return names_depth(stem) and named_intrinsics(stem) and "scale" not in stem.lower()


def _same_view(camera: Camera, color: Camera) -> bool:
    """Whether a depth camera shows the photographs' field of view from their place."""
    view = color.resized(camera.width, camera.height)
    off = (abs(getattr(camera, key) - getattr(view, key)) for key in ("fx", "fy", "cx", "cy"))
    return max(off) <= _SAME_VIEW_PX and camera.distortion == color.distortion


def _not_used(why: dict[str, str]) -> tuple[Finding, ...]:
    """A warning of the files that say something of the depth camera in vain."""
    if not why:
        return ()
    message = "; ".join(f"{printable(name)}: {reason}" for name, reason in list(why.items())[:4])
    more = f"; and {len(why) - 4} more" if len(why) > 4 else ""
    message = f"depth camera not used, by {message}{more}"
    return (Finding("warning", "ignored-files", message, f"if it is another camera: {_IN_TOML}"),)


def _pose_assumed(cameras: list[str], unclear: list[str]) -> Finding:
    message = (
        f"depth by a camera of its own, as {listed(cameras)} has it, taken to be at the place of "
        "the photographs' camera: no file says its pose as depth_to_color"
    )
    if unclear:
        message += f"; not clear is {listed(list(dict.fromkeys(unclear)))}"
    return Finding("warning", "depth-pose-assumed", message, _AS_JSON)

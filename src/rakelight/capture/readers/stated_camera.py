"""The one camera that files beside photographs or frames state."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from rakelight.capture.intrinsics import (
    Size,
    alike,
    lens_named,
    parse_intrinsics,
    parse_lens,
)
from rakelight.capture.intrinsics.names import (
    named_intrinsics,
    names_depth,
    names_lens,
    surely_lens,
)
from rakelight.errors import CaptureError, listed, printable
from rakelight.model import Camera, Distortion, Finding

# Names, without ending, of files that hold intrinsics or are a mistake.
_SURELY_INTRINSICS = ("intrinsics", "intrinsic", "calibration", "calib", "camera", "cameras", "k")

FORMATS = "OpenCV, ROS or Kalibr YAML, Open3D JSON, COLMAP cameras.txt, or a 3 x 3 matrix"
"""What files with intrinsics may be, for messages."""

MATRIX = "fx 0 cx / 0 fy cy / 0 0 1 (pixels, three lines)"
"""What is to be written where none is read, for messages."""


@dataclass(frozen=True, slots=True)
class StatedCamera:
    """name : of the file, or files, that state it; findings : of its lens."""

    name: str
    camera: Camera
    findings: tuple[Finding, ...] = ()


def stated_camera(folder: Path, texts: Mapping[Path, bytes], size: Size) -> StatedCamera | None:
    """The camera in the texts; None where none of them states any.

    texts : content of each file in `folder`; size : (width, height) of the photographs
    The lens may be stated in a file of its own.  Raises CaptureError where a name promises some
    that are not there, and for two that differ.
    """
    found: dict[str, Camera] = {}
    lenses: dict[str, Distortion] = {}
    models: dict[str, str | None] = {}
    without: list[str] = []
    for path, data in texts.items():
        name = path.relative_to(folder).as_posix()
        source = f"{folder}/{name}"
        read = camera_or_lens(
            path.stem, data, source, partial(parse_intrinsics, data, source, size=size)
        )
        if isinstance(read, Camera):
            found[name] = read
            models[name] = "" if read.distortion else lens_named(data, source)
        elif read is not None:
            lenses[name] = read
        elif path.stem.lower() in _SURELY_INTRINSICS:  # no other source is what is meant
            raise CaptureError(
                "no intrinsics in it",
                source=source,
                seen=" ".join(data.decode("latin-1").split())[:60] or "nothing",
                needed=FORMATS,
                remedy=f"write {MATRIX}",
            )
        elif surely_lens(path.stem):
            without.append(name)
    found, lenses = _lens_alone(found, lenses)
    found = _as_said(found, models)
    missing = () if lenses else _lens_missing(models)
    alone, found = found, with_lenses(found, lenses, str(folder))
    sized = {name: camera for name, camera in found.items() if camera.width}
    sizes = {camera.shape for camera in sized.values()}
    if len(sizes) > 1 or (found and not alike(found.values())):
        raise CaptureError(
            "several files with intrinsics",
            source=str(folder),
            seen=", ".join(found),
            needed="those of the camera that took the photographs",
            remedy="keep one of them",
        )
    name, camera = next(iter((sized or found).items()), ("", None))
    taken = () if name in alone else _lens_taken(list(lenses))
    findings = (*missing, *taken, *_no_lens_in(without))
    return None if camera is None else StatedCamera(name, camera, findings)


def _lens_alone(
    cameras: dict[str, Camera], lenses: dict[str, Distortion]
) -> tuple[dict[str, Camera], dict[str, Distortion]]:
    """Both; of numbers of both in a file called after the lens, that alone where others state K."""
    numbers = {
        name: camera.distortion
        for name, camera in cameras.items()
        if camera.distortion and not camera.width and names_lens(Path(name).stem)
    }
    others = {name: camera for name, camera in cameras.items() if name not in numbers}
    if others and alike([replace(camera, distortion=None) for camera in cameras.values()]):
        return others, lenses | numbers
    return cameras, lenses


def _as_said(cameras: Mapping[str, Camera], models: Mapping[str, str | None]) -> dict[str, Camera]:
    """The cameras, with the lens of the files that say it where others name its model alone."""
    said = [camera.distortion for name, camera in cameras.items() if models[name] == ""]
    return {
        name: replace(camera, distortion=said[0]) if said and models[name] else camera
        for name, camera in cameras.items()
    }


def _lens_missing(models: Mapping[str, str | None]) -> tuple[Finding, ...]:
    """A warning where files name the model of distortion, and none says its coefficients.

    models : what `lens_named` says of each file
    """
    names = {name: model for name, model in models.items() if model}
    if not names or "" in models.values():
        return ()
    model = printable(next(iter(names.values()))[:60])
    message = (
        f"the model of the lens's distortion is named ({model}), its coefficients are not in "
        f"{listed(list(names))}: distortion is not taken out"
    )
    remedy = (
        "write the coefficients there (coeffs: [...]); of a RealSense put what "
        "rs-enumerate-devices -c prints beside the photographs"
    )
    return (Finding("warning", "lens-missing", message, remedy),)


def _lens_taken(names: list[str]) -> tuple[Finding, ...]:
    """A note of the files of its own that the lens is taken from."""
    message = f"the lens's distortion is taken from {listed(names)}"
    return (Finding("note", "lens-from-file", message, "move what is no lens elsewhere"),)


def _no_lens_in(names: list[str]) -> tuple[Finding, ...]:
    """A note of the files that are called after a lens, and of which nothing is read."""
    if not names:
        return ()
    message = f"no distortion of a lens is found in {listed(names)}"
    remedy = "if the lens distorts, write its k1 k2 p1 p2 k3 there (OpenCV's coefficients)"
    return (Finding("note", "ignored-files", message, remedy),)


def camera_or_lens(
    stem: str, data: bytes, source: str, parse: Callable[[bool], Camera | None]
) -> Camera | Distortion | None:
    """What a file holds: a camera, or a lens alone where its name says so; None for neither.

    stem : its name, without ending
    parse : reads the camera; given whether the name says that intrinsics are in it
    """
    named = named_intrinsics(stem)
    if not names_lens(stem):
        return parse(named)
    read = parse(False) or parse_lens(data, source, surely_lens(stem), names_depth(stem))
    return read or (parse(True) if named else None)


def with_lenses(
    cameras: Mapping[str, Camera], lenses: Mapping[str, Distortion], source: str
) -> dict[str, Camera]:
    """The cameras by their files' names, with the lens that files of its own state.

    Raises CaptureError where these differ by more than rounding, or a camera has another one.
    """
    if not cameras or not lenses:
        return dict(cameras)
    own = {name: camera for name, camera in cameras.items() if camera.distortion}
    stated = [*(camera.distortion for camera in own.values()), *lenses.values()]
    camera = next(iter(cameras.values()))
    if not alike([replace(camera, distortion=lens) for lens in stated]):
        raise CaptureError(
            "several files with the distortion of a lens",
            source=source,
            seen=", ".join([*own, *lenses]),
            needed="that of the camera's lens",
            remedy="keep one of them",
        )
    name, lens = next(iter(lenses.items()))
    if lens.is_none:
        return dict(cameras)
    without = {of: camera for of, camera in cameras.items() if of not in own}
    return own | {f"{of} and {name}": replace(c, distortion=lens) for of, c in without.items()}

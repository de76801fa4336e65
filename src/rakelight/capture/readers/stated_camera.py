"""The one camera that files beside photographs or frames state."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rakelight.capture.intrinsics import Size, alike, named_intrinsics, parse_intrinsics
from rakelight.errors import CaptureError
from rakelight.model import Camera

# Names, without ending, of files that hold intrinsics or are a mistake.
_SURELY_INTRINSICS = ("intrinsics", "intrinsic", "calibration", "calib", "camera", "cameras", "k")

FORMATS = "OpenCV, ROS or Kalibr YAML, Open3D JSON, COLMAP cameras.txt, or a 3 x 3 matrix"
"""What files with intrinsics may be, for messages."""

MATRIX = "fx 0 cx / 0 fy cy / 0 0 1 (pixels, three lines)"
"""What is to be written where none is read, for messages."""


def stated_camera(
    folder: Path, texts: Mapping[Path, bytes], size: Size
) -> tuple[str, Camera] | None:
    """The name of a file and the intrinsics in it; None where none of the texts states any.

    texts : content of each file in `folder`; size : (width, height) of the photographs
    Raises CaptureError where a name promises some that are not there, and for two that differ.
    """
    found: dict[str, Camera] = {}
    for path, data in texts.items():
        name = path.relative_to(folder).as_posix()
        source = f"{folder}/{name}"
        camera = parse_intrinsics(data, source, named_intrinsics(path.stem), size)
        if camera is not None:
            found[name] = camera
        elif path.stem.lower() in _SURELY_INTRINSICS:  # no other source is what is meant
            raise CaptureError(
                "no intrinsics in it",
                source=source,
                seen=" ".join(data.decode("latin-1").split())[:60] or "nothing",
                needed=FORMATS,
                remedy=f"write {MATRIX}",
            )
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
    return next(iter((sized or found).items()), None)

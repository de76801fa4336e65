"""rakelight: depth maps of RGB-D cameras refined by photographs under moving light.

>>> import rakelight
>>> capture = rakelight.load_capture("captures/mitten")     # doctest: +SKIP
>>> result = rakelight.refine(capture)                      # doctest: +SKIP
>>> result.save("out/mitten")                               # doctest: +SKIP
"""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # as `typing` has it, which takes a while to import
if TYPE_CHECKING:
    from rakelight.capture import load_capture, load_truth, write_capture
    from rakelight.errors import (
        CaptureError,
        InputError,
        MachineError,
        MethodError,
        OutputExistsError,
        RakelightError,
    )
    from rakelight.methods import refine
    from rakelight.model import Camera, Capture, Finding, Lights, Progress, Result, Truth

__version__: str

_HOMES = {
    "rakelight.capture": ("load_capture", "load_truth", "write_capture"),
    "rakelight.errors": (
        "CaptureError",
        "InputError",
        "MachineError",
        "MethodError",
        "OutputExistsError",
        "RakelightError",
    ),
    "rakelight.methods": ("refine",),
    "rakelight.model": ("Camera", "Capture", "Finding", "Lights", "Progress", "Result", "Truth"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> object:
    # Names load on first use, so that `import rakelight` stays light.
    if name == "__version__":
        return _version()
    if name not in _HOME_OF:
        raise AttributeError(f"module 'rakelight' has no attribute {name!r}")
    return getattr(import_module(_HOME_OF[name]), name)


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("rakelight")
    except PackageNotFoundError:  # run from a source tree that was not installed
        return "0+source"


def __dir__() -> list[str]:
    return sorted(__all__)


__all__ = [
    "Camera",
    "Capture",
    "CaptureError",
    "Finding",
    "InputError",
    "Lights",
    "MachineError",
    "MethodError",
    "OutputExistsError",
    "Progress",
    "RakelightError",
    "Result",
    "Truth",
    "__version__",
    "load_capture",
    "load_truth",
    "refine",
    "write_capture",
]

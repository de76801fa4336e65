"""rakelight: depth maps of RGB-D cameras refined by photographs under moving light.

>>> import rakelight
>>> capture = rakelight.load_capture("captures/mitten")     # doctest: +SKIP
>>> result = rakelight.refine(capture)                      # doctest: +SKIP
>>> rakelight.save_result(result, "out/mitten")             # doctest: +SKIP
"""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # as `typing` has it, which takes a while to import
if TYPE_CHECKING:
    from rakelight.capture import load_capture, load_truth, write_capture
    from rakelight.checkup import CheckReport, check_capture
    from rakelight.errors import (
        CaptureError,
        InputError,
        MachineError,
        MethodError,
        OutputExistsError,
        RakelightError,
    )
    from rakelight.export import load_result
    from rakelight.methods.ldr_ps import LdrPs
    from rakelight.methods.multi_light import MultiLight
    from rakelight.methods.multi_light_alternating import MultiLightAlternating
    from rakelight.methods.rgb_ratio import RgbRatio
    from rakelight.methods.single_image.fusion_like import FusionLike
    from rakelight.methods.single_image.rgbd_fusion import RgbdFusion
    from rakelight.metrics import Evaluation, evaluate
    from rakelight.model import (
        Camera,
        Capture,
        Distortion,
        Finding,
        GivenLights,
        Lights,
        Mesh,
        PointCloud,
        Progress,
        Result,
        RigidTransform,
        SensorNoise,
        Truth,
    )
    from rakelight.pipeline import refine
    from rakelight.report import save_result

__version__: str

# Public name -> the module it comes from.
_HOMES = {
    "Camera": "rakelight.model",
    "Capture": "rakelight.model",
    "CaptureError": "rakelight.errors",
    "Distortion": "rakelight.model",
    "CheckReport": "rakelight.checkup",
    "Evaluation": "rakelight.metrics",
    "Finding": "rakelight.model",
    "FusionLike": "rakelight.methods.single_image.fusion_like",
    "GivenLights": "rakelight.model",
    "InputError": "rakelight.errors",
    "LdrPs": "rakelight.methods.ldr_ps",
    "Lights": "rakelight.model",
    "MachineError": "rakelight.errors",
    "Mesh": "rakelight.model",
    "MethodError": "rakelight.errors",
    "MultiLight": "rakelight.methods.multi_light",
    "MultiLightAlternating": "rakelight.methods.multi_light_alternating",
    "OutputExistsError": "rakelight.errors",
    "PointCloud": "rakelight.model",
    "Progress": "rakelight.model",
    "RakelightError": "rakelight.errors",
    "Result": "rakelight.model",
    "RgbRatio": "rakelight.methods.rgb_ratio",
    "RgbdFusion": "rakelight.methods.single_image.rgbd_fusion",
    "RigidTransform": "rakelight.model",
    "SensorNoise": "rakelight.model",
    "Truth": "rakelight.model",
    "check_capture": "rakelight.checkup",
    "evaluate": "rakelight.metrics",
    "load_capture": "rakelight.capture",
    "load_result": "rakelight.export",
    "load_truth": "rakelight.capture",
    "refine": "rakelight.pipeline",
    "save_result": "rakelight.report",
    "write_capture": "rakelight.capture",
}


def __getattr__(name: str) -> object:
    # Names load on first use, so that `import rakelight` stays light.
    if name == "__version__":
        return _version()
    if name not in _HOMES:
        raise AttributeError(f"module 'rakelight' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


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
    "CheckReport",
    "Distortion",
    "Evaluation",
    "Finding",
    "FusionLike",
    "GivenLights",
    "InputError",
    "LdrPs",
    "Lights",
    "MachineError",
    "Mesh",
    "MethodError",
    "MultiLight",
    "MultiLightAlternating",
    "OutputExistsError",
    "PointCloud",
    "Progress",
    "RakelightError",
    "Result",
    "RgbRatio",
    "RgbdFusion",
    "RigidTransform",
    "SensorNoise",
    "Truth",
    "__version__",
    "check_capture",
    "evaluate",
    "load_capture",
    "load_result",
    "load_truth",
    "refine",
    "save_result",
    "write_capture",
]

"""The methods by name.

A method is a function (Prepared, options, progress) -> Estimate, a frozen class of options beside
it, and a value METHOD of the class `Method` that says both.  To add one, write its file or folder
and its line in `METHODS`.
"""

from __future__ import annotations

import sys
from importlib import import_module

from rakelight.errors import MethodError
from rakelight.methods.base import Method
from rakelight.model import Capture

# Method name -> its module in this folder, which is loaded when the method is asked for.
METHODS = {
    "multi-light": "multi_light",
    "multi-light-alternating": "multi_light_alternating",
    "rgb-ratio": "rgb_ratio",
    "fusion-like": "single_image.fusion_like",
    "rgbd-fusion": "single_image.rgbd_fusion",
    "ldr-ps": "ldr_ps",
}


def load_method(name: str) -> Method:
    """The method of that name; MethodError names the ones there are.

    >>> load_method("multi-light-alternating").name
    'multi-light-alternating'
    """
    if not isinstance(name, str) or name not in METHODS:
        raise MethodError(
            f"the class {name.__qualname__} is no method"
            if isinstance(name, type)
            else f"method {name!r} is unknown",
            needed="one of " + ", ".join(("auto", *METHODS)),
            remedy="choose one of these"
            if isinstance(name, str)
            else "give a name, or options such as rakelight.MultiLight(depth_weight=3.0)",
        )
    found: Method = import_module(f"rakelight.methods.{METHODS[name]}").METHOD
    return found


def method_of(options: object) -> str | None:
    """The name of the method that these options are for; None for anything else.

    >>> from rakelight.methods.single_image.rgbd_fusion import RgbdFusion
    >>> method_of(RgbdFusion()), method_of(3)
    ('rgbd-fusion', None)
    """
    # A method whose module is not loaded yet, or by another thread half way, cannot be meant.
    modules = {name: sys.modules.get(f"rakelight.methods.{file}") for name, file in METHODS.items()}
    loaded = {name: getattr(module, "METHOD", None) for name, module in modules.items()}
    for kind in type(options).__mro__:
        for name, method in loaded.items():
            if method is not None and kind is method.options:
                return name
    return None


def public_options(method: str) -> str:
    """What the options of a method are called in public.

    >>> public_options("multi-light")
    'rakelight.MultiLight'
    """
    return f"rakelight.{load_method(method).options.__name__}"


AUTOMATIC = ("multi-light", "rgb-ratio", "fusion-like")
"""The methods that `auto` may stand for."""


def choose_method(capture: Capture) -> str:
    """The method that `auto` stands for: by the number of photographs and the kind of lights."""
    if len(capture.photographs) > 1:
        return "multi-light"
    return "rgb-ratio" if capture.lighting == "rgb-leds" else "fusion-like"


__all__ = [
    "AUTOMATIC",
    "METHODS",
    "Method",
    "choose_method",
    "load_method",
    "method_of",
    "public_options",
]

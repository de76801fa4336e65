"""What a method is, what it gives back, and the checks and measures that methods share."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from math import ceil
from numbers import Integral, Real
from operator import attrgetter
from types import NoneType
from typing import Any, Literal, get_args, get_type_hints

import numpy as np

from rakelight.errors import InputError, MethodError, listed, printable
from rakelight.geometry.normals import squared_normal_derivative
from rakelight.model import (
    Camera,
    Finding,
    Floats,
    Lighting,
    Lights,
    Mask,
    ProgressCallback,
    photograph_names,
)
from rakelight.prepare import Prepared

# Standard deviation of a normal, degrees, at which the confidence is one half.
HALF_CONFIDENCE_DEG = 3.0
# Standard deviation of a normal, radians, without any information.
UNDETERMINED_RAD = 0.5
# Standard deviation, pixels, of the window in which variances are averaged.
SMOOTHED_PX = 1.5
# Intensity of a light over that of the others, below which it does not reach the object.
DARK = 0.02
# Largest angle between a light and their mean, degrees, below which they are in one place, and the
# pipeline keeps the depth.  Only this value was tried: 400 random draws, 13 below it
# (docs/results/random-captures.md).
LEAST_ANGLE_DEG = 6.0
# Code of the finding about lights that are within it.
ONE_LAMP_POSITION = "one-lamp-position"
# Root mean square angle of the lights off one plane, degrees.  At 2.5 normals are 1.5 to 2 times as
# far off as at 10, at 0.7 three times (vase and cat under 12 lights on an arc).
LEAST_THICKNESS_DEG = 4.0
# Largest value of an option that is a weight: products with those of 1e30 overflow.
LARGEST_WEIGHT = 1e12
# What methods for one photograph say of their result.
AMBIGUOUS = Finding(
    "warning",
    "single-photograph",
    "one photograph does not tell paint from relief: fine detail may be painted, not real",
    "take at least 3 photographs under a moving lamp and use the method multi-light",
)


@dataclass(frozen=True)
class Estimate:
    """A method's answer on the prepared window.

    log_depth : (h, w) log metres; albedo : (h, w, 3) linear; confidence : (h, w) 0..1
    lights : of all photographs, or of the only one that was used
    energy : one value per iterate, the start's first; comparable, so under one loss
    steps : how many times the depth was moved, when more often than `energy` says
    normals : (h, w, 3) where there are finer ones than the depth map's, NaN elsewhere
    timings_s : seconds of parts of the work, such as "solve"
    depth_sigma, normal_sigma : (h, w) expected errors, metres and degrees; None without
    """

    log_depth: Floats
    albedo: Floats
    confidence: Floats
    lights: Lights
    energy: tuple[float, ...] = ()
    steps: int = 0
    converged: bool = False
    findings: tuple[Finding, ...] = ()
    normals: Floats | None = None
    timings_s: Mapping[str, float] = field(default_factory=dict)
    depth_sigma: Floats | None = None
    normal_sigma: Floats | None = None

    @property
    def iterations(self) -> int:
        """How many times the depth was moved."""
        return max(self.steps, len(self.energy) - 1, 0)


@dataclass(frozen=True, slots=True)
class Method:
    """A method: what it is called and what runs it; `refine` takes one of your own, too.

    run : (Prepared, options, progress) -> Estimate
    options : a frozen dataclass, every field with a default
    lighting : of the captures that it is for: many photographs under "moving-lamp", one under
        "rgb-leds" or "ambient"
    starts_from_depth : whether it explains all photographs from the depth on, so that the pipeline
        looks for photographs that do not fit the others, and for a result that predicts them worse
        than the prepared depth does
    corrects_pose : whether multi-light is to correct the depth camera's pose first
    given_lights : what it does with a capture's known lights: "use" them; "find" its own, which
        fixed ones forbid; "ignore" them, as methods of one photograph do
    bytes_per_pixel : memory that it needs at the least for each pixel of the object's window;
        measured, rounded down
    in_tiles : whether what does not fit the memory is refined at a lower resolution first, then in
        tiles, by `multi_light.tiles`
    """

    name: str
    run: Callable[[Prepared, Any, ProgressCallback], Estimate]
    options: type[Any]
    lighting: Lighting = "moving-lamp"
    starts_from_depth: bool = False
    corrects_pose: bool = False
    given_lights: Literal["use", "find", "ignore"] = "ignore"
    bytes_per_pixel: int = 500
    in_tiles: bool = False

    def __post_init__(self) -> None:
        """Raise MethodError where `run` cannot be called, `options` not made without arguments."""
        if not callable(self.run):
            raise MethodError(
                f"no function of the method {self.name}",
                seen=type(self.run).__name__,
                needed="(Prepared, options, progress) -> Estimate",
                remedy="give the function itself as run, without calling it",
            )
        whole = isinstance(self.options, type) and is_dataclass(self.options)
        if not whole or any(
            each.init and each.default is MISSING and each.default_factory is MISSING
            for each in fields(self.options)
        ):
            raise MethodError(
                f"no options of the method {self.name}",
                seen=repr(self.options),
                needed="a dataclass, every field with a default",
                remedy="without options: @dataclass(frozen=True) class Options: pass",
            )

    def estimate(self, prepared: Prepared, options: Any, progress: ProgressCallback) -> Estimate:
        """What `run` gives back; MethodError where that is no `Estimate` of this window."""
        found = self.run(prepared, options, progress)
        require_estimate(found, prepared, self.name)
        return found


# Fields of an `Estimate` that may be None.
OPTIONAL = (
    "normals", "depth_sigma", "normal_sigma", "lights.position_m", "lights.middle_m", "lights.beam",
    "lights.ambient_direction",
)  # fmt: skip
# How far a confidence may be beyond 0..1, by the rounding of sums in single precision.
ROUNDED = 1e-6


def require_estimate(found: Any, prepared: Prepared, method: str) -> None:
    """Raise MethodError where what a method gave back is no `Estimate` of this window.

    Values that are not finite may be in it: `finite.only_finite` sees to them.
    """
    for name, holds, seen, needed in _requirements(found, prepared):
        if not holds:
            raise MethodError(
                f"wrong {name} from the method {method}",
                seen=seen,
                needed=needed,
                remedy="give back what rakelight.methods.base.Estimate says",
            )


def _requirements(found: Any, prepared: Prepared) -> Iterator[tuple[str, bool, str, str]]:
    """What an estimate has to be, one by one: its name, whether it holds, what is seen and needed.

    Each is asked for when the ones before it hold.
    """
    yield "estimate", isinstance(found, Estimate), _kind_of(found), "an Estimate"
    yield "lights", isinstance(found.lights, Lights), _kind_of(found.lights), "Lights"
    said = found.findings
    only = isinstance(said, tuple) and all(isinstance(each, Finding) for each in said)
    yield "findings", only, _kind_of(said), "a tuple of Finding"
    kinds = {repr(each.severity) for each in said} - {"'note'", "'warning'"}
    yield "findings", not kinds, ", ".join(sorted(kinds)), "the severity 'note' or 'warning'"
    ended = isinstance(found.converged, bool | np.bool_)
    yield "converged", ended, _kind_of(found.converged), "True or False"
    yield "steps", _is_a(found.steps, int), _kind_of(found.steps), "a whole number"
    yield "energy", isinstance(found.energy, tuple), _kind_of(found.energy), "a tuple of numbers"
    timed = found.timings_s
    yield "timings_s", isinstance(timed, Mapping), _kind_of(timed), "a dict, name -> seconds"
    window, given = prepared.mask.shape, getattr(found.lights.ambient, "shape", ())
    each = (1 if given[:1] == (1,) else len(prepared), 3 if given[1:] == (3,) else 1)
    shapes: dict[str, tuple[int, ...]] = {
        "log_depth": window,
        "albedo": (*window, 3),
        "confidence": window,
        "normals": (*window, 3),
        "depth_sigma": window,
        "normal_sigma": window,
        "lights.ambient": each,
        "lights.vector": (*each, 3),
        "lights.position_m": (*each, 3),
        "lights.middle_m": (3,),
        "lights.beam": (*each, 3),
        "lights.ambient_direction": (3,),
    }
    for name, shape in shapes.items():
        value = attrgetter(name)(found)
        fits = isinstance(value, np.ndarray) and value.shape == shape and value.dtype.kind in "biuf"
        fits = fits or (value is None and name in OPTIONAL)
        yield name, fits, _kind_of(value), f"numbers of shape {shape}"
    confidence = found.confidence[prepared.mask]
    beyond = np.isfinite(confidence) & ((confidence < -ROUNDED) | (confidence > 1 + ROUNDED))
    first = "".join(f"{value:g}" for value in confidence[beyond][:1])
    yield "confidence", not beyond.any(), first, "0 to 1"


def _kind_of(value: object) -> str:
    """What a value is, for a message: an array's type and shape."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype} of shape {value.shape}"
    return type(value).__name__


def require_types(options: Any) -> None:
    """Raise InputError for the first option that is not of its type: text for a number, say.

    >>> from rakelight import MultiLight
    >>> MultiLight(max_iterations=4.0)
    Traceback (most recent call last):
    rakelight.errors.InputError: not a possible value of the option max_iterations (seen 4.0, ...
    """
    for name, hint in get_type_hints(type(options)).items():
        allowed = get_args(hint) or (hint,)
        known = all(kind in _KINDS for kind in allowed)  # a choice of texts is for its method
        if known and not any(_is_a(getattr(options, name), kind) for kind in allowed):
            needed = " or ".join(_KINDS[kind] for kind in allowed)
            require_options(options, **{name: (False, needed)})


_KINDS: dict[Any, str] = {
    int: "a whole number", float: "a number", bool: "True or False", NoneType: "None",
}  # fmt: skip


def _is_a(value: object, kind: type) -> bool:
    """Whether a value is of a type; NumPy's numbers are numbers, True is none."""
    number = {int: Integral, float: Real}.get(kind)
    return isinstance(value, number or kind) and not (number and isinstance(value, bool))


def require_options(options: object, **conditions: tuple[bool, str]) -> None:
    """Raise InputError for the first option whose condition (holds, what is needed) fails."""
    for name, (holds, needed) in conditions.items():
        if not holds:
            raise InputError(
                f"not a possible value of the option {name}",
                seen=repr(getattr(options, name)),
                needed=needed,
            )


def require_ranges(
    options: object, *, from_0: tuple[str, ...] = (), above_0: tuple[str, ...] = ()
) -> None:
    """Raise InputError for the first of these options that is out of its range, or too large.

    None, which some may be, is in it.
    """
    for name in (*from_0, *above_0):
        value, least = getattr(options, name), "at least 0" if name in from_0 else "above 0"
        enough = value is None or (value >= 0 if name in from_0 else value > 0)
        most = f"{least}, at most {LARGEST_WEIGHT:g}"
        fits = enough and (value is None or value <= LARGEST_WEIGHT)
        require_options(options, **{name: (fits, most)})


def require_photographs(
    prepared: Prepared, method: str, least: int, *, for_the_scale: bool = False
) -> None:
    """Raise MethodError when the capture has fewer than `least` photographs.

    for_the_scale : whether super-resolution by a factor s needs s^2 photographs, as the paper's
        methods do, whose unknowns within a depth pixel only the photographs determine
    """
    count, needed = len(prepared.photographs), least
    if for_the_scale:
        needed = max(least, ceil(prepared.factor**2 - 1e-6))
    if count < needed:
        other = "multi-light, which takes 3" if count >= 3 else "fusion-like, which takes one"
        raise MethodError(
            f"too few photographs for {method} at scale {prepared.factor:.3g}",
            source=prepared.source,
            seen=str(count),
            needed=f"at least {needed}",
            remedy="take more photographs with the lamp in other places and the camera fixed"
            + (", or choose a smaller --scale" if needed > least else "")
            + f", or use the method {other}",
        )


def photometric_confidence(
    tensor: Floats,
    noise: Floats | float,
    length: Floats,
    camera: Camera,
    active: Mask | None = None,
    extra_variance: Floats | float = 0.0,
) -> Floats:
    """Confidence (...) from the photographs' information on each normal.

    tensor : (..., 3) summed squared derivatives (uu, uv, vv) of the pixel values with respect to
        the gradient of log depth; noise : (...) standard deviation of a pixel value
    length : (...) |m| of the normals
    active : (h, w) pixels over which the variance is averaged with its neighbours'; None for none
    extra_variance : (...) of the normal, from other causes, radians squared

    The standard deviation d of the normal in its weakest direction, in degrees, gives
    1 / (1 + (d / 3)^2): 1 where the photographs determine the normal, 0 without information.

    >>> camera = Camera(1, 1, fx=1.0, fy=1.0, cx=0.0, cy=0.0)
    >>> strong, weak = np.array([[1e6, 0.0, 1e6]]), np.array([[1e6, 0.0, 0.0]])
    >>> [round(float(photometric_confidence(t, 0.01, np.ones(1), camera)[0]), 3)
    ...  for t in (strong, weak)]
    [1.0, 0.0]
    """
    uu, uv, vv = np.moveaxis(tensor, -1, 0)
    weakest = (uu + vv) / 2 - np.hypot((uu - vv) / 2, uv)
    variance = (
        squared_normal_derivative(length, camera)
        * np.asarray(noise) ** 2
        / np.maximum(weakest, 1e-12)
    )
    if active is not None:
        variance = _averaged(np.minimum(variance, UNDETERMINED_RAD**2), active)
    variance = variance + extra_variance
    return np.asarray(1 / (1 + variance * np.degrees(1.0) ** 2 / HALF_CONFIDENCE_DEG**2))


def _averaged(image: Floats, mask: Mask) -> Floats:
    """An image (h, w) smoothed over `SMOOTHED_PX` inside a mask."""
    from scipy.ndimage import gaussian_filter

    total = gaussian_filter(np.where(mask, image, 0.0), SMOOTHED_PX)
    return np.asarray(total / np.maximum(gaussian_filter(mask.astype(float), SMOOTHED_PX), 1e-6))


def light_findings(lights: Lights, names: tuple[str, ...]) -> tuple[Finding, ...]:
    """Warnings about lights that leave the surface open: too few, all in one place, in one plane.

    >>> same = Lights(np.tile([0.0, 0.0, -1.0], (5, 1, 1)), np.zeros((5, 1)))
    >>> [finding.code for finding in light_findings(same, ())]
    ['one-lamp-position']
    """
    toward, dark = toward_lights(lights)
    named = photograph_names(names, len(dark))
    findings = []
    if dark.any():
        findings.append(
            Finding(
                "warning",
                "dark-photographs",
                f"no light of the lamp is known in {listed(named, dark)}: it does not reach the "
                "object, or saturates all of it",
                "take these again, or leave them out",
            )
        )
    if len(toward) < 3:
        count = f"{len(toward)} of {len(dark)} photographs"
        message, code = f"the lamp reaches the object in only {count}", "few-lights"
    elif (widest := widest_deg(toward)) < LEAST_ANGLE_DEG:
        message = (
            f"lights found in nearly one place, within {widest:.1f} degrees, in "
            f"{listed(named, ~dark)}: the lamp hardly moved, or they are wrong"
        )
        code = ONE_LAMP_POSITION
    elif (thickness := thickness_deg(toward)) < LEAST_THICKNESS_DEG:
        message = (
            f"lights found in one plane, within {thickness:.1f} "
            f"degrees, in {listed(named, ~dark)}: slopes across it are the depth's, "
            "or the lights are wrong"
        )
        code = "lights-in-one-plane"
    else:
        return tuple(findings)
    remedy = "move the lamp around the object, 30 to 60 degrees off the camera on all sides"
    findings.append(Finding("warning", code, message, remedy))
    return tuple(findings)


def toward_lights(lights: Lights) -> tuple[Floats, Mask]:
    """(M, 3) unit vectors to the lights that reach the object, and (N,) which ones do not."""
    vector = lights.vector.mean(axis=1)
    strength = np.linalg.norm(vector, axis=-1)
    # The others are the brightest quarter: of most photographs the lamp may be off.
    dark = strength < DARK * np.quantile(strength, 0.75, method="higher")
    return vector[~dark] / np.maximum(strength[~dark], np.finfo(float).tiny)[:, None], dark


def widest_deg(toward: Floats) -> float:
    """Largest angle, degrees, between unit vectors (M, 3) and their mean."""
    middle = toward.mean(axis=0)
    middle /= max(float(np.linalg.norm(middle)), np.finfo(float).tiny)
    return float(np.degrees(np.arccos(np.clip(toward @ middle, -1, 1))).max())


def thickness_deg(toward: Floats) -> float:
    """Root mean square angle, degrees, of unit vectors (M, 3) off the plane nearest to them."""
    thickness = np.linalg.svd(toward, compute_uv=False)[-1] / np.sqrt(len(toward))
    return float(np.degrees(np.arcsin(thickness)))


def in_one_plane(lights: Lights) -> bool:
    """Whether the lights lie in one plane with the object: photographs show no slope across it.

    >>> tilt = np.radians([-40.0, 0.0, 40.0])
    >>> vector = np.stack([np.sin(tilt), 0 * tilt, -np.cos(tilt)], axis=-1)
    >>> in_one_plane(Lights(vector[:, None], np.zeros((3, 1))))
    True
    """
    toward, _ = toward_lights(lights)
    return len(toward) >= 3 and thickness_deg(toward) < LEAST_THICKNESS_DEG


def first_only(prepared: Prepared, method: str) -> tuple[Finding, ...]:
    """A note about the photographs that a method for one photograph leaves out."""
    if len(prepared) == 1:
        return ()
    which = f" ({printable(prepared.names[0])})" if prepared.names else ""
    message = f"{method} uses the first of {len(prepared)} photographs{which}"
    return (Finding("note", "first-photograph", message, "use multi-light for all"),)


def lights_unused(prepared: Prepared, method: Method) -> tuple[Finding, ...]:
    """A note about given lights that the method does not use.

    Raises MethodError where they are fixed and the method would find others.
    """
    if prepared.lights is None or method.given_lights == "use":
        return ()
    if prepared.lights.fixed and method.given_lights == "find":
        raise MethodError(
            f"{method.name} keeps no given lights: it finds its own",
            source=prepared.source,
            seen="fixed lights",
            remedy="use multi-light, or say fixed = false in [lights]",
        )
    message = f"{method.name} does not use the given lights"
    return (Finding("note", "given-lights-unused", message, "use multi-light"),)


def brightest(albedo: Floats) -> float:
    """The 99th percentile of the albedo: the gain that goes to the lights of every result.

    >>> brightest(np.array([0.2, 0.2, 0.2])), brightest(np.zeros(3))
    (0.2, 1e-06)
    """
    return max(float(np.percentile(albedo, 99)), 1e-6)


def scatter(values: Floats, mask: Mask) -> Floats:
    """Values (P[, C]) of the mask's pixels as an image (h, w[, C]), 0 elsewhere.

    >>> scatter(np.array([5.0]), np.array([[False, True]])).tolist()
    [[0.0, 5.0]]
    """
    image = np.zeros((*mask.shape, *values.shape[1:]))
    image[mask] = values
    return image

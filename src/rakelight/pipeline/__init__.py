"""From a capture to a result: checks, preparation, a method, and its safeguards."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, replace
from time import perf_counter
from typing import Any

import numpy as np

from rakelight.capture.arrays import checked_capture
from rakelight.check.depth_orientation import depth_orientation
from rakelight.check.findings import Stage, checks
from rakelight.check.measured import Measured
from rakelight.errors import CaptureError, InputError, MethodError, RakelightError, counted
from rakelight.geometry.finite import only_finite
from rakelight.jit import one_blas_thread
from rakelight.memory import available_memory, limited_memory, require_memory
from rakelight.methods import (
    METHODS,
    Method,
    choose_method,
    load_method,
    method_of,
    public_options,
)
from rakelight.methods.base import Estimate, lights_unused
from rakelight.model import (
    Capture,
    Finding,
    Floats,
    Progress,
    ProgressCallback,
    Result,
    RigidTransform,
    silent,
)
from rakelight.pipeline.guarded import estimated, surface
from rakelight.pipeline.inside_out import refuse_inverted
from rakelight.pipeline.lower_resolution import REMEDY
from rakelight.pipeline.prediction import prediction_errors
from rakelight.pipeline.saturated_albedo import bounded_albedo
from rakelight.pipeline.tiles import Maps, tiled_maps
from rakelight.prepare import Prepared, PreparedView, Scale, prepared_view
from rakelight.prepare.undistort import undistorted

# Median expected error of the normals, degrees, above which `refine` warns.  Real captures that
# come out well have up to 11 (random-captures.md, "Results that say they are uncertain").
UNCERTAIN_DEG = 15.0


def refine(
    capture: Capture,
    method: str | Method | object = "auto",
    *,
    scale: Scale = "auto",
    options: Any = None,
    progress: ProgressCallback = silent,
    memory: float | None = None,
) -> Result:
    """Refine the depth of a capture by its photographs.

    method : "auto" for the method that fits the capture; a name in `METHODS`; the options of a
        method, such as rakelight.MultiLight(depth_weight=3.0); or a `Method` of your own
    scale : output resolution over the depth's, or "auto" for the colour camera's resolution
    options : of the method, where `method` names it; its defaults when None
    progress : called with a `Progress` at every step
    memory : bytes that this process may take in all; what is free when None.  Where multi-light
        needs more, it refines the whole object at a lower resolution and its detail in tiles

    Returns a `Result` at the output resolution: metres and unit vectors in the camera frame.
    Pixels that the method gives no finite depth are left out; a finding says how many.
    Raises MethodError when the method does not fit the capture or the options, InputError for a bad
    scale and where nothing finite is left, CaptureError when an array is of another type, shape or
    range than `Capture` says, or the depth is plainly that of another place, MachineError when
    there is too little memory.  What `progress` raises comes through.
    """
    capture = checked_capture(capture)
    if not callable(progress):
        raise InputError("progress is no function", seen=type(progress).__name__)
    chosen, options = _chosen(capture, method, options)
    with (
        coming_through(progress) as told, solving(capture), limited_memory(memory),
        one_blas_thread(),
    ):  # fmt: skip
        result = _refined(capture, chosen, scale, options, told)
    return only_finite(result, mask=np.isfinite(result.prepared_depth))


def _chosen(capture: Capture, method: Any, options: Any) -> tuple[Method, Any]:
    """The method that is meant, and its options; raises MethodError."""
    if isinstance(method, Method):
        chosen = method
    elif (named := method_of(method)) is not None:
        if options is not None:
            raise MethodError(
                "options twice",
                source="options",
                seen=f"{public_options(named)}(...) and options={type(options).__qualname__}",
                needed="one of them",
                remedy=f"refine(capture, {public_options(named)}(...))",
            )
        return load_method(named), method
    else:
        is_auto = isinstance(method, str) and method == "auto"
        chosen = load_method(choose_method(capture) if is_auto else method)
    options = chosen.options() if options is None else options
    own = chosen.name not in METHODS
    if not isinstance(options, chosen.options) or not (own or method_of(options) == chosen.name):
        raise MethodError(
            f"these options are not for {chosen.name}",
            seen=_shown(options),
            needed=chosen.options.__qualname__ if own else public_options(chosen.name),
            remedy="give the options alone, without a method: refine(capture, options)"
            if method_of(options)
            else "give a value of that class",
        )
    return chosen, options


def _shown(options: Any) -> str:
    """What kind of options these are, for a message."""
    if isinstance(options, type):
        return f"the class {options.__qualname__}"
    name = method_of(options)
    return type(options).__qualname__ if name is None else public_options(name)


class ProgressError(Exception):
    """What `progress` raised, on its way past those who catch errors of the method."""


@contextmanager
def coming_through(progress: ProgressCallback) -> Iterator[ProgressCallback]:
    """`progress`, whose errors leave the block as they are, whatever becomes of others in it.

    >>> def stop(progress):
    ...     raise np.linalg.LinAlgError("mine")
    >>> with coming_through(stop) as told, solving(None):
    ...     told(Progress("prepare"))
    Traceback (most recent call last):
    numpy.linalg.LinAlgError: mine
    """

    def told(step: Progress) -> None:
        try:
            progress(step)
        except (ValueError, RakelightError) as error:
            raise ProgressError(error) from error

    raised: ValueError | RakelightError | None = None
    try:
        yield told
    except ProgressError as error:
        raised = error.args[0]
    if raised is not None:  # outside, where it gets no second cause
        raise raised


@contextmanager
def solving(capture: Capture) -> Iterator[None]:
    """Where a method runs: CaptureError in place of what solvers raise of systems without solution.

    >>> empty = np.zeros((0, 0))
    >>> with solving(Capture(empty, empty, empty, None)):
    ...     raise np.linalg.LinAlgError("singular")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: no surface explains this capture (seen singular, ...
    """
    try:
        # What overflows shows in the result.
        with np.errstate(all="ignore"):
            yield
    except ValueError as error:
        if isinstance(error, np.linalg.LinAlgError) or "infs or NaNs" in str(error):  # scipy's
            raise CaptureError(
                "no surface explains this capture",
                source=capture.source,
                seen=str(error),
                needed="depth and photographs of one object",
                remedy="look for outliers in the depth on the object, and check the mask",
            ) from error
        raise


def _refined(
    capture: Capture, chosen: Method, scale: Scale, options: Any, progress: ProgressCallback
) -> Result:
    began = perf_counter()
    as_read, capture = capture, undistorted(capture)
    undistorted_at = perf_counter()
    capture = pose_corrected(capture, chosen, options, progress)
    registered_at = perf_counter()
    progress(Progress("prepare"))
    measured = Measured(capture)
    with checked_beside("prepare", measured) as checked:
        view = prepared_view(capture, scale)
    # Quick refinements that tell whether depth is inside out use all cores; only suspicious
    # captures have them.
    refuse_inverted(measured, checked)
    prepared_at = perf_counter()
    with checked_beside("method", measured) as checked_later:
        made, prepared, estimate, maps = _maps(capture, view, chosen, options, progress)
    refined_at = perf_counter()
    depth_m, normals = surface(prepared, estimate)
    result = Result(
        depth=maps.depth_m,
        normals=maps.normals,
        albedo=maps.albedo,
        confidence=maps.confidence,
        lights=estimate.lights,
        camera=view.camera,
        prepared_depth=maps.prepared_m,
        method=chosen.name,
        options=asdict(options),
        iterations=estimate.iterations,
        energy=estimate.energy,
        converged=estimate.converged,
        timings_s={
            **({"undistort": undistorted_at - began} if capture.camera != as_read.camera else {}),
            **({"register": registered_at - undistorted_at} if capture.register else {}),
            "prepare": prepared_at - registered_at,
            "refine": refined_at - prepared_at,
            **estimate.timings_s,
        },
        findings=(*view.findings, *checked, *checked_later, *made, *_convergence(estimate)),
        source=capture.source,
        photograph_names=prepared.names[: len(estimate.lights)],  # some methods use the first alone
        capture=_figures(as_read, capture.depth_to_color if capture.register else None),
        prediction_errors=prediction_errors(prepared, depth_m, normals, estimate.lights),
        depth_sigma=maps.depth_sigma_m,
        normal_sigma=maps.normal_sigma_deg,
    )
    return replace(result, findings=result.findings + _uncertainty(result))


def _maps(
    capture: Capture, view: PreparedView, chosen: Method, options: Any, progress: ProgressCallback
) -> tuple[tuple[Finding, ...], Prepared, Estimate, Maps]:
    """Findings, what an estimate was made from, the estimate, and the maps of the whole image.

    All at once where that fits the memory; else in tiles, where the method can.

    Raises MachineError when there is too little memory for the method.
    """
    pixels = view.window_pixels
    if chosen.in_tiles and pixels * chosen.bytes_per_pixel > available_memory():
        return tiled_maps(capture, view, chosen, options, progress)
    require_memory(
        pixels * chosen.bytes_per_pixel,
        source=capture.source,
        remedy=REMEDY,
    )
    prepared = view.window(*view.object_window)
    unused = lights_unused(prepared, chosen)
    prepared, estimate = estimated(chosen, prepared, options, progress)
    depth_m, normals = surface(prepared, estimate)
    albedo, bounded = bounded_albedo(prepared, depth_m, normals, estimate)
    maps = Maps(
        depth_m=prepared.embed(depth_m, np.nan),
        normals=prepared.embed(normals, np.nan),
        albedo=prepared.embed(np.maximum(albedo, 0), 0.0),
        confidence=prepared.embed(prepared.marked(estimate.confidence), 0.0),
        prepared_m=prepared.embed(prepared.depth_m, np.nan),
        depth_sigma_m=_embedded(prepared, estimate.depth_sigma),
        normal_sigma_deg=_embedded(prepared, estimate.normal_sigma),
    )
    return unused + estimate.findings + bounded, prepared, estimate, maps


@contextmanager
def checked_beside(stage: Stage, measured: Measured) -> Iterator[list[Finding]]:
    """What the checks that belong to a stage find, once the block has ended, beside which they run.

    A stage leaves half a core idle or more: most of the preparation runs on one, and the method
    where its systems are small.
    """
    found: list[Finding] = []
    with ThreadPoolExecutor(1) as beside:
        checked = beside.submit(
            lambda: [each for check in checks(in_refine=stage) for each in check(measured)]
        )
        yield found
        found += checked.result()


def _embedded(prepared: Prepared, sigma: Floats | None) -> Floats | None:
    """An expected error (h, w) in the full image, NaN outside; None without."""
    return None if sigma is None else prepared.embed(sigma, np.nan)


def pose_corrected(
    capture: Capture, method: Method, options: Any, progress: ProgressCallback = silent
) -> Capture:
    """The capture with its depth camera's pose corrected, where it asks for that.

    With a finding in place of the correction where the method cannot do it.

    Raises CaptureError where the depth is turned or mirrored beyond doubt: moved onto the
    photographs it would look shifted, or right.
    """
    if not capture.register:
        return capture
    if not method.corrects_pose:
        message = f"depth not registered: {method.name} does not correct the depth camera's pose"
        note = Finding("warning", "not-registered", message, "use --method multi-light")
        return replace(capture, findings=(*capture.findings, note), register=False)
    from rakelight.methods.multi_light import MultiLight
    from rakelight.pipeline.pose import registered

    depth_orientation(Measured(capture))
    known = isinstance(options, MultiLight)  # a method of one's own has its own
    return registered(capture, options if known else MultiLight(), progress)


def _figures(capture: Capture, depth_to_color: RigidTransform | None) -> dict[str, Any]:
    """What was read, for the result's records; the depth camera's pose as it was corrected."""
    figures: dict[str, Any] = {
        "photographs": len(capture.photographs),
        "photograph_size": [capture.camera.width, capture.camera.height],
        "bits": 8 * capture.photographs.dtype.itemsize,
        "encoding": capture.encoding,
        "lighting": capture.lighting,
        "depth_maps": len(capture.depth_m),
        "depth_size": [capture.depth_m.shape[2], capture.depth_m.shape[1]],
        "depth_checksum": capture.depth_checksum,
    }
    if depth_to_color is not None:
        rotation = depth_to_color.rotation.tolist()
        translation = depth_to_color.translation_m.tolist()
        figures["depth_to_color"] = {"rotation": rotation, "translation": translation}
    if (lens := capture.camera.distortion) is not None:
        figures["distortion"] = {"model": lens.model, "k": list(lens.coefficients)}
    return figures


def _convergence(estimate: Estimate) -> tuple[Finding, ...]:
    if estimate.converged:
        return ()
    message = f"not converged after {counted(estimate.iterations, 'iteration')}"
    return (Finding("warning", "not-converged", message, "look at the result before you use it"),)


def _uncertainty(result: Result) -> tuple[Finding, ...]:
    """A warning where the normals' median expected error is more than `UNCERTAIN_DEG`."""
    if result.expected_errors is None or result.expected_errors[1] <= UNCERTAIN_DEG:
        return ()
    message = (
        f"half of the normals are expected to be {result.expected_errors[1]:.0f} degrees off or "
        "more: photographs and depth leave them open"
    )
    remedy = "take more photographs, the lamp 30 to 60 degrees off the camera's axis on all sides"
    return (Finding("warning", "normals-uncertain", message, remedy),)


__all__ = ["refine"]

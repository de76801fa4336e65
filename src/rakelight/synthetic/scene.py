"""Captures with known truth: an object, its paint, lights and sensors.

Photographs are rendered with several rays per pixel and averaged in linear light, from exact
normals, so that they owe nothing to the differences by which a method takes its normals.
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from itertools import groupby
from operator import itemgetter
from os import PathLike

import numpy as np

from rakelight.capture.arrays import check_object, check_sensor
from rakelight.capture.folder import SYNTHETIC, write_all_but_photographs
from rakelight.capture.listing import numbered
from rakelight.capture.rows import TiffFile, pack_png_rows, pack_tiff_rows, png_parts
from rakelight.capture.truth import TRUE_MAPS, write_lights
from rakelight.capture.validate import HOLES, check_camera
from rakelight.errors import CaptureError, InputError
from rakelight.files import as_path, write_parts
from rakelight.folders import staged_folder
from rakelight.model import Capture, Finding, ProgressCallback, Truth, silent
from rakelight.synthetic.albedo import Albedo, make_albedo
from rakelight.synthetic.noise import DepthNoise
from rakelight.synthetic.options import SceneOptions
from rakelight.synthetic.rendering import rendered, require_samples
from rakelight.synthetic.shapes import Shape, make_shape


@np.errstate(under="ignore")  # of a bump far away, whatever the caller has set
def render_scene(
    shape: Shape, albedo: Albedo, options: SceneOptions | None = None
) -> tuple[Capture, Truth]:
    """The capture that a camera and a depth sensor make of an object, and what is true of it.

    The truth is exact at the pixel centres of the colour camera.  Its mask, and the capture's,
    leaves out the pixels that the object does not cover whole.  Its lights are those of the
    photographs' linear values, white being 1: photograph = albedo * (max(0, s.n) + ambient),
    where nothing is shaded or shines.  The middle of near lights is the visible points' mean.

    Raises InputError when the camera does not see the object, MachineError when there is too little
    memory.

    >>> options = SceneOptions(camera=make_shape("sphere").camera.scaled(0.1), photographs=4)
    >>> capture, truth = render_scene(make_shape("sphere"), make_albedo("white"), options)
    >>> capture.photographs.shape, round(float(np.nanmin(truth.depth)), 3)
    ((4, 36, 48, 3), 0.7)
    """
    options = options or SceneOptions()
    camera = options.camera or shape.camera
    require_samples(camera, options, photographs=options.count)
    maps = {name: np.empty((*camera.shape, *axes), np.float32) for name, axes in TRUE_MAPS.items()}
    truth = Truth(maps["depth"], maps["normals"], maps["albedo"])

    def keep(rows: slice, strip: Truth) -> None:
        for name, values in maps.items():
            values[rows] = getattr(strip, name)

    scene = rendered(shape, albedo, options, lambda strip: strip, keep, silent)
    photographs = np.empty((scene.count, *camera.shape, 3), scene.dtype)
    for i, rows, values in scene.photographs(lambda values: values, silent):
        photographs[i, rows] = values
    return scene.capture(photographs), replace(truth, lights=scene.lights.as_lights(scene.level))


@np.errstate(under="ignore")
def write_scene(
    shape: Shape,
    albedo: Albedo,
    options: SceneOptions,
    folder: str | PathLike[str],
    *,
    overwrite: bool = False,
    progress: ProgressCallback = silent,
) -> tuple[Capture, tuple[Finding, ...]]:
    """Write what `render_scene` gives as a capture folder, without ever holding a photograph.

    The folder appears complete or not at all.  Returned is the capture without its photographs, and
    what `write_capture` returns.

    Raises what `render_scene` and `write_capture` do, and InputError for a capture that
    `load_capture` would refuse.

    >>> from tempfile import TemporaryDirectory
    >>> from rakelight.capture import load_capture
    >>> sphere = make_shape("sphere")
    >>> options = SceneOptions(camera=sphere.camera.scaled(0.1), photographs=3)
    >>> with TemporaryDirectory() as scratch:
    ...     _ = write_scene(sphere, make_albedo("white"), options, f"{scratch}/ball")
    ...     load_capture(f"{scratch}/ball").photographs.shape
    (3, 36, 48, 3)
    """
    target = as_path(folder, "folder")
    with staged_folder(target, manifest=SYNTHETIC, overwrite=overwrite) as staging:
        true, rgb = staging.path / "truth", staging.path / "rgb"
        true.mkdir()
        rgb.mkdir()
        with ExitStack() as stack:
            files: dict[str, TiffFile] = {}

            def pack(strip: Truth) -> dict[str, bytes]:
                return {name: pack_tiff_rows(getattr(strip, name)) for name in TRUE_MAPS}

            def keep(rows: slice, packed: dict[str, bytes]) -> None:
                shape_px, height = (options.camera or shape.camera).shape, rows.stop - rows.start
                for name, axes in TRUE_MAPS.items():
                    if name not in files:
                        file = TiffFile(true / f"{name}.tiff", (*shape_px, *axes), height)
                        files[name] = stack.enter_context(file)
                    files[name].append(packed[name])

            scene = rendered(shape, albedo, options, pack, keep, progress)
        write_lights(scene.lights.as_lights(scene.level), true)
        capture = scene.capture(np.empty((0, *scene.camera.shape, 3), scene.dtype))
        _require_readable(capture, str(target))
        write_all_but_photographs(capture, staging.path)
        strips = scene.photographs(pack_png_rows, progress)
        for i, packed in groupby(strips, key=itemgetter(0)):
            parts = png_parts(scene.camera.shape, scene.dtype, map(itemgetter(2), packed))
            write_parts(rgb / numbered(i), parts)
    return capture, staging.findings


def _require_readable(capture: Capture, source: str) -> None:
    """Raise InputError where `load_capture` would refuse a capture without its photographs."""
    depth_m = capture.depth_m
    holes = np.where(np.isfinite(depth_m), 0, HOLES.index("not finite")).astype(np.uint8)
    remedy = "give a depth map of more pixels, or in Python shape_from_file(path, camera)"
    try:
        check_camera(capture.camera, capture.camera.shape, "", "intrinsics")
        remedy = "fewer holes, or a larger object or image"
        check_object(capture, check_sensor(capture), holes)
    except CaptureError as error:
        raise InputError(
            f"this scene makes no capture that can be read: {error.what}",
            source=source,
            seen=error.seen,
            needed=error.needed,
            remedy=remedy,
        ) from error


DEMO_OPTIONS = SceneOptions(
    photographs=12,
    depth_factor=2,
    depth_noise=DepthNoise(rms_mm=2.5, correlation_length_px=6.0, step_mm=1.0, hole_fraction=0.01),
)


def demo_scene(seed: int = 0) -> tuple[Capture, Truth]:
    """The scene of `rakelight demo`: a painted vase, twelve lights, half-resolution depth.

    >>> capture, truth = demo_scene()
    >>> capture.photographs.shape, capture.depth_m.shape
    ((12, 360, 480, 3), (1, 180, 240))
    """
    options = replace(DEMO_OPTIONS, seed=seed)
    return render_scene(make_shape("vase"), make_albedo("pattern"), options)

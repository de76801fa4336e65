"""The capture folder: capture.toml, rgb/, depth/, mask.png; and truth/ beside them.

The format is in docs/reference/files.md.  What a file may be:

- photographs: PNG or TIFF, 8 or 16 bit; JPEG with a warning.  Grey is repeated to three
  channels, alpha is dropped, each with a note.  EXIF orientation is ignored, with a warning.
- depth: see rakelight.capture.depth.
- mask.png: PNG; a pixel is object where any colour channel is not zero, of a picture that is
  transparent in parts where it is not.  Without it the object nearest to the camera is cut out.
- ambient.png, flat.png: see rakelight.capture.ambient_and_flat.
- hidden files are skipped, files of other kinds listed in a note.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np

from rakelight.capture import validate
from rakelight.capture.ambient_and_flat import check_fits, corrected
from rakelight.capture.arrays import checked_arrays, checked_truth
from rakelight.capture.config import (
    CONFIG,
    EXAMPLE,
    CaptureTable,
    format_config,
    misnamed_config,
    parse_config,
)
from rakelight.capture.defaults import (
    chosen_encoding,
    chosen_lighting,
    object_mask,
    on_depth_grid,
)
from rakelight.capture.depth import (
    UNKNOWN_SENSOR,
    check_depth_kind,
    depth_geometry,
    depth_values,
    read_depth,
)
from rakelight.capture.headers import read_header
from rakelight.capture.images import as_rgb, decode_image, encode_png, encode_tiff
from rakelight.capture.lights import (
    checked_lights,
    lights_files,
    lights_lines,
    lights_named,
    read_lights,
)
from rakelight.capture.listing import (
    Images,
    Root,
    check_photograph_kind,
    file_findings,
    list_images,
    meant_otherwise,
    numbered,
    read_mask,
    read_photographs,
    refuse_misnamed,
)
from rakelight.capture.tone_curve import contradicted, stated_encoding
from rakelight.capture.truth import write_truth
from rakelight.capture.white_level import stretched
from rakelight.errors import CaptureError, InputError, OutputExistsError, check_is, printable
from rakelight.files import as_path, clear_errors, in_threads, read_bytes, write_bytes
from rakelight.folders import file_list, staged_folder
from rakelight.model import (
    Array,
    Capture,
    Encoding,
    Finding,
    Floats,
    GivenLights,
    Mask,
    SensorNoise,
    Truth,
    finite_number,
    selected,
)

CAPTURE = file_list("capture")
"""By which a capture folder that `write_capture` made without truth is known."""

SYNTHETIC = file_list("synthetic capture")
"""By which one with truth is known: never a real capture."""

_PICTURES = ("mask.png", "ambient.png", "flat.png")
_READ_NAMES = "the mask is mask.png, directions of lights are lights.lp; or move them away"
# Bytes of capture.toml: a full one takes a thousand.  The time of the TOML parser grows with the
# square of some texts: 80,000 take it a minute.
_LARGEST_CONFIG = 16_000


def read_folder(folder: Path, photographs: Sequence[int] | None = None) -> Capture:
    """The capture of a folder; what `load_capture` says of the result and the errors holds."""
    root = Root(folder)
    table = _read_config(root)
    camera = table.intrinsics.camera("intrinsics", root.shown(CONFIG))
    refuse_misnamed(root, _PICTURES)

    rgb, depth, lights, exposures, light_order = _list_all(root, table, photographs)
    validate.check_camera(camera, rgb.shape, root.shown(CONFIG), "intrinsics")
    depth_camera, depth_to_color = depth_geometry(table, depth.shape, root.shown(CONFIG))
    own_view = depth_camera is None
    factor = validate.depth_factor(depth.shape, rgb.shape, depth.source) if own_view else None
    depth_noise = _depth_noise(root, table)

    images = read_photographs(rgb)
    names = tuple(map(printable, rgb.names))
    validate.check_not_twice(images, names, rgb.source)
    scale = table.depth_scale
    depth_m, holes = read_depth(depth, scale, depth_camera, root.shown(CONFIG))
    encoding, assumed = _encoding(table, rgb, f"{8 * images.dtype.itemsize}-bit")
    images, encoding, light, ambient = _without_ambient(root, images, encoding)
    capture = Capture(
        photographs=images,
        depth_m=depth_m,
        mask=np.ones(rgb.shape, bool),
        camera=camera,
        encoding=encoding,
        lighting=chosen_lighting(table.lighting, len(images)),
        depth_camera=depth_camera,
        depth_to_color=depth_to_color,
        depth_noise=depth_noise,
        register=table.register,
        names=names,
        exposures=exposures,
        source=root.shown(),
    )
    if lights is not None:
        lights = _checked(lights, len(images), depth_m, table, root)
    mask, mask_findings = _read_mask(root, rgb.shape) or object_mask(
        capture, root.shown("depth"), "check [depth_intrinsics] and [depth_to_color]"
    )
    on_object = on_depth_grid(mask, factor, depth.shape)
    return replace(
        capture,
        mask=mask,
        lights=lights,
        findings=(
            *assumed,
            *validate.principal_point_finding(camera),
            *light,
            *light_order,
            *file_findings(rgb),
            *file_findings(depth),
            *mask_findings,
            *validate.check_depth(depth_m, holes, on_object, depth.source, scale, depth.names),
            *validate.check_exposure(images, mask, names, rgb.source, ambient),
        ),
    )


def _checked(
    lights: GivenLights, count: int, depth_m: Floats, table: CaptureTable, root: Root
) -> GivenLights:
    """The lights of so many photographs, and of depth (K, h, w), as `checked_lights` gives them."""
    middle_z_m = float(np.nanmedian(depth_m)) if np.isfinite(depth_m).any() else 0.0
    with lights_named(table.lights, root.shown):
        return checked_lights(lights, count, middle_z_m)


def load_depth(folder: str | PathLike[str]) -> Floats:
    """The depth maps (K, h, w) of a capture folder as `load_capture` reads them, and no more.

    Raises CaptureError when they are missing or damaged, MachineError when they cannot be read.

    >>> load_depth("no/such/folder")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: no/such/folder: no such folder (needed ...
    """
    root = Root(as_path(folder, "folder"))
    table = _read_config(root)
    depth = list_images(root, "depth", "depth maps")
    check_depth_kind(depth, table, root)
    return read_depth(depth, table.depth_scale)[0]


def write_capture(
    capture: Capture,
    folder: str | PathLike[str],
    *,
    truth: Truth | None = None,
    depth_scale: float | None = None,
    contact_sheet: Array | None = None,
    overwrite: bool = False,
) -> tuple[Finding, ...]:
    """Write a capture folder; it appears complete or not at all.

    Parameters
    ----------
    capture : read back, its arrays are bit-identical; `names`, `findings` and `source` are not
        stored
    folder : where it is to appear; its parents are made
    truth : stored in truth/ for `load_truth`
    depth_scale : store depth as 16-bit PNG with so many values per metre, rounded: at least 1000,
        or as many as keep the steps within the depth's noise; without it as float32 TIFF in metres,
        exact
    contact_sheet : (H, W, 3) uint8, which frames of a recording were taken and which not, stored as
        contact-sheet.png
    overwrite : replace an older capture folder, with truth or without as this one, if it holds
        nothing but what its rakelight-files.json lists, unchanged; never one made by hand, nor
        the one that `capture` was read from

    Returns
    -------
    a warning for each older folder that stays under a hidden name because it could not be deleted

    Raises
    ------
    CaptureError
        the arrays do not fit each other, or `depth_scale` does not fit the depth: values beyond 16
        bit, or steps coarser than its noise
    OutputExistsError
        something stands at `folder` and may not be replaced
    MachineError
        disk full, no permission, or another run is writing the same folder

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from rakelight.model import Camera
    >>> random = np.random.default_rng(0)
    >>> capture = Capture(photographs=random.integers(50, 200, (3, 6, 8, 3), np.uint8),
    ...                   depth_m=np.full((1, 3, 4), 0.5, np.float32),
    ...                   mask=np.eye(6, 8, dtype=bool),
    ...                   camera=Camera(8, 6, 10.0, 10.0, 3.5, 2.5))
    >>> from rakelight.capture import load_capture
    >>> with TemporaryDirectory() as scratch:
    ...     findings = write_capture(capture, Path(scratch) / "small")
    ...     again = load_capture(Path(scratch) / "small")
    >>> np.array_equal(again.photographs, capture.photographs), again.names[0]
    (True, '000.png')
    """
    capture = checked_arrays(capture)
    if depth_scale is not None:
        _check_number(depth_scale)
    if contact_sheet is not None:
        check_is(contact_sheet, np.ndarray, "contact_sheet", "give (H, W, 3) uint8")
    if truth is not None:
        checked_truth(truth, capture.camera.shape)
    target = as_path(folder, "folder")
    if capture.source and _same_folder(target, Path(capture.source)):
        raise OutputExistsError(
            "this is the input; it is never overwritten",
            source=str(target),
            remedy="choose another name",
        )
    manifest = CAPTURE if truth is None else SYNTHETIC
    with staged_folder(target, manifest=manifest, overwrite=overwrite) as staging:
        write_all_but_photographs(capture, staging.path, depth_scale)
        (staging.path / "rgb").mkdir()
        _write_each(staging.path / "rgb", ".png", encode_png, capture.photographs)
        if truth is not None:
            write_truth(truth, staging.path / "truth")
        if contact_sheet is not None:
            write_bytes(staging.path / "contact-sheet.png", encode_png(contact_sheet))
    return staging.findings


def _read_config(root: Root) -> CaptureTable:
    with clear_errors(root.shown(), "cannot be read"):
        return parse_config(_config_bytes(root), root.shown(CONFIG))


def _config_bytes(root: Root) -> bytes:
    if not root.path.is_dir():
        a_file = root.path.is_file()
        raise CaptureError(
            "a capture is a folder" if a_file else "no such folder",
            source=root.shown(),
            seen="a file" if a_file else "",
            needed=f"a folder with {CONFIG}",
            remedy="name a capture folder",
        )
    if not os.path.lexists(root.path / CONFIG):
        meant = misnamed_config(root.path)
        raise CaptureError(
            f"no {CONFIG} in it", source=root.shown(), seen=printable(meant or ""),
            remedy=f"rename it to {CONFIG}" if meant else f"write one: {EXAMPLE}",
        )  # fmt: skip
    return read_bytes(root.path / CONFIG, source=root.shown(CONFIG), max_bytes=_LARGEST_CONFIG)


def _list_all(
    root: Root, table: CaptureTable, photographs: Sequence[int] | None
) -> tuple[Images, Images, GivenLights | None, tuple[float, ...], tuple[Finding, ...]]:
    """The photographs, those chosen, and the depth maps: of kinds that are read.

    And of the photographs: their lights, and their exposures.

    The findings are of the lights, and of files that are read under no such name.
    """
    rgb = list_images(root, "rgb", "photographs")
    lights, findings = read_lights(table.lights, root.path, root.shown, rgb.names)
    exposures = tuple(table.exposures)
    validate.check_exposures(exposures, len(rgb.names), root.shown(CONFIG), "exposures")
    read = (*_PICTURES, "lights.json", *lights_files(table.lights))
    findings += meant_otherwise(root, read, _READ_NAMES)
    if photographs is not None:
        count, rgb = len(rgb.names), rgb.chosen(photographs)
        if lights is not None and len(lights) == count:
            lights = lights.select(photographs)
        exposures = selected(exposures, photographs)
    depth = list_images(root, "depth", "depth maps")
    check_photograph_kind(rgb)
    check_depth_kind(depth, table, root)
    return rgb, depth, lights, exposures, findings


def _encoding(table: CaptureTable, rgb: Images, kind: str) -> tuple[Encoding, tuple[Finding, ...]]:
    """The photographs' encoding: as capture.toml says, or their files; and what is to say of it."""
    given = table.encoding
    encoding, findings = chosen_encoding(
        given or stated_encoding(rgb.by_name, rgb.source),
        kind,
        f'write encoding = "linear" or "srgb" into {CONFIG}',
    )
    return encoding, findings + (contradicted(rgb.by_name, given) if given else ())


def _depth_noise(root: Root, table: CaptureTable) -> SensorNoise | None:
    """What capture.toml says of the sensor's noise, checked."""
    if table.depth_noise is None:
        return None
    noise = table.depth_noise.noise()
    validate.check_noise(noise, root.shown(CONFIG))
    return noise


def _without_ambient(
    root: Root, images: Array, encoding: Encoding
) -> tuple[Array, Encoding, tuple[Finding, ...], str]:
    """The photographs with the white of 16 bits, corrected by ambient.png and flat.png if any.

    The text is the path of ambient.png for messages, empty where there is none.
    """
    ambient, flat = (_read_picture(root, name, images) for name in ("ambient.png", "flat.png"))
    scaled = stretched(images, ambient, flat)
    if ambient is None and flat is None:
        return images, encoding, scaled, ""
    sources = root.shown("ambient.png"), root.shown("flat.png")
    images, findings = corrected(images, encoding, ambient, flat, sources)
    return images, "linear", scaled + findings, "" if ambient is None else sources[0]


def _read_picture(root: Root, name: str, images: Array) -> Array | None:
    """(H, W, 3) of a PNG beside rgb/, None when there is none; its size is checked first."""
    path, source = root.path / name, root.shown(name)
    if not os.path.lexists(path):
        return None
    data = read_bytes(path, source=source)
    header = read_header(data, source)
    shape = (header.height, header.width, 3)
    check_fits(shape, header.dtype, images, source, same_type=name == "ambient.png")
    return as_rgb(decode_image(data, source))


def _read_mask(root: Root, shape: tuple[int, int]) -> tuple[Mask, tuple[Finding, ...]] | None:
    """mask.png, (H, W) True = object, and what is to say of it; None when there is none."""
    path, source = root.path / "mask.png", root.shown("mask.png")
    if not os.path.lexists(path):
        return None
    mask, findings = read_mask(path, source, shape, ("PNG",))
    return mask, (*validate.check_mask(mask, source), *findings)


def _check_number(depth_scale: object) -> None:
    """Raise InputError for a depth_scale that is no number, or too large for a float."""
    if not finite_number(depth_scale):
        raise InputError(
            "this is no finite number",
            source="depth_scale",
            seen=type(depth_scale).__name__,
            needed="depth values per metre",
            remedy="give 1000 for millimetres, or none to write float TIFF",
        )


def _same_folder(first: Path, second: Path) -> bool:
    try:
        return first.samefile(second)
    except (OSError, ValueError):
        return False


def write_all_but_photographs(
    capture: Capture, path: Path, depth_scale: float | None = None
) -> None:
    """Write depth/, mask.png, capture.toml and known lights into the folder of a capture."""
    (path / "depth").mkdir()
    if depth_scale is None:
        _write_each(path / "depth", ".tiff", encode_tiff, capture.depth_m)
    else:
        values = depth_values(capture.depth_m, depth_scale, capture.depth_noise or UNKNOWN_SENSOR)
        _write_each(path / "depth", ".png", encode_png, values)
    write_bytes(path / "mask.png", encode_png(capture.mask.astype(np.uint8) * np.uint8(255)))
    config = format_config(
        capture.camera,
        capture.encoding,
        capture.lighting,
        depth_scale,
        capture.depth_camera,
        capture.depth_to_color,
        capture.depth_noise,
        capture.register,
        capture.exposures,
    )
    if capture.lights is not None:
        lines, files = lights_lines(capture.lights)
        config += lines
        for name, text in files.items():
            write_bytes(path / name, text.encode())
    write_bytes(path / CONFIG, config.encode())


def _write_each(folder: Path, suffix: str, encode: Callable[[Array], bytes], images: Array) -> None:
    def write(index: int) -> None:
        write_bytes(folder / numbered(index, suffix), encode(images[index]))

    in_threads(write, range(len(images)))

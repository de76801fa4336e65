"""Any folder of photographs and depth: of phones, of cameras, of other programs."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from rakelight.capture import validate
from rakelight.capture.config import CONFIG
from rakelight.capture.decoder_process import DecoderProcess
from rakelight.capture.exif import ROUGHNESS, camera_of, roughness_of
from rakelight.capture.from_arrays import capture_from_arrays
from rakelight.capture.intrinsics import small_texts
from rakelight.capture.intrinsics.names import (
    may_state,
    named_intrinsics,
    names_depth,
    names_lens,
)
from rakelight.capture.listing import check_numbers, read_mask, unread_finding
from rakelight.capture.loose_confidence import without_unsure
from rakelight.capture.loose_depth import depth_noted, read_loose_depth
from rakelight.capture.loose_files import (
    RESULT,
    LooseFile,
    LooseFiles,
    candidates,
    images_in,
    list_loose_files,
)
from rakelight.capture.loose_photographs import Photos, read_loose_photographs
from rakelight.capture.readers.base import Reader, Reading, Wanted
from rakelight.capture.readers.stated_camera import FORMATS, MATRIX, stated_camera
from rakelight.capture.readers.stated_depth_camera import stated_depth_camera
from rakelight.errors import CaptureError, MachineError, listed, named_in, printable
from rakelight.model import Camera, Encoding, Finding, Floats, GivenLights, Mask, RigidTransform

# Sides whose proportions differ by less show the same field of view: 4032x3024 and 256x192 are
# alike, 1920x1440 and 640x480, and rounding of one pixel in 192.
_SAME_PROPORTIONS = 0.01

# Formats that may be depth without a name that says so.
_MAYBE_DEPTH = ("PNG", "TIFF", "exr", "pfm", "npy")

EXIF_FOCAL = "intrinsics-from-exif"


def sniff(path: Path) -> bool:
    """Whether the folder holds photographs and something that may be their depth.

    rgb/ and depth/ without intrinsics are left to the capture folder: it says what is missing.
    """
    if not path.is_dir() or os.path.lexists(path / CONFIG):
        return False
    if (path / RESULT).is_file():
        return False
    try:
        texts = any(map(may_state, candidates(path)))
        images = images_in(path)
    except (CaptureError, MachineError):
        return False
    if (path / "rgb").is_dir() and (path / "depth").is_dir() and not texts:
        return False
    depth = any(role == "depth" or kind in _MAYBE_DEPTH for kind, role in images)
    return depth and any(role is None and kind not in ("pfm", "npy") for kind, role in images)


def read(path: Path, wanted: Wanted) -> Reading:
    """The capture of the folder."""
    return reading_of(path, list_loose_files(path), wanted)


def reading_of(
    path: Path,
    files: LooseFiles,
    wanted: Wanted,
    lights: GivenLights | None = None,
    encoding: Encoding | None = None,
) -> Reading:
    """The capture of a folder whose files are known.

    lights : of all its photographs; encoding : where the files are not to say it
    """
    if wanted.photographs is not None:
        check_numbers(wanted.photographs, len(files.photographs))
        chosen = tuple(files.photographs[i] for i in wanted.photographs)
        files = replace(files, photographs=chosen)
        lights = None if lights is None else lights.select(wanted.photographs)
    with DecoderProcess() as decoder:
        depth_m, depth_findings = read_loose_depth(files, decoder)
        doubt_findings = without_unsure(depth_m, files)
        photos = read_loose_photographs(files, decoder, depth_m.shape[2], wanted.progress)
    camera, camera_findings = _camera(path, files, photos)
    depth_camera, depth_to_color, view_findings = _depth_place(path, files, camera, depth_m)
    mask, mask_findings = _mask(files, camera)
    with named_in(str(path)):
        capture = capture_from_arrays(
            photos.pixels,
            depth_m,
            camera,
            mask=mask,
            encoding=encoding or photos.encoding,
            names=tuple(printable(Path(file.name).name) for file in files.photographs),
            depth_camera=depth_camera,
            depth_to_color=depth_to_color,
            ambient=photos.ambient,
            flat=photos.flat,
            lights=lights,
            exposures=photos.exposures,
            depth_names=tuple(printable(file.name) for file in files.depth),
            picture_names=(_shown(files.ambient, "ambient"), _shown(files.flat, "flat")),
        )
    findings = (
        *camera_findings,
        *view_findings,
        *photos.findings,
        *depth_noted(depth_findings, capture),
        *doubt_findings,
        *mask_findings,
        *_unused(files, lights),
        *capture.findings,
    )
    return Reading(replace(capture, source=str(path), findings=findings))


def _shown(file: LooseFile | None, otherwise: str) -> str:
    return otherwise if file is None else printable(file.name)


def _mask(files: LooseFiles, camera: Camera) -> tuple[Mask | None, tuple[Finding, ...]]:
    """(H, W) of the file that is the mask, None without one."""
    if files.mask is None:
        return None, ()
    return read_mask(files.mask.path, files.mask.source, camera.shape, ("PNG", "TIFF"))


def _camera(folder: Path, files: LooseFiles, photos: Photos) -> tuple[Camera, tuple[Finding, ...]]:
    """The camera of the photographs as they are returned, by a file or by EXIF."""
    height, width = photos.pixels.shape[1:3]
    full_width, full_height = photos.full
    texts = small_texts(path for path in files.texts if not names_depth(path.stem))
    stated = stated_camera(folder, texts, photos.full)
    if stated is not None:
        camera = stated.camera
        if not camera.width:
            camera = replace(camera, width=full_width, height=full_height)
        shape = (full_height, full_width)
        if camera.shape == (height, width):
            shape = (height, width)
        validate.check_camera(camera, shape, f"{folder}/{stated.name}", "intrinsics")
        return camera.resized(width, height), stated.findings
    found = camera_of(photos.exif, full_width, full_height)
    if found is None:
        names = [path.name for path in files.texts]
        raise CaptureError(
            "no intrinsics: no file with them, and EXIF does not say the focal length",
            source=str(folder),
            seen=f"none in {listed(names)}" if names else "",
            needed=FORMATS,
            remedy=f"write {MATRIX} into intrinsics.txt",
        )
    camera, why = found
    rough = roughness_of(photos.exif, full_width, full_height)
    cut = ", as the photographs look cut out of larger ones" if rough > ROUGHNESS else ""
    message = (
        f"focal length {camera.fx:.0f} px from {why} in EXIF, the principal point taken for the "
        f"middle: about {rough:.0%} uncertain{cut}; depth stays metric, but widths across "
        "the image and slopes are wrong by as much, and so are normals and the relief"
    )
    stems = (named_intrinsics, names_lens)
    if misread := [p.name for p in files.texts if any(named(p.stem) for named in stems)]:
        message += f"; no intrinsics were found in {listed(misread)}"
    remedy = "calibrate the camera and put its intrinsics beside the photographs"
    return camera.resized(width, height), (Finding("warning", EXIF_FOCAL, message, remedy),)


def _depth_place(
    folder: Path, files: LooseFiles, camera: Camera, depth_m: Floats
) -> tuple[Camera | None, RigidTransform | None, tuple[Finding, ...]]:
    """depth_camera and depth_to_color: as a file states them, else those of the same view.

    None where the depth (K, h, w) has the photographs' field of view and its sides divide theirs by
    an integer, and where the proportions are others: that is refused elsewhere.  Raises
    CaptureError where a file that would say more of them is not used.
    """
    h, w = depth_m.shape[1:]
    measured = np.asarray(np.isfinite(depth_m).any(axis=0))
    raw = files.depth[0].kind == "z16"
    stated = stated_depth_camera(folder, files.texts, camera, (h, w), measured, raw=raw)
    if stated.camera is not None:
        return stated.camera, stated.to_color, stated.findings
    factor = max(camera.width // w, 1)
    if (h * factor, w * factor) == camera.shape:
        return None, None, stated.findings
    if abs((camera.width / camera.height) / (w / h) - 1) > _SAME_PROPORTIONS:
        if stated.findings:
            raise CaptureError(
                "depth of other proportions than the photographs",
                source=str(folder),
                seen=f"{w}x{h}; {stated.findings[0].message}",
                needed="the depth camera's intrinsics for this size",
                remedy="correct that file, or write [depth_intrinsics] into a capture.toml",
            )
        return None, None, ()
    message = (
        f"depth {w}x{h} is taken to show the field of view of the photographs "
        f"({camera.width}x{camera.height}), {camera.width / w:.3g} pixels to one"
    )
    findings = (Finding("note", "same-view", message), *stated.findings)
    return camera.resized(w, h), None, findings


def _unused(files: LooseFiles, lights: GivenLights | None) -> tuple[Finding, ...]:
    found: list[Finding] = []
    arrays = (Path(name) for name in files.unused if name.lower().endswith(".npy"))
    of_lights = [p.name for p in (*files.texts, *arrays) if "light" in p.stem.lower()]
    if lights is None and of_lights:
        message = f"not read: {listed(of_lights)}; the lights are estimated"
        remedy = "name the directions light_directions.txt, x y z in each line, or write a .lp file"
        found.append(Finding("warning", "ignored-files", message, remedy))
    if files.unused:
        message = f"left out beside what is read: {listed(files.unused)}"
        found.append(Finding("note", "ignored-files", message))
    if files.unread:
        found.append(unread_finding(files.unread))
    return tuple(found)


READER = Reader(
    "photographs",
    "a folder: JPEG, PNG, TIFF, HEIC, EXR or raw photographs, depth, intrinsics or EXIF",
    sniff,
    read,
    "photos",
)

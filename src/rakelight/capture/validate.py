"""Whether a capture makes sense: each check raises CaptureError or returns what it noticed.

`source` is the file that a message is about, as the user would write it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NoReturn

import numpy as np

from rakelight.capture.headers import Header
from rakelight.capture.one_scene import check_one_scene
from rakelight.capture.white_level import narrow_range
from rakelight.errors import CaptureError, listed
from rakelight.geometry.distortion import corner_px, corner_stretch, fold_px
from rakelight.model import (
    BLACK,
    SATURATED,
    Array,
    Camera,
    Finding,
    Floats,
    Mask,
    RigidTransform,
    SensorNoise,
    finite_number,
)
from rakelight.prepare.sensor import SensorGrid

NEEDED_PHOTOGRAPHS = 3  # an albedo and a normal are three unknowns per pixel
MOST_UNUSABLE = 0.20  # of the object
LEAST_MEASURED = 0.01  # of the object
PLAUSIBLE_M = (0.05, 20.0)
# Values per metre: millimetres, TUM, 0.1 mm, L515, metres
COMMON_DEPTH_SCALES = (1000.0, 5000.0, 10000.0, 4000.0, 1.0)
LONGEST_BASELINE_M = 1.0
# Principal point's distance from the middle over the image's side: lenses have up to 0.06,
# intrinsics of half the size 0.25.
FARTHEST_OFF_CENTRE = 0.15
# How many times as far out as without it a lens shows the image's corners: pincushion distortion
# takes them out by 15 % at most, barrel distortion, fisheyes' too, takes them in.
MOST_STRETCHED = 1.4
# Of a mask: how much of the object a soft edge takes (that of one pixel takes 3 % of an object 80
# pixels wide), and the levels of grey that it has, more than labels.
_SOFT_SHARE, _SOFT_LEVELS = 0.05, 8
_WHITE_8_BIT = 255
# Share of the object that is printed as 0.0 %, below it.
_SAID_TO_BE_NONE = 0.0005
# Standard deviation over depth: of the finest scanners, which are said to be right to a micrometre
# at a metre, and of depth that says nothing of a shape.
QUIETEST, NOISIEST = 1e-6, 0.2
STEEPEST_GROWTH = 4.0
# Ratio of the largest to the smallest intensity or exposure, beyond which one of them is a mistake.
LARGEST_RATIO = 1e4
# Exposures, in whatever unit, that cameras can have.
POSSIBLE_EXPOSURES = (1e-12, 1e12)
# Depth that any sensor could mean, metres; the least still has an inverse square.
POSSIBLE_M = (1e-4, 1e6)
# Why a depth value is none, in the order of the codes that the reader gives.
HOLES = (
    "measured", "zero", "negative", "at the largest value", "not finite",
    f"beyond {PLAUSIBLE_M[1]:g} m", "at one far value", f"nearer than {POSSIBLE_M[0]:g} m",
)  # fmt: skip


def check_word(name: str, value: Any, known: Sequence[str]) -> None:
    """Raise CaptureError unless the argument `name` is one of the known words."""
    if not isinstance(value, str) or value not in known:
        raise CaptureError(
            f"an unknown {name}",
            source=name,
            seen=str(value)[:80],
            needed=", ".join(known),
            remedy=f'{name}="{known[0]}", say',
        )


def check_same_kind(headers: Mapping[str, Header], source: str) -> None:
    """All images of a folder (name -> header) have one size, depth and number of channels.

    >>> check_same_kind({"0.png": Header("PNG", 4, 3, 3, "uint8"),
    ...                  "1.png": Header("PNG", 8, 6, 3, "uint8")}, "rgb")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: rgb: images of different kinds (seen 0.png 4x3x3 uint8;
    1.png 8x6x3 uint8, needed one size, depth and number of channels). Fix: ...
    """
    kinds: dict[str, list[str]] = {}
    for name, header in headers.items():
        kinds.setdefault(str(header), []).append(name)
    if len(kinds) == 1:
        return
    rows = [
        f"{names[0]} {kind}" + (f" and {len(names) - 1} more" if len(names) > 1 else "")
        for kind, names in kinds.items()
    ]
    dtypes = {header.dtype for header in headers.values()}
    raise CaptureError(
        "8-bit images beside 16-bit ones"
        if dtypes == {"uint8", "uint16"}
        else "images of different kinds",
        source=source,
        seen="; ".join(rows[:8]) + ("; …" if len(rows) > 8 else ""),
        needed="one size, depth and number of channels",
        remedy="export all of them in the same way, or leave out the odd ones",
    )


def check_camera(
    camera: Camera, shape: tuple[int, int], source: str, table: str, *, of_depth: bool = False
) -> None:
    """The intrinsics in `table` of capture.toml are plausible for images (height, width).

    of_depth : whether they are a depth camera's, whose lens may fold where no depth is:
        `check_depth_lens` says whether it does

    >>> swapped = Camera(640, 480, 319.5, 239.5, 525.0, 525.0)
    >>> check_camera(swapped, (480, 640), "capture.toml", "intrinsics")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: capture.toml: the principal point of [intrinsics] lies outside
    the image (...). Fix: fx, fy and cx, cy look exchanged: ...
    """
    lengths = {key: getattr(camera, key) for key in ("fx", "fy", "cx", "cy")}
    for key, value in lengths.items():
        if not np.isfinite(value):
            raise CaptureError(
                f"key '{table}.{key}' is not a number",
                source=source,
                seen=str(value),
                needed="pixels",
                remedy="calibrate the camera, or take them from its maker",
            )
    for key in ("width", "height", "fx", "fy"):
        if getattr(camera, key) <= 0:
            raise CaptureError(
                f"key '{table}.{key}' is not positive",
                source=source,
                seen=f"{getattr(camera, key):g}",
                needed="pixels",
                remedy="calibrate the camera, or take them from its maker",
            )
    _check_camera_size(camera, shape, source, table)
    _check_field_of_view(camera, source, table)
    check_principal_point(camera, source, f"the principal point of [{table}]")
    check_distortion(camera, source, f"key '{table}.distortion'", folds=not of_depth)


def check_distortion(
    camera: Camera, source: str, name: str, measured: Mask | None = None, *, folds: bool = True
) -> None:
    """The lens model, which messages call `name`, is one that a lens can have.

    It does not fold inside the image, nor stretch it like no lens.

    measured : (h, w) where a depth camera has depth, and its lens may not fold: outside the round
        field of view of a wide one there is none.  Everywhere when None.
    folds : whether to look for a fold, at all

    >>> from rakelight.model import Distortion
    >>> lens = Distortion("brown-conrady", (-0.5, 0.0, 0.0, 0.0))
    >>> check_distortion(Camera(400, 300, 200, 200, 199.5, 149.5, lens), "camera", "distortion")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: camera: distortion folds inside the image (seen 109 pixels from
    the principal point, needed beyond the corners, 250 pixels from it). Fix: ...
    """
    remedy = (
        "calibrate with fewer coefficients, or with points as far as the corners; look for "
        "exchanged coefficients and signs"
    )
    stretch = corner_stretch(camera)
    if stretch > MOST_STRETCHED:
        raise CaptureError(
            f"{name} is that of no lens",
            source=source,
            seen=f"the corners {stretch:.3g} times as far out as without it",
            needed=f"at most {MOST_STRETCHED:g} times",
            remedy=remedy,
        )
    folds_px = fold_px(camera, measured) if folds else None
    if folds_px is None:
        return
    needed = f"beyond the corners, {np.hypot(*corner_px(camera)):.0f} pixels from it"
    if measured is not None:
        v, u = np.nonzero(measured)
        reach_px = np.hypot(u - camera.cx, v - camera.cy).max()
        needed = f"beyond all depth, which reaches {reach_px:.0f} pixels from it"
    raise CaptureError(
        f"{name} folds inside the image",
        source=source,
        seen=f"{folds_px:.0f} pixels from the principal point",
        needed=needed,
        remedy=remedy,
    )


def check_depth_lens(camera: Camera, depth_m: Floats, source: str, name: str) -> None:
    """`check_distortion` of a depth camera, by where its maps (K, h, w) measure something."""
    measured = np.asarray(np.isfinite(depth_m).any(axis=0))
    check_distortion(camera, source, name, measured)


def _check_field_of_view(camera: Camera, source: str, table: str) -> None:
    widest, narrowest = 0.2, 50.0  # focal length over image side: 136 and 1 degrees
    for key, length, side in (("fx", camera.fx, camera.width), ("fy", camera.fy, camera.height)):
        if not widest <= length / side <= narrowest:
            raise CaptureError(
                f"key '{table}.{key}' is implausible",
                source=source,
                seen=f"{length:g} for an image of {camera.width}x{camera.height}",
                needed="the focal length in pixels",
                remedy="not in millimetres, and not as a fraction of the image",
            )
    if not 0.5 <= camera.fx / camera.fy <= 2:
        raise CaptureError(
            f"fx and fy of [{table}] do not fit together",
            source=source,
            seen=f"fx = {camera.fx:g}, fy = {camera.fy:g}",
            needed="nearly the same value",
            remedy="look for a mistyped or exchanged value",
        )


def check_principal_point(camera: Camera, source: str, name: str = "the principal point") -> None:
    """The principal point, which messages call `name`, lies in the image, and not turned.

    >>> check_principal_point(Camera(220, 170, 1680.0, 1580.0, 405.0, 362.0), "camera")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: camera: the principal point lies outside the image (seen
    cx = 405, cy = 362 in 220x170, needed a point near the centre). Fix: give cx and cy in ...
    """

    def inside(u: float, v: float) -> bool:
        return 0 <= u <= camera.width - 1 and 0 <= v <= camera.height - 1

    def central(u: float, v: float) -> bool:
        near = 0.02 * max(camera.width, camera.height)
        off = abs(u - (camera.width - 1) / 2), abs(v - (camera.height - 1) / 2)
        return max(off) <= near

    exchanged = central(camera.cy, camera.cx) and not central(camera.cx, camera.cy)
    if inside(camera.cx, camera.cy) and not exchanged:
        return
    if exchanged:
        what = "looks transposed"
        remedy = f"exchange cx and cy where they were mixed up; {_unturned(camera, camera.shape)}"
    elif inside(camera.fx, camera.fy):
        what = "lies outside the image"
        remedy = "fx, fy and cx, cy look exchanged: give them the other way round"
    else:
        what = "lies outside the image"
        remedy = "give cx and cy in pixels of this image size"
    raise CaptureError(
        f"{name} {what}",
        source=source,
        seen=f"cx = {camera.cx:g}, cy = {camera.cy:g} in {camera.width}x{camera.height}",
        needed="a point near the centre",
        remedy=remedy,
    )


def _unturned(camera: Camera, shape: tuple[int, int]) -> str:
    """What to do where the camera is that of images turned by a quarter, not as stored (h, w).

    >>> _unturned(Camera(480, 640, 500.0, 510.0, 230.0, 320.0), (480, 640))
    'where it was calibrated with images that a viewer turned: fx = 510, fy = 500, and cx = 320,
    cy = 249 if it turned them clockwise (orientation 6 in EXIF), else cx = 319, cy = 230'
    """
    when = "where it was calibrated with images that a viewer turned: "
    lens = camera.distortion
    if lens is not None and lens.model != "kannala-brandt" and any(lens.coefficients[2:4]):
        return f"{when}calibrate with them as they are stored"
    height, width = shape
    return (
        f"{when}fx = {camera.fy:g}, fy = {camera.fx:g}, and cx = {camera.cy:g}, "
        f"cy = {height - 1 - camera.cx:g} if it turned them clockwise (orientation 6 in EXIF), "
        f"else cx = {width - 1 - camera.cy:g}, cy = {camera.cx:g}"
    )


def principal_point_finding(camera: Camera) -> tuple[Finding, ...]:
    """A warning where the principal point is farther from the middle than lenses put it.

    >>> principal_point_finding(Camera(220, 170, 210.0, 198.0, 50.0, 45.0))[0].code
    'off-centre'
    """
    off = max(
        abs(centre - (side - 1) / 2) / side
        for side, centre in ((camera.width, camera.cx), (camera.height, camera.cy))
    )
    if off <= FARTHEST_OFF_CENTRE:
        return ()
    message = (
        f"the principal point ({camera.cx:.4g}, {camera.cy:.4g}) is {off:.0%} of a side off the "
        f"middle of the {camera.width}x{camera.height} image: is the calibration of this size?"
    )
    remedy = "take that of this image size, or scale it; where the image was cut out, all is well"
    return (Finding("warning", "off-centre", message, remedy),)


def _check_camera_size(camera: Camera, shape: tuple[int, int], source: str, table: str) -> None:
    """The intrinsics belong to images of (height, width) = `shape`.

    >>> _check_camera_size(Camera(640, 480, 500.0, 500.0, 319.5, 239.5), (960, 1280),
    ...                   "capture.toml", "intrinsics")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: capture.toml: [intrinsics] is for another image size
    (seen 640x480, needed 1280x960). Fix: if the images were only resized: width = 1280,
    height = 960, fx = 1000, fy = 1000, cx = 639.5, cy = 479.5
    """
    if camera.shape == shape:
        return
    height, width = shape
    factor = width / camera.width
    if (height, width) == (camera.width, camera.height):
        remedy = "width and height are exchanged, or the images were turned; "
        remedy += _unturned(camera, shape)
    elif round(camera.height * factor) == height:
        fit = camera.scaled(factor)
        remedy = (
            f"if the images were only resized: width = {width}, height = {height}, "
            f"fx = {fit.fx:g}, fy = {fit.fy:g}, cx = {fit.cx:g}, cy = {fit.cy:g}"
        )
    else:
        remedy = "the sides have other proportions: calibrate at this image size"
    raise CaptureError(
        f"[{table}] is for another image size",
        source=source,
        seen=f"{camera.width}x{camera.height}",
        needed=f"{width}x{height}",
        remedy=remedy,
    )


def check_transform(transform: RigidTransform, source: str) -> None:
    """[depth_to_color] is a rotation and a short translation in metres."""
    rotation, translation_m = transform.rotation, transform.translation_m
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs(rotation @ rotation.T - np.eye(3)).max()
        determinant = np.linalg.det(rotation)
        baseline_m = float(np.linalg.norm(translation_m))
    if not off <= 1e-3 or determinant < 0:
        raise CaptureError(
            "key 'depth_to_color.rotation' is not a rotation",
            source=source,
            seen=f"R Rᵀ differs from the identity by {off:.2g}, determinant {determinant:.2g}",
            needed="three orthonormal rows, determinant 1",
            remedy="give the rotation from the depth camera to the colour camera, rows first",
        )
    if baseline_m > LONGEST_BASELINE_M:
        raise CaptureError(
            "key 'depth_to_color.translation' is implausibly long",
            source=source,
            seen=f"{baseline_m:g} m",
            needed=f"at most {LONGEST_BASELINE_M:g} m",
            remedy="give it in metres, not millimetres",
        )


def check_exposures(exposures: tuple[float, ...], count: int, source: str, key: str = "") -> None:
    """Exposures are numbers that cameras can have, none or one for each of `count` photographs.

    key : of a file, that the message names

    >>> check_exposures((1.0, 2.0), 3, "exposures")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: exposures: no exposure for each photograph (seen 2, needed 3).
    Fix: give that of each photograph, or none at all
    """
    of = f"key {key!r}: " if key else ""
    numbers = isinstance(exposures, tuple) and all(
        finite_number(each) and float(each) > 0 for each in exposures
    )
    if not numbers:
        raise CaptureError(
            f"{of}no exposures",
            source=source,
            seen=str(exposures)[:80],
            needed="numbers above 0, as a tuple",
            remedy="give seconds * ISO / f-number^2 of each photograph, or leave them away",
        )
    if len(exposures) not in (0, count):
        raise CaptureError(
            f"{of}no exposure for each photograph",
            source=source,
            seen=str(len(exposures)),
            needed=str(count),
            remedy="give that of each photograph, or none at all",
        )
    if not exposures:
        return
    shortest, longest = min(map(float, exposures)), max(map(float, exposures))
    least, most = POSSIBLE_EXPOSURES
    if longest > LARGEST_RATIO * shortest or shortest < least or longest > most:
        raise CaptureError(
            f"{of}implausible exposures",
            source=source,
            seen=f"{shortest:.3g} to {longest:.3g}",
            needed=f"{least:g} to {most:g}, all within a factor of {LARGEST_RATIO:g}",
            remedy="give seconds * ISO / f-number^2 of each photograph, or leave them away",
        )


def check_noise(noise: SensorNoise, source: str) -> None:
    """[depth_noise] is that of a depth sensor.

    >>> check_noise(SensorNoise(sigma_m=1.4), "capture.toml")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: capture.toml: key 'depth_noise.sigma_m' is implausible
    (seen 1.4 m at 1 m, needed 1e-06 to 0.2 of at_m). Fix: give it in metres, not millimetres
    """
    for key, least in (("sigma_m", 0.0), ("at_m", 0.0), ("growth", -np.inf)):
        value = getattr(noise, key)
        if not (np.isfinite(value) and value > least):
            raise CaptureError(
                f"key 'depth_noise.{key}' is not "
                + ("positive" if np.isfinite(value) else "a number"),
                source=source,
                seen=f"{value:g}",
                needed="metres" if key != "growth" else "a power of the depth, 2 for most sensors",
                remedy="take it from the sensor's data sheet, or leave the table away",
            )
    if not PLAUSIBLE_M[0] <= noise.at_m <= PLAUSIBLE_M[1]:
        raise CaptureError(
            "key 'depth_noise.at_m' is implausible",
            source=source,
            seen=f"{noise.at_m:g} m",
            needed=f"{PLAUSIBLE_M[0]:g} to {PLAUSIBLE_M[1]:g} m",
            remedy="give it in metres, and sigma_m too",
        )
    share = noise.sigma_m / noise.at_m
    if not QUIETEST <= share <= NOISIEST:
        raise CaptureError(
            "key 'depth_noise.sigma_m' is implausible",
            source=source,
            seen=f"{noise.sigma_m:g} m at {noise.at_m:g} m",
            needed=f"{QUIETEST:g} to {NOISIEST:g} of at_m",
            remedy="give it in metres, not millimetres"
            if share > NOISIEST
            else "give it in metres, or leave the table away",
        )
    if not 0 <= noise.growth <= STEEPEST_GROWTH:
        raise CaptureError(
            "key 'depth_noise.growth' is implausible",
            source=source,
            seen=f"{noise.growth:g}",
            needed=f"0 to {STEEPEST_GROWTH:g}",
            remedy="2 for stereo and structured light, 1 for time of flight",
        )


def check_not_twice(photographs: Array, names: Sequence[str], source: str) -> None:
    """No two photographs (N, H, W, 3) have the same pixels.

    >>> check_not_twice(np.zeros((2, 6, 8, 3), np.uint8), ("0.png", "1.png"), "rgb")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: rgb: photographs that are all black (seen 0.png, 1.png, needed
    light in each). Fix: ...
    """
    alike: dict[bytes, list[int]] = {}
    for i, photograph in enumerate(photographs):
        few = photograph[::16, ::16].tobytes()
        for other in alike.setdefault(few, []):
            if np.array_equal(photographs[other], photograph):
                _refuse_alike(photographs, names, source, other, i)
        alike[few].append(i)


def _refuse_alike(
    photographs: Array, names: Sequence[str], source: str, first: int, second: int
) -> NoReturn:
    """Raise the error for two photographs (indices from 0) with the same pixels."""
    if not photographs[first].any():
        raise CaptureError(
            "photographs that are all black",
            source=source,
            seen=listed(names, [not photograph.any() for photograph in photographs]),
            needed="light in each",
            remedy="remove them, or take them again with the lamp on",
        )
    one_name = names[first] == names[second]
    raise CaptureError(
        "the same photograph twice",
        source=source,
        seen=f"{names[first]} at {first} and {second}, counted from 0"
        if one_name
        else f"{names[first]} and {names[second]}",
        needed="one photograph per light",
        remedy="select each photograph once" if one_name else f"remove {names[second]}",
    )


def exposure_shares(photographs: Array, mask: Mask) -> tuple[list[float], list[float], Array]:
    """Shares of the object, per photograph, with a saturated channel and black in all channels.

    photographs : (N, H, W, 3) as stored; mask : (H, W) True = object.  The third is (P,) how many
    photographs have a usable channel at each of the object's pixels.

    >>> photographs = np.array([[[[255, 9, 9], [0, 0, 0]]], [[[9, 9, 9], [9, 9, 9]]]], np.uint8)
    >>> saturated, black, usable = exposure_shares(photographs, np.ones((1, 2), bool))
    >>> saturated, black, usable.tolist()
    ([0.5, 0.0], [0.5, 0.0], [2, 1])
    """
    white = np.iinfo(photographs.dtype).max
    inside = np.flatnonzero(mask)
    usable = np.zeros(len(inside), np.intp)
    saturated, black = [], []
    for photograph in photographs:
        r, g, b = photograph.reshape(-1, 3).take(inside, axis=0).T
        brightest = np.maximum(np.maximum(r, g), b)
        too_dark = brightest <= BLACK * white
        # Where one channel clips, the others still say how bright the light was.
        usable_channels = [(v > BLACK * white) & (v < SATURATED * white) for v in (r, g, b)]
        usable += usable_channels[0] | usable_channels[1] | usable_channels[2]
        saturated.append(float((brightest >= SATURATED * white).mean()))
        black.append(float(too_dark.mean()))
    return saturated, black, usable


def check_exposure(
    photographs: Array, mask: Mask, names: Sequence[str], source: str, ambient: str = ""
) -> tuple[Finding, ...]:
    """Enough of the object is neither saturated nor black in enough photographs.

    photographs : (N, H, W, 3) as stored; mask : (H, W) True = object
    ambient : the picture that was subtracted from them; empty for none

    With three photographs or more, raises CaptureError when more than 20 % of the object has
    fewer than three that a channel is usable of.  The notes count pixels with a saturated channel,
    and pixels black in all.
    """
    saturated, black, usable = exposure_shares(photographs, mask)
    if len(photographs) >= NEEDED_PHOTOGRAPHS:
        unusable = float((usable < NEEDED_PHOTOGRAPHS).mean())
        if unusable > MOST_UNUSABLE:
            brighter = float(np.mean(black)) > float(np.mean(saturated))
            raise CaptureError(
                f"fewer than {NEEDED_PHOTOGRAPHS} usable photographs on {unusable:.0%} of the "
                "object",
                source=source,
                seen=f"{np.mean(saturated):.0%} saturated and {np.mean(black):.0%} black "
                "per photograph" + (f", after {ambient} was subtracted" if ambient else ""),
                needed=f"at most {MOST_UNUSABLE:.0%}",
                remedy=_brighter_remedy(photographs, ambient)
                if brighter
                else "expose shorter or move the lamp away",
            )
    exposed = tuple(
        Finding(
            "note",
            code,
            f"{code}: {np.mean(shares):.1%} of the object on average, "
            f"most in {names[int(np.argmax(shares))]} ({max(shares):.1%}); "
            "such values are left out",
            remedy,
        )
        for code, shares, remedy in (
            ("saturated", saturated, "expose shorter or move the lamp away"),
            ("black", black, _brighter_remedy(photographs)),
        )
        if max(shares) >= 0.001
    )
    return narrow_range(photographs) + exposed


def _brighter_remedy(photographs: Array, ambient: str = "") -> str:
    """What to do about photographs that are black, from which the picture `ambient` is taken."""
    if ambient:
        return f"take {ambient} with the lamp off, or leave it away; else expose longer"
    top = int(photographs.max(initial=0))
    if photographs.dtype == np.uint16 and top <= _WHITE_8_BIT:
        return (
            f"their values go up to {top} of 65535: where they are of 8 bit, save them as 8 bit "
            "or multiply them by 257; else expose longer"
        )
    return "expose longer or move the lamp closer"


def check_mask_size(mask_shape: tuple[int, int], shape: tuple[int, int], source: str) -> None:
    """The mask has the photographs' (height, width)."""
    if mask_shape != shape:
        raise CaptureError(
            "the mask has another size than the photographs",
            source=source,
            seen=f"{mask_shape[1]}x{mask_shape[0]}",
            needed=f"{shape[1]}x{shape[0]}",
            remedy="draw it on a photograph",
        )


def check_mask(mask: Mask, source: str) -> tuple[Finding, ...]:
    """The mask marks something."""
    if not mask.any():
        raise CaptureError(
            "the mask is empty",
            source=source,
            seen="only zeros",
            needed="non-zero = object",
            remedy="mark the object in it, or leave it away: the nearest object is then cut out",
        )
    if mask.all():
        return (
            Finding(
                "note",
                "mask-everything",
                "the mask covers the whole image",
                "mark the object only: background costs time and misleads the lights",
            ),
        )
    return ()


def soft_mask_findings(values: Array, mask: Mask, source: str) -> tuple[Finding, ...]:
    """A warning where much of the object is of a mask's weak values: a soft edge, JPEG's noise.

    values : (H, W) as stored; white is the largest of 8 or 16 bit, of other types the largest there
        is
    mask : (H, W) True where they are not zero
    Labels, which have few values, are no soft edge.

    >>> edge = np.arange(0, 250, 10, dtype=np.uint8)[None]
    >>> soft_mask_findings(edge, edge > 0, "mask.png")[0].code
    'mask-soft'
    """
    if values.dtype == bool:
        return ()
    top = float(values.max(initial=0))
    white = np.iinfo(values.dtype).max if values.dtype in (np.uint8, np.uint16) else top
    weak = mask & (values < top / 2)
    share = weak.sum() / max(int(mask.sum()), 1)
    if 2 * top < white or share < _SOFT_SHARE:
        return ()
    if len(np.unique(values[weak])) < _SOFT_LEVELS:
        return ()
    message = (
        f"{source}: {share:.0%} of the object are values below half of white, as of a soft edge"
    )
    remedy = "make it black and white, with a threshold at half: all that is not 0 counts as object"
    return (Finding("warning", "mask-soft", message, remedy),)


def depth_factor(
    depth_shape: tuple[int, int], colour_shape: tuple[int, int], depth_source: str
) -> float:
    """How many colour pixels one depth pixel has along each side, the geometric mean of both.

    Raises CaptureError for depth maps of other proportions than the photographs', or larger.

    >>> depth_factor((192, 256), (3024, 4032), "depth")
    15.75
    >>> depth_factor((188, 250), (750, 1000), "depth") < 4
    True
    """
    (h, w), (height, width) = depth_shape, colour_shape
    grid = SensorGrid(depth_shape, colour_shape)
    if grid.fits:
        return grid.factor
    turned = SensorGrid((w, h), colour_shape).fits
    raise CaptureError(
        "depth and colour are turned against each other"
        if turned
        else "depth and colour sizes do not fit",
        source=depth_source,
        seen=f"depth {w}x{h}, colour {width}x{height}",
        needed="depth of the colour images' proportions, to half a pixel, and no larger",
        remedy=("turn one of them by 90 degrees; " if turned else "")
        + "if they are two cameras, give the depth camera ([depth_intrinsics] in "
        "capture.toml, depth_camera= with arrays), or export the depth aligned to the colour",
    )


def check_depth(
    depth_m: Floats,
    holes: Array,
    on_object: Mask | None,
    source: str,
    depth_scale: float | None,
    names: Sequence[str] = (),
) -> tuple[Finding, ...]:
    """Enough of the object is measured, alike in all maps, at a plausible distance.

    depth_m : (K, h, w) metres, NaN = no measurement
    holes : (K, h, w) uint8, indices into HOLES
    on_object : (h, w) True where a depth pixel sees the object; None where that is not known yet,
        because the depth is another camera's
    depth_scale : of capture.toml, None when the files hold metres
    names : of the maps, numbers from 0 when empty
    """
    everywhere = np.ones(depth_m.shape[1:], bool)
    looked_at = everywhere if on_object is None else on_object
    on_maps = depth_m[:, looked_at]
    counts = np.bincount(holes[:, looked_at].ravel(), minlength=len(HOLES))
    reasons = ", ".join(
        f"{count} {hole}" for hole, count in zip(HOLES[1:], counts[1:], strict=True) if count
    )
    share = float(np.isfinite(on_maps).any(axis=0).mean())
    if share < LEAST_MEASURED:
        raise CaptureError(
            "almost no depth on the object",
            source=source,
            seen=f"{share:.2%} measured; of all values {reasons}",
            needed=f"at least {LEAST_MEASURED:.0%}",
            remedy="check that depth and mask belong together and the object is in range",
        )
    _refuse_other_units(holes[:, looked_at], source, names)
    check_one_scene(depth_m, looked_at, source, names)
    median_m = float(np.median(on_maps[np.isfinite(on_maps)]))
    if not PLAUSIBLE_M[0] <= median_m <= PLAUSIBLE_M[1]:
        raise CaptureError(
            "the depth unit looks wrong",
            source=source,
            seen=f"median depth {median_m:.3g} m",
            needed=f"{PLAUSIBLE_M[0]:g} to {PLAUSIBLE_M[1]:g} m",
            remedy=_unit_remedy(median_m, depth_scale),
        )
    findings = [Finding("note", "median-depth", f"median depth {median_m:.2f} m")]
    if reasons and on_object is not None and 1 - share >= _SAID_TO_BE_NONE:
        count = len(depth_m)
        where, whose = (f" in all {count} maps", " of single maps") if count > 1 else ("", "")
        message = (
            f"{1 - share:.1%} of the object is without depth{where} (values{whose}: {reasons})"
        )
        findings.append(Finding("note", "depth-missing", message))
    return tuple(findings)


def _refuse_other_units(on_maps: Array, source: str, names: Sequence[str]) -> None:
    """Raise CaptureError where some of several maps hold values that are no distances.

    That is where next to nothing of the object is measured, and most is too far or too near.

    on_maps : (K, P) indices into `HOLES` of the object's P pixels
    """
    no_distance = [HOLES.index(each) for each in HOLES if each.startswith(("beyond", "nearer"))]
    measured = (on_maps == HOLES.index("measured")).mean(axis=1)
    off = np.isin(on_maps, no_distance).mean(axis=1)
    wrong = ((measured < LEAST_MEASURED) & (off > 0.5)).tolist()
    if any(wrong) and not all(wrong):
        named = listed(names or [f"map {k}" for k in range(len(wrong))], wrong)
        raise CaptureError(
            "depth maps that contradict each other",
            source=source,
            seen=f"no distance from {POSSIBLE_M[0]:g} to {PLAUSIBLE_M[1]:g} m in {named}",
            needed="repeats of one view, in one unit",
            remedy=f"remove {named}, or give all maps in one unit",
        )


def plausible_scales(median_value: float, also: Iterable[float] = ()) -> str:
    """The depth scales that would make a median depth value plausible, with what they give.

    >>> plausible_scales(620.0)
    'depth_scale = 1000 would make the median 0.62 m, 5000 0.124 m, 4000 0.155 m'
    """
    # Narrower than what is accepted: an object that fills the image of a depth camera.
    nearest_m, farthest_m = 0.1, 10.0
    scales = [
        scale
        for scale in dict.fromkeys((*also, *COMMON_DEPTH_SCALES))
        if nearest_m <= median_value / scale <= farthest_m
    ]
    if not scales:
        return "find the number of depth values per metre in the sensor's documentation"
    first, *others = (f"{scale:.6g} {median_value / scale:.3g} m" for scale in scales)
    scale, metres = first.split(" ", 1)
    return ", ".join((f"depth_scale = {scale} would make the median {metres}", *others))


def _unit_remedy(median_m: float, depth_scale: float | None) -> str:
    if depth_scale is not None:
        # Somebody may have given metres per value instead.
        return plausible_scales(median_m * depth_scale, also=(1 / depth_scale,))
    fits = [
        f"by {scale} if they are {unit} ({median_m / scale:.3g} m)"
        for unit, scale in (("millimetres", 1000), ("centimetres", 100))
        if PLAUSIBLE_M[0] <= median_m / scale <= PLAUSIBLE_M[1]
    ]
    return (
        "divide the values " + ", ".join(fits) if fits else "float depth is in metres: convert it"
    )

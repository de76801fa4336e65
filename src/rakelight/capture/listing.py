"""The image files of a capture folder: found, looked at, not decoded yet."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rakelight.capture.headers import Header, read_header
from rakelight.capture.images import as_rgb, decode_image, decode_opacity
from rakelight.capture.tone_curve import read_photograph_header
from rakelight.capture.validate import check_mask_size, check_same_kind, soft_mask_findings
from rakelight.errors import CaptureError, InputError, listed, printable
from rakelight.files import clear_errors, in_threads, read_bytes
from rakelight.model import Array, Finding, Mask
from rakelight.scratch import large_empty, release

SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg")
# Images that a capture folder does not hold, and the raw files of makers that no reader reads.
UNREAD = {
    ".bmp", ".gif", ".pgm", ".ppm", ".webp", ".avif", ".heic", ".jp2", ".exr", ".hdr",
    ".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf", ".rw2", ".pef", ".srw",
}  # fmt: skip
# What may be meant for a mask, for lights, confidence, ambient light or a white card, by names.
_MEANT = re.compile(
    r"(?<![a-z])(masks?|conf(idence)?|ambient|flat)(?![a-z])[^.]*(\.(png|jpe?g|tiff?|bmp|gif|psd|xcf|npy))?$"
    r"|\.lp$|light\w*\.(txt|csv|json)$",
    re.IGNORECASE,
)


def numbered(index: int, suffix: str = ".png") -> str:
    """The name of an image file in the capture folders that are written; index from 0.

    >>> numbered(0), numbered(12, ".tiff")
    ('000.png', '012.tiff')
    """
    return f"{index:03d}{suffix}"


def inside(root: Path, name: str) -> Path:
    """The path of the file `name` in the folder `root`.

    Raises CaptureError for one that lies elsewhere: by "..", an absolute path, or a link.

    >>> inside(Path("recording"), "../secret")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: recording/../secret: a file outside the folder ...
    """
    path, source = root / name, f"{root}/{name}"
    with clear_errors(source, "cannot be read"):
        within = "\0" not in name and path.resolve().is_relative_to(root.resolve())
    if not within:
        raise CaptureError(
            "a file outside the folder",
            source=source,
            needed="files of the recording",
            remedy="copy the file into it",
        )
    return path


@dataclass(frozen=True)
class Root:
    """The capture folder, and how messages name the files in it."""

    path: Path

    def shown(self, name: str = "") -> str:
        """The folder, or a file in it, as the user would write it."""
        return f"{self.path}/{name}" if name else str(self.path)

    def names(self) -> list[str]:
        """Of all files and folders in it, sorted; raises CaptureError where it cannot be read."""
        with clear_errors(self.shown(), "cannot be read"):
            return sorted(path.name for path in self.path.iterdir())


@dataclass(frozen=True)
class Images:
    """The image files of one folder, all of one kind, not decoded yet."""

    folder: Path
    source: str
    names: tuple[str, ...]
    headers: tuple[Header, ...]
    ignored: tuple[str, ...]

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width) of every image."""
        return self.headers[0].height, self.headers[0].width

    @property
    def by_name(self) -> dict[str, Header]:
        """The header of every image."""
        return dict(zip(self.names, self.headers, strict=True))

    def chosen(self, numbers: Sequence[int]) -> Images:
        """Some of the images, by their numbers from 0; raises InputError for one that is not."""
        check_numbers(numbers, len(self.names))
        names, headers = zip(*((self.names[i], self.headers[i]) for i in numbers), strict=True)
        return replace(self, names=names, headers=headers)

    def read(self, index: int) -> Array:
        """The pixels of one image, as stored."""
        name = self.names[index]
        source = self.shown(name)
        return decode_image(read_bytes(self.folder / name, source=source), source)

    def shown(self, name: str) -> str:
        """One of the files, as the user would write it."""
        return f"{self.source}/{name}"


def check_numbers(numbers: Sequence[int], count: int, source: str = "photographs") -> None:
    """Raise InputError unless there are such photographs among `count`; `source` names them."""
    beyond = [number for number in numbers if not 0 <= number < count]
    if beyond or not numbers:
        raise InputError(
            "no such photographs",
            source=source,
            seen=f"number {beyond[0]}" if beyond else "none",
            needed=f"numbers from 0 to {count - 1}",
            remedy="count from 0, in the order of the names",
        )


def list_images(root: Root, name: str, what: str) -> Images:
    """The images in the subfolder `name`, in the order of the numbers in their names."""
    folder, source = root.path / name, root.shown(name)
    if not folder.is_dir():
        raise _no_folder(root, name, what)
    with clear_errors(source, "cannot be read"):
        present = sorted((p for p in folder.iterdir() if p.name[0] != "."), key=by_number)
    chosen = [p.name for p in present if p.suffix.lower() in SUFFIXES]
    ignored = tuple(p.name for p in present if p.name not in chosen)
    if not chosen:
        raise CaptureError(
            f"no {what} in it",
            source=source,
            seen=", ".join(ignored[:5]) or "an empty folder",
            needed="PNG or TIFF files",
            remedy="put them there, or convert what is there to PNG",
        )
    _refuse_same_stem(chosen, source)

    return looked_at(folder, source, chosen, ignored)


def _no_folder(root: Root, name: str, what: str) -> CaptureError:
    """The error for a folder that is not there, which may have another name or be a file."""
    names = root.names()
    if name in names:
        there = os.path.exists(root.path / name)  # noqa: PTH110 - a link may lead round in a loop
        return CaptureError(
            "not a folder",
            source=root.shown(name),
            seen="a file" if there else "a link to nothing",
            needed=f"the {what} as {name}/000.png, {name}/001.png, …",
            remedy=f"put it into a folder {name}, or move it away"
            if there
            else f"make it lead to the folder, or make a folder {name} in its place",
        )
    capital = next((each for each in names if each.lower() == name), None)
    return CaptureError(
        f"no folder {name} in it",
        source=root.shown(),
        seen=printable(listed([each for each in names if each.lower().startswith(name)])),
        needed=f"the {what} as {name}/000.png, {name}/001.png, …",
        remedy=f"rename {capital} to {name}" if capital else "put them there",
    )


def meant_otherwise(root: Root, read: Sequence[str], remedy: str) -> tuple[Finding, ...]:
    """A warning of what the folder holds of masks, lights and the like beside what is `read`."""
    names = root.names()
    copies = {Path(name).stem for name in read if name in names}
    others = [
        name
        for name in names
        if name not in read
        and not name.startswith(".")
        and Path(name).stem.lower() not in copies
        and _MEANT.search(name)
    ]
    if not others:
        return ()
    message = f"not read under these names: {printable(listed(others))}"
    return (Finding("warning", "ignored-files", message, remedy),)


def looked_at(folder: Path, source: str, names: Sequence[str], ignored: Sequence[str]) -> Images:
    """The files `names` of a folder, which messages call `source`, by their headers."""

    def header(name: str) -> Header:
        shown = f"{source}/{name}"
        return read_photograph_header(read_bytes(folder / name, source=shown), shown)

    headers = in_threads(header, names)
    return Images(folder, source, tuple(names), tuple(headers), tuple(ignored))


def refuse_misnamed(root: Root, names: Sequence[str]) -> None:
    """Raise CaptureError for an image in the folder that is one of `names` but for its format.

    Capitals do not count.  Where a file of the right name is there, the other is somebody's copy.
    """
    present = root.names()
    for name in names:
        stem, others = Path(name).stem, (*SUFFIXES, *UNREAD)
        meant = [
            each
            for each in present
            if Path(each).stem.lower() == stem and Path(each).suffix.lower() in others
        ]
        if meant and not os.path.lexists(root.path / name):
            raise CaptureError(
                "not read under this name", source=root.shown(printable(meant[0])), needed=name,
                remedy=f"save it as {name}, or move it away",
            )  # fmt: skip


def by_number(path: Path) -> tuple[tuple[int, str], ...]:
    """2.png before 10.png: digits compare as numbers, and before letters."""
    parts = re.split(r"([0-9]+)", path.name)
    return tuple((int(part), "") if part.isdecimal() else (-1, part) for part in parts)


def _refuse_same_stem(names: Sequence[str], source: str) -> None:
    stems: dict[str, str] = {}
    for name in names:
        other = stems.setdefault(Path(name).stem, name)
        if other != name:
            raise CaptureError(
                "the same image in two formats",
                source=source,
                seen=f"{other} and {name}",
                remedy="remove one of them",
            )


def allocate(shape: tuple[int, ...], dtype: str, source: str) -> Array:
    """An array to decode into; raises MachineError with its size where there is no room."""
    return large_empty(shape, dtype, source, "use fewer images")


def check_photograph_kind(rgb: Images) -> None:
    """Raise CaptureError unless all are of one size and kind, with 8 or 16 bit."""
    for name, header in rgb.by_name.items():
        if header.dtype not in ("uint8", "uint16"):
            raise CaptureError(
                "this kind of photograph is not read",
                source=rgb.shown(name),
                seen=header.dtype,
                needed="8 or 16 bit",
                remedy="export it as 16-bit PNG",
            )
    check_same_kind(rgb.by_name, rgb.source)


def read_photographs(rgb: Images) -> Array:
    """(N, H, W, 3), decoded straight into the one array."""
    photographs = allocate((len(rgb.names), *rgb.shape, 3), rgb.headers[0].dtype, rgb.source)

    def read(index: int) -> None:
        photographs[index] = as_rgb(rgb.read(index))
        release(photographs)

    in_threads(read, range(len(rgb.names)))
    return photographs


def read_mask(
    path: Path, source: str, shape: tuple[int, int], formats: tuple[str, ...]
) -> tuple[Mask, tuple[Finding, ...]]:
    """(H, W) True where any colour channel of a picture is not zero; its size is checked first.

    Of a picture that is transparent in parts, a cut-out, True where it is not transparent.
    The finding is of a soft edge.
    Raises CaptureError where it is not of `shape`, or of none of the `formats`.
    """
    data = read_bytes(path, source=source)
    header = read_header(data, source)
    check_mask_size((header.height, header.width), shape, source)
    if header.format not in formats:
        raise CaptureError(
            "this kind of mask is not read",
            source=source,
            seen=f"a {header.format}, by its bytes",
            needed=" or ".join(formats),
            remedy="export it as PNG",
        )
    opacity = decode_opacity(data, source)
    if opacity is not None:
        opaque = opacity != 0
        if opaque.any() and not opaque.all():
            return opaque, soft_mask_findings(opacity, opaque, source)
    colours = np.nan_to_num(as_rgb(decode_image(data, source)))
    red, green, blue = np.moveaxis(colours != 0, 2, 0)
    mask = np.asarray(red | green | blue)
    return mask, soft_mask_findings(colours.max(axis=2), mask, source)


def file_findings(images: Images) -> tuple[Finding, ...]:
    """What a person should know about the files of one folder."""
    kind = images.folder.name
    named = list(images.by_name.items())
    turned = [name for name, header in named if header.orientation != 1]
    jpegs = [name for name, header in named if header.format == "JPEG"]
    misnamed = [name for name, header in named if not _named_as(name, header)]
    channels = images.headers[0].channels
    findings = []
    if turned:
        findings.append(
            Finding(
                "warning",
                "exif-orientation",
                f"{kind}: EXIF orientation ignored in {listed(turned)}",
                "make sure that depth and photographs are the same way up",
            )
        )
    if jpegs:
        findings.append(
            Finding(
                "warning",
                "jpeg",
                f"{kind}: {listed(jpegs)} JPEG; its compression looks like relief",
                "use PNG or raw",
            )
        )
    if misnamed:
        findings.append(
            Finding("warning", "misnamed", f"{kind}: another format than named: {listed(misnamed)}")
        )
    if channels in (2, 4):
        findings.append(Finding("note", "alpha-dropped", f"{kind}: alpha channel dropped"))
    if kind == "rgb" and channels in (1, 2):
        findings.append(
            Finding("note", "grey", f"{kind}: grey photographs, repeated to three channels")
        )
    unread = [name for name in images.ignored if Path(name).suffix.lower() in UNREAD]
    if unread:
        findings.append(unread_finding(unread, f"{kind}: "))
    others = [name for name in images.ignored if name not in unread]
    if others:
        findings.append(
            Finding("note", "ignored-files", f"{kind}: not images, ignored: {listed(others)}")
        )
    return tuple(findings)


TO_PNG = "convert them to PNG"


def unread_finding(names: Sequence[str], where: str = "") -> Finding:
    """The warning that images are left out; `where` they lie, for the message."""
    message = f"{where}images of a format that is not read: {listed(names)}"
    return Finding("warning", "unread-images", message, TO_PNG)


def _named_as(name: str, header: Header) -> bool:
    suffix = Path(name).suffix.lower().replace("tiff", "tif").replace("jpeg", "jpg")
    return suffix == {"PNG": ".png", "TIFF": ".tif", "JPEG": ".jpg"}[header.format]

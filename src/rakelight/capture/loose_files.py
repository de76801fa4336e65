"""A folder of photographs and depth: which file is what, by names and by content.

Names come first: a file, or its folder, with `depth` in its name is depth, one with the word `mask`
the mask, `ambient` and `flat` are pictures for the correction of the light, `confidence` and `conf`
say how sure the depth is, `disparity` is left out, `depth_scale` is the number of depth values per
metre.  A file without such a name is depth where its format holds nothing else (PFM, NPY, EXR
without colour), or where it is one channel of 16 bit or floating point beside photographs in
colour.  The other images are the photographs.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rakelight.capture import exr, heic, npy, pfm, raw, z16
from rakelight.capture.config import CONFIG
from rakelight.capture.headers import PNG_MAGIC, Header, TiffTags, read_header
from rakelight.capture.intrinsics.names import TEXT_SUFFIXES, may_state
from rakelight.capture.listing import SUFFIXES, TO_PNG, UNREAD, by_number
from rakelight.capture.tone_curve import read_photograph_header
from rakelight.errors import CaptureError, listed
from rakelight.files import clear_errors, read_bytes

Kind = Literal["PNG", "JPEG", "TIFF", "heic", "raw", "exr", "pfm", "npy", "z16"]
Role = Literal["photograph", "depth", "mask", "ambient", "flat", "confidence", "disparity"]

_ONLY_DEPTH = ("pfm", "npy", "z16")
# A .npy with a shorter side is no image but a table: poses (N, 7), directions of lights (N, 3).
_LEAST_SIDE = 8
# Endings of files that are images, or damaged.
_IMAGES = (*SUFFIXES, *raw.SUFFIXES, ".heic", ".heif", ".exr")
# Words that say, in the name of a file or of its folder, what is not read for a photograph.
_NOT_READ: dict[Role, str] = {
    "confidence": r"(?<![a-z])conf(idence)?(?![a-z])",
    "disparity": r"(?<![a-z])disp(arity|arities)?(?![a-z])",
}
# Of what there is one each, and folders' names that say the same: BOP has mask/ and mask_visib/.
_ONE_EACH: dict[Role, str] = {
    "mask": r"masks?(?![a-z]).*",
    "ambient": r"ambients?",
    "flat": r"flats?",
}
_TO_DEPTH = "save focal length (pixels) x baseline (metres) / disparity as depth.tiff"
RESULT = "result.json"
_MOST_FILES = 2000  # that are looked at; more are a recording or a disk
_RENAME = (
    "rename those that are photographs: depth, conf, mask, ambient and flat in a name say that a "
    "picture is none"
)
_WHERE = "put the photographs in one folder, or name the others depth, mask, ambient, flat"


@dataclass(frozen=True, slots=True)
class LooseFile:
    """An image or array among the files.

    name : relative to the folder; source : for messages
    header : of PNG, JPEG and TIFF; exr : of EXR
    shape : (height, width) of depth without a header, as a file beside it says
    """

    path: Path
    name: str
    source: str
    kind: Kind
    header: Header | None = None
    exr: exr.ExrHeader | None = None
    shape: tuple[int, int] | None = None

    @property
    def one_channel(self) -> bool:
        """Whether it could be depth by what it holds."""
        if self.exr is not None:
            return bool(self.exr.depth) or len(set(self.exr.color)) == 1
        if self.header is not None:
            return self.header.channels == 1 and self.header.dtype != "uint8"
        return self.kind in _ONLY_DEPTH

    @property
    def only_depth(self) -> bool:
        """Whether it can be nothing else."""
        if self.exr is not None:
            return not self.exr.color
        return self.kind in _ONLY_DEPTH


@dataclass(frozen=True, slots=True)
class LooseFiles:
    """What is what in a folder; each in the order of the numbers in the names.

    texts : files that might hold intrinsics; depth_scale : the file that says it
    unused : names of pictures that are left out, for a note
    confidence : how sure the depth is, see loose_confidence.py
    unread : names of images of formats that are not read, for a warning
    """

    photographs: tuple[LooseFile, ...]
    depth: tuple[LooseFile, ...]
    mask: LooseFile | None
    ambient: LooseFile | None
    flat: LooseFile | None
    texts: tuple[Path, ...]
    depth_scale: Path | None
    unused: tuple[str, ...]
    confidence: tuple[LooseFile, ...] = ()
    unread: tuple[str, ...] = ()


def kind_of(start: bytes, suffix: str) -> Kind | None:
    """The kind of a file by its first bytes (some hundred); None where it is none of these.

    >>> kind_of(b"II*\\0", ".tif"), kind_of(b"II*\\0", ".NEF"), kind_of(b"hello", ".png")
    ('TIFF', 'raw', None)
    """
    box, brand = start[4:8], start[8:12]
    if start.startswith(PNG_MAGIC):
        return "PNG"
    if start.startswith(b"\xff\xd8\xff"):
        return "JPEG"
    if start.startswith((b"II*\0", b"MM\0*")):
        return "raw" if suffix.lower() in raw.SUFFIXES or brand[:2] == b"CR" else "TIFF"
    if box == b"ftyp" and brand == b"crx ":
        return "raw"
    if box == b"ftyp" and brand in heic.BRANDS:
        return "heic"
    if start.startswith(exr.MAGIC):
        return "exr"
    if start.startswith(pfm.MAGIC) and start[2:3].isspace():
        return "pfm"
    return "npy" if start.startswith(npy.MAGIC) else None


def role_of(name: str) -> Role | None:
    """What a file is by its name relative to the folder; None where the name does not say.

    >>> role_of("depth/000.png"), role_of("IMG_1.jpg"), role_of("object mask.png")
    ('depth', None, 'mask')
    >>> role_of("mask_visib/000000_000000.png"), role_of("masked/0.png")
    ('mask', None)
    >>> role_of("conf_00000.png"), role_of("confidence/0.png"), role_of("confetti.png")
    ('confidence', 'confidence', None)
    """
    path = Path(name.lower())
    for role, words in _NOT_READ.items():
        if re.search(words, path.stem) or re.search(words, path.parent.name):
            return role
    for word, folders in _ONE_EACH.items():
        if re.search(rf"(?<![a-z]){word}(?![a-z])", path.stem) or re.fullmatch(
            folders, path.parent.name
        ):
            return word
    return "depth" if "depth" in path.stem or "depth" in path.parent.name else None


def is_ours(folder: Path) -> bool:
    """Whether a folder is a capture or a result of rakelight's."""
    return any((folder / name).is_file() for name in (CONFIG, RESULT))


def candidates(folder: Path) -> list[Path]:
    """The files in it and in its subfolders, not deeper, through no link to a folder; sorted.

    Captures and results of rakelight's are none of these subfolders.
    Raises CaptureError for too many, MachineError for a subfolder that may not be looked at.
    """
    found: list[Path] = []
    for path in sorted(folder.iterdir(), key=by_number):
        if path.name.startswith("."):
            continue
        if path.is_dir():
            with clear_errors(str(path), "cannot be read"):
                left_out = path.is_symlink() or is_ours(path)
                inner = [] if left_out else sorted(path.iterdir(), key=by_number)
            found += [p for p in inner if not p.name.startswith(".") and not p.is_dir()]
        else:
            found.append(path)
        if len(found) > _MOST_FILES:
            raise CaptureError(
                "too many files",
                source=str(folder),
                seen=f"more than {_MOST_FILES}",
                remedy="put the photographs and the depth into a folder of their own",
            )
    return found


def images_in(folder: Path) -> list[tuple[Kind, Role | None]]:
    """Kind and role of each image among the candidates, by first bytes and names; raises OSError.

    Those that may not be looked at are left out.
    """
    found: list[tuple[Kind, Role | None]] = []
    for path in candidates(folder):
        with suppress(OSError):
            if path.is_file():
                with path.open("rb") as file:
                    kind = kind_of(file.read(16), path.suffix)
                if kind is not None:
                    found.append((kind, role_of(path.relative_to(folder).as_posix())))
    return found


def list_loose_files(folder: Path, photographs: Sequence[str] = ()) -> LooseFiles:
    """The files of a folder, each as what it is; raises CaptureError where that is not clear.

    photographs : their names in their order, where a list says them; other pictures are then none
    """
    with clear_errors(str(folder), "cannot be read"):
        paths = candidates(folder)
    texts = [p for p in paths if may_state(p)]
    scales = [p for p in texts if re.fullmatch(r"depth[-_ ]?scale", p.stem.lower())]
    images = [file for path in paths if path not in texts and (file := _looked_at(folder, path))]
    stated = dict.fromkeys(photographs, "photograph")
    roles = {file.name: stated.get(file.name) or role_of(file.name) for file in images}
    named = {
        word: [file for file in images if roles[file.name] == word]
        for word in ("depth", *_ONE_EACH, *_NOT_READ)
    }
    one = {word: _the_one(folder, word, named[word]) for word in _ONE_EACH}
    rest = [file for file in images if roles[file.name] is None]
    tables = [file for file in rest if _is_table(file)]
    rest = [file for file in rest if file not in tables]
    known = {file.name for file in images}
    names = [p.relative_to(folder).as_posix() for p in paths]
    others = [name for name in names if name not in known]
    unread = [name for name in others if Path(name).suffix.lower() in UNREAD]
    if not images:
        _check_photographs(folder, [], [], unread)
    of_depth = [name for name in others if role_of(name) == "depth" and name not in unread]
    meant = [name for name in others if name in unread or name in of_depth]
    meant = [*(file.name for file in named["disparity"]), *meant]
    meant += [f"{file.name} (no array of height x width)" for file in tables]
    depth, unused = _depth_among(folder, named["depth"], rest, meant)
    if photographs:
        rest = _listed(folder, images, photographs)
    taken, paired = _without_pairs([file for file in rest if file not in depth])
    arrays = [file for file in taken if file.only_depth]
    taken = [file for file in taken if file not in arrays]
    more = [file for word in _ONE_EACH for file in named[word] if file is not one[word]]
    pictures = [each for each in (*unused, *named["confidence"], *more) if not each.one_channel]
    _check_photographs(folder, taken, depth, unread, pictures)
    return LooseFiles(
        tuple(taken),
        tuple(depth),
        one["mask"],
        one["ambient"],
        one["flat"],
        tuple(p for p in texts if p not in scales),
        scales[0] if scales else None,
        (
            *(name for name in of_depth if Path(name).suffix.lower() not in TEXT_SUFFIXES),
            *(
                file.name
                for file in (*unused, *named["disparity"], *paired, *arrays, *more, *tables)
            ),
        ),
        tuple(named["confidence"]),
        tuple(unread),
    )


def _looked_at(folder: Path, path: Path) -> LooseFile | None:
    name = path.relative_to(folder).as_posix()
    source = f"{folder}/{name}"
    stated = path.suffix.lower() in _IMAGES
    if not path.is_file():
        if stated:
            what = "a link to nothing" if path.is_symlink() else "neither a file nor a folder"
            raise CaptureError(what, source=source, remedy="remove it")
        return None
    with clear_errors(source, "cannot be read"), path.open("rb") as file:
        start = file.read(64)
    kind = kind_of(start, path.suffix)
    if kind is None and (shape := z16.stated_shape(path)):
        return LooseFile(path, name, source, "z16", shape=shape)
    if kind is None and stated:
        read_header(start, source)  # says what it is: never left out without a word
    if kind in ("PNG", "JPEG", "TIFF"):
        data = read_bytes(path, source=source)
        if kind == "TIFF" and is_dng(data):
            return LooseFile(path, name, source, "raw")
        return LooseFile(path, name, source, kind, header=read_photograph_header(data, source))
    if kind == "exr":
        header = exr.read_exr_header(read_bytes(path, source=source), source)
        return LooseFile(path, name, source, kind, exr=header)
    return None if kind is None else LooseFile(path, name, source, kind)


def _is_table(file: LooseFile) -> bool:
    """Whether a file is an array that no image is: by its number of axes, or its sides."""
    if file.kind != "npy":
        return False
    with clear_errors(file.source, "cannot be read"), file.path.open("rb") as opened:
        shape = npy.stated_shape(opened, file.source)
    return shape is None or min(shape) < _LEAST_SIDE


def is_dng(data: bytes) -> bool:
    """Whether a TIFF says that it is a DNG."""
    try:
        return 50706 in TiffTags(data).places  # DNGVersion
    except Exception:  # damaged: whoever reads it as a TIFF says so
        return False


def _listed(folder: Path, images: Sequence[LooseFile], names: Sequence[str]) -> list[LooseFile]:
    """The images called `names`; raises CaptureError where one is not there."""
    there = {file.name: file for file in images}
    for name in names:
        if name not in there:
            raise CaptureError(
                "a photograph that is listed is not there",
                source=f"{folder}/{name}",
                needed="PNG, TIFF, JPEG, HEIC, EXR or raw",
                remedy="put it there, or take its line out of all lists",
            )
    return [there[name] for name in names]


def _the_one(folder: Path, word: str, files: Sequence[LooseFile]) -> LooseFile | None:
    """Of several masks, or the like, the only one in the folder itself; None where there is none.

    Raises CaptureError where it is not clear which of them is meant.
    """
    itself = [file for file in files if file.path.parent == folder]
    found = itself if len(itself) == 1 else files
    if len(found) > 1:
        _refuse_captures(folder, files)
        raise CaptureError(
            f"more than one {word}", source=str(folder), seen=_names(files),
            needed=f"one {word} for all photographs",
            remedy=f"save the one that is meant as {word}.png in {folder}; give photographs a name "
            f"without {word}",
        )  # fmt: skip
    return found[0] if found else None


def _depth_among(
    folder: Path, named: list[LooseFile], rest: list[LooseFile], meant: list[str]
) -> tuple[list[LooseFile], list[LooseFile]]:
    """The depth maps, and pictures of depth that are left out.

    meant : names of files that are not read and may be meant for depth
    """
    if named:
        real = [file for file in named if file.one_channel or file.only_depth]
        bare = [name for name in meant if name.lower().endswith(z16.SUFFIX)]
        if bare and not real:
            raise z16.size_not_stated(f"{folder}/{bare[0]}")
        # A coloured picture of the depth beside the depth itself is for people.
        return (real, [file for file in named if file not in real]) if real else (named, [])
    certain = [file for file in rest if file.only_depth]
    possible = certain or [file for file in rest if file.one_channel]
    if not possible:
        raise CaptureError(
            "no depth map in it",
            source=str(folder),
            seen=listed([*meant, *(file.name for file in rest)]),
            needed="photographs and their depth: 16-bit PNG or TIFF, float TIFF, PFM, NPY, EXR",
            remedy=_TO_DEPTH
            if any(role_of(name) == "disparity" for name in meant)
            else "put it there as depth.png (16 bit, millimetres) or depth.tiff (floating point, "
            'metres), or several into a folder "depth"',
        )
    return possible, []


def _without_pairs(files: list[LooseFile]) -> tuple[list[LooseFile], list[LooseFile]]:
    """Without the JPEG or HEIC that a camera wrote beside the raw file of the same name."""
    raw_stems = {Path(file.name).stem for file in files if file.kind == "raw"}
    paired = [
        file
        for file in files
        if file.kind in ("JPEG", "heic") and Path(file.name).stem in raw_stems
    ]
    return [file for file in files if file not in paired], paired


def _check_photographs(
    folder: Path,
    files: Sequence[LooseFile],
    depth: Sequence[LooseFile],
    unread: Sequence[str],
    pictures: Sequence[LooseFile] = (),
) -> None:
    """Raise CaptureError unless there are some, of one kind, in one folder.

    unread : names of images of other formats; pictures : that are none by their names
    """
    source = str(folder)
    if depth and not files and not any(f.only_depth or role_of(f.name) for f in depth):
        raise CaptureError(
            "not clear which of these is depth",
            source=source,
            seen=_names(depth),
            needed="photographs, and depth by name",
            remedy='name the depth depth.png, or put the depth maps into a folder "depth"',
        )
    if not files:
        raise CaptureError(
            "no photographs in it",
            source=source,
            seen=listed(unread) or _names(pictures),
            needed="JPEG, PNG, TIFF, HEIC, EXR, DNG, CR2, CR3, NEF or ARW",
            remedy=TO_PNG if unread else _RENAME if pictures else _WHERE,
        )
    places = sorted({Path(file.name).parent.as_posix() for file in files})
    if len(places) > 1:
        _refuse_captures(folder, files)
        raise CaptureError(
            "photographs in several folders",
            source=source,
            seen=", ".join(places[:5]),
            needed="one folder, its names in the order of the photographs",
            remedy=_WHERE,
        )
    kinds = sorted({file.kind for file in files})
    if len(kinds) > 1:
        first = [next(file.name for file in files if file.kind == kind) for kind in kinds]
        raise CaptureError(
            "photographs of several formats",
            source=source,
            seen=", ".join(first),
            needed="one format: each treats light in another way",
            remedy="keep those of the most exact one (raw, then 16-bit TIFF, then the others); "
            + _WHERE,
        )


def _refuse_captures(folder: Path, files: Sequence[LooseFile]) -> None:
    """Raise CaptureError where the files lie in folders with photographs and depth of their own."""
    places = sorted({file.path.parent for file in files} - {folder})
    captures = [place.name for place in places if _holds_both(place)]
    if len(captures) > 1:
        raise folder_of_captures(folder, captures)


def _holds_both(folder: Path) -> bool:
    """Whether there are photographs and depth in it, by names and formats."""
    images = images_in(folder)
    depth = any(role == "depth" or kind in _ONLY_DEPTH for kind, role in images)
    return depth and any(role is None for _, role in images)


def folder_of_captures(folder: Path, captures: Sequence[str]) -> CaptureError:
    """The error of a folder in which folders of these names are captures."""
    return CaptureError(
        "a folder of captures", source=str(folder), seen=listed(captures), needed="one capture",
        remedy="name one of them, or all to `rakelight batch`",
    )  # fmt: skip


def _names(files: Sequence[LooseFile]) -> str:
    return listed([file.name for file in files])

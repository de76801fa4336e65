"""The members of an .r3d, looked at before they are read: a ZIP from anywhere.

Members are read by name and never extracted; what states more than it may be is refused unread.
"""

from __future__ import annotations

import os
import re
import stat
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from io import FileIO
from pathlib import Path

from rakelight.errors import CaptureError, parsing
from rakelight.files import clear_errors, open_regular

METADATA = "metadata"
EXPORT_AGAIN = "export it again from Record3D, as .r3d"
_MEMBER = re.compile(r"rgbd/([0-9]{1,9})\.(jpg|jpeg|png|depth|conf)")
_DAMAGED = "the archive is damaged"
# Bytes of the list of a ZIP's members, which is read whole: 100 for each of 600,000.
_MOST_LIST = 60_000_000
# Bytes of a frame, and of a depth map; packed ones of 960x720 take 3,000,000.
MOST_FRAME, MOST_MAP = 100_000_000, 20_000_000


@dataclass(frozen=True)
class Archive:
    """The members of an .r3d by frame: {number: name} of each kind."""

    path: Path
    members: Mapping[str, zipfile.ZipInfo]
    metadata: str
    color: dict[int, str]
    depth: dict[int, str]
    confidence: dict[int, str]

    @property
    def source(self) -> str:
        """The archive, for messages."""
        return str(self.path)

    def read(self, opened: zipfile.ZipFile, name: str, most: int) -> bytes:
        """One member, never more than `most` bytes of it."""
        member, source = self.members[name], f"{self.path}/{name}"
        link = stat.S_ISLNK(member.external_attr >> 16)
        plain = member.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
        if member.flag_bits & 1 or link or not plain:
            raise CaptureError(
                "this kind of member is not read",
                source=source,
                seen="a link" if link else "encrypted" if plain else "another compression",
                needed="a file, stored or deflated",
                remedy=EXPORT_AGAIN,
            )
        if member.file_size > most:
            raise CaptureError(
                "a member is too large",
                source=source,
                seen=f"{member.file_size / 1e6:.0f} MB",
                needed=f"at most {most / 1e6:.0f} MB",
                remedy=EXPORT_AGAIN,
            )
        with parsing(source, _DAMAGED, CaptureError), opened.open(member) as file:
            return file.read(most)


class _ShortReads(FileIO):
    """A file that is never asked for more than the list of its members at once."""

    def read(self, size: int | None = -1, /) -> bytes:
        left = os.fstat(self.fileno()).st_size - self.tell()
        wanted = left if size is None or size < 0 else min(size, left)
        if wanted > _MOST_LIST:
            raise ValueError("a list of members that is too large")
        return super().read(max(wanted, 0)) or b""


@contextmanager
def opened_zip(path: Path) -> Iterator[zipfile.ZipFile]:
    """The archive with its list of members; raises CaptureError where it is damaged or none."""
    with clear_errors(str(path), "cannot be read"):
        open_regular(path, str(path)).close()  # no pipe, no device
        file = _ShortReads(path, "rb")
    with file:
        with parsing(str(path), _DAMAGED, CaptureError):
            opened = zipfile.ZipFile(file)
        with opened:
            yield opened


def metadata_in(names: Iterable[str]) -> str | None:
    """The member of a recording's metadata, which a ZIP packed again has in a folder; else None.

    >>> metadata_in(["scan/metadata", "scan/rgbd/0.jpg", "__MACOSX/scan/rgbd/._0.jpg"])
    'scan/metadata'
    """
    there = set(names)
    folders = sorted({name.partition("rgbd/")[0] for name in there if "rgbd/" in name})
    return next((f + METADATA for f in folders if f + METADATA in there), None)


def listed_frames(path: Path, opened: zipfile.ZipFile) -> Archive:
    """The frames by their numbers; raises CaptureError for a name twice, or for no frames."""
    members: dict[str, zipfile.ZipInfo] = {}
    kinds: dict[str, dict[int, str]] = {"color": {}, "depth": {}, "conf": {}}
    metadata = metadata_in(opened.namelist()) or METADATA
    folder = metadata.removesuffix(METADATA)
    for member in opened.infolist():
        name = member.filename
        found = _MEMBER.fullmatch(name.removeprefix(folder)) if name.startswith(folder) else None
        if found is None and name != metadata:
            continue  # an icon, sound
        kind = "" if found is None else found[2] if found[2] in kinds else "color"
        number = -1 if found is None else int(found[1])
        if name in members or (kind and number in kinds[kind]):
            raise CaptureError(
                "two members of one name",
                source=f"{path}/{name}",
                remedy=EXPORT_AGAIN,
            )
        members[name] = member
        if kind and member.file_size:
            kinds[kind][number] = name
    for kind, what in (("color", "colour"), ("depth", "depth")):
        if not kinds[kind]:
            raise CaptureError(
                f"no {what} frames in it",
                source=str(path),
                needed="rgbd/0.jpg and rgbd/0.depth, and so on",
                remedy=EXPORT_AGAIN,
            )
    ordered = [dict(sorted(kinds[kind].items())) for kind in ("color", "depth", "conf")]
    return Archive(path, members, metadata, *ordered)

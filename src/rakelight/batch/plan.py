"""From what was named on the command line to jobs: one for each capture, each with its own name."""

from __future__ import annotations

import codecs
import glob
import hashlib
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import unquote, urlsplit

from rakelight.batch.remote import is_url, last_part, matching_urls
from rakelight.capture.text_tables import text_of
from rakelight.errors import InputError, named_in, printable
from rakelight.files import MAX_TEXT_BYTES, read_bytes
from rakelight.memory import require_working_directory

LIST_SUFFIX = ".txt"
"""A file of this kind is a list of captures; no capture is one."""

# Names in a batch's folder that no result may take.
RESERVED = frozenset({"batch.json", "index.html"})
# Characters that some file system refuses, or that mean something in an address.
_AWKWARD = re.compile(r'[<>:"/\\|?*%#]')
# Bytes; most file systems take 255, and our hidden names are 30 longer.
_LONGEST_NAME = 150
# Bytes of the suffix that tells captures of one name apart: 10,000 of them clash once in 80 runs.
_TAG_BYTES = 4


@dataclass(frozen=True)
class Job:
    """One capture of a batch.

    source : absolute path, through links as it was named, or URL; shown : the same for messages
        and records, by which the capture is known in a later run
    name : of its result folder
    line : the list and its line that name it, for messages where nothing is there
    """

    source: str
    name: str
    line: str = ""

    @property
    def shown(self) -> str:
        """The source, safe for a terminal and for JSON."""
        return printable(self.source)

    @property
    def remote(self) -> bool:
        """Whether it has to be fetched first."""
        return is_url(self.source)


@dataclass(frozen=True)
class _Source:
    """A capture that was named.

    given : absolute path as it was named, or URL; place : the same without links
    line : as in `Job`
    """

    given: str
    place: str
    line: str = ""


def make_jobs(named: Sequence[str], earlier: Mapping[str, str] | None = None) -> list[Job]:
    """The jobs of captures that are named: paths, globs, lists (.txt), URLs.

    earlier : names that captures had in an earlier run, by `Job.shown`; they keep them

    A capture that is named twice is one job, links to it included.  Captures whose names are the
    same, or not fit for a file, get a tag that depends on their paths alone.  Raises InputError
    where a pattern matches nothing, or a list cannot be read or names nothing that is there.

    >>> [job.name for job in make_jobs(["/a/mitten", "/a/coin", "/a/mitten/"])]
    ['mitten', 'coin']
    >>> [job.name for job in make_jobs(["/a/mitten", "/b/mitten"])]
    ['mitten-0c23201f', 'mitten-71a8f87b']
    """
    sources: dict[str, _Source] = {}
    for each in (source for text in named for source in _sources(text)):
        if each.place not in sources or each.given == each.place:  # its own name before a link's
            sources[each.place] = each
    kept = _names_kept(sources.values(), earlier or {})
    taken = {name.casefold() for name in (*(earlier or {}).values(), *RESERVED)}
    wanted = {place: clean_name(sources[place].given) for place in sources if place not in kept}
    count = Counter(name.casefold() for name in wanted.values())
    names = dict(kept)
    for place, name in wanted.items():
        unclear = name != _last_name(sources[place].given)
        if unclear or count[name.casefold()] > 1 or name.casefold() in taken:
            tag = hashlib.blake2b(os.fsencode(place), digest_size=_TAG_BYTES).hexdigest()
            name = f"{name}-{tag}"
        names[place] = name
    return [Job(each.given, names[place], each.line) for place, each in sources.items()]


def _names_kept(sources: Iterable[_Source], earlier: Mapping[str, str]) -> dict[str, str]:
    """The names that captures had in an earlier run, under these paths or others; by place."""
    known = {printable(_place_of(shown)): name for shown, name in earlier.items()} | dict(earlier)
    names: dict[str, str] = {}
    for each in sources:
        for path in (each.given, each.place):
            if printable(path) in known:
                names.setdefault(each.place, known[printable(path)])
    return names


def clean_name(source: str) -> str:
    """A name for a folder, from the last part of a path or URL; any file system takes it.

    >>> clean_name("/captures/a:b"), clean_name("s3://bucket/coin?version=3"), clean_name("/")
    ('a_b', 'coin', '_')
    """
    name = _AWKWARD.sub("_", _last_name(source))
    name = "".join(c if c.isprintable() else "_" for c in name).rstrip(". ") or "_"
    name = "_" + name[1:] if name[0] in ".-" else name
    return name.encode()[:_LONGEST_NAME].decode(errors="ignore")


def _last_name(source: str) -> str:
    return last_part(source) if is_url(source) else os.path.basename(source)  # noqa: PTH119


def _sources(text: str) -> Iterator[_Source]:
    """The captures that one argument names.

    Raises InputError for an empty one: that would be the working directory.
    """
    if not text:
        raise InputError(
            "the name is empty",
            source="CAPTURE",
            needed="a path, a pattern, a list or a URL",
            remedy="look whether a variable that was to hold it is empty",
        )
    if is_url(text):
        urls = matching_urls(text) if glob.has_magic(unquote(urlsplit(text).path)) else (text,)
        yield from (_Source(url, url) for url in urls)
    elif text.endswith(LIST_SUFFIX) and os.path.isfile(text):  # noqa: PTH113
        yield from _listed(Path(text))
    else:
        yield from _paths(text, "")


def _paths(text: str, folder: str) -> Iterator[_Source]:
    require_working_directory(folder or text, needed="one that this path begins at")
    found = _found(text, folder)
    if not found:
        raise InputError(
            "nothing matches",
            source=text,
            needed="a pattern of paths to captures",
            remedy="look at it with `ls`",
        )
    try:
        yield from map(_source_at, found)
    except (OSError, ValueError) as error:  # a zero byte
        raise InputError("not a usable path", source=text, seen=str(error)) from error


def _found(text: str, folder: str) -> list[str]:
    """The path itself, or the paths that a pattern matches."""
    path = os.path.join(folder, text)  # noqa: PTH118 - keeps any bytes and an absolute text
    if glob.has_magic(path) and not os.path.lexists(path):
        return sorted(glob.glob(path))  # noqa: PTH207
    return [path]


def _source_at(path: str) -> _Source:
    """What a path names; its `..` are kept out of `given` where they lead back through a link."""
    given, place = os.path.abspath(path), os.path.realpath(path)  # noqa: PTH100
    return _Source(given if os.path.realpath(given) == place else place, place)


def _place_of(source: str) -> str:
    """A path without links, or a URL as it is."""
    return source if is_url(source) else os.path.realpath(source)


def _listed(path: Path) -> Iterator[_Source]:
    """The captures of a list: a line each, relative to the list's folder.  # begins a comment line.

    Raises InputError for a list that holds nothing, and for a text that names nothing that is
    there: no list.
    """
    data = read_bytes(path, max_bytes=MAX_TEXT_BYTES)
    wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))  # else bytes are kept
    text = (text_of(data) or "") if wide else os.fsdecode(data)
    numbered = enumerate(map(str.strip, text.removeprefix("\ufeff").splitlines()), 1)
    lines = {i: line for i, line in numbered if line and not line.startswith("#")}
    if not lines:
        raise InputError("a list without captures", source=str(path), needed="a path on each line")
    folder = os.fspath(path.parent)
    if not any(is_url(line) or _is_there(line, folder) for line in lines.values()):
        number, line = next(iter(lines.items()))
        raise InputError(
            "not a list of captures: none of its lines names a file or folder that is there",
            source=str(path),
            seen=f"line {number}: {line[:80]}",
            needed="paths from the list's own folder",
            remedy="mend the paths; where it is no list, leave it out, as the pattern */ does",
        )
    for number, line in lines.items():
        where = f"{path}, line {number}"
        with named_in(where):
            found = list(_sources(line) if is_url(line) else _paths(line, folder))
        for each in found:
            there = is_url(line) or os.path.exists(each.given)  # noqa: PTH110
            yield each if there else replace(each, line=where)


def _is_there(text: str, folder: str) -> bool:
    """Whether a line of a list names something."""
    try:
        return any(map(os.path.exists, _found(text, folder)))
    except ValueError:  # a zero byte
        return False

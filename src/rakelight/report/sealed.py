"""Pages that stand alone as files: replaced only where we wrote them and nobody has since."""

from __future__ import annotations

import re
from hashlib import sha256
from pathlib import Path

from rakelight.errors import OutputExistsError, check_is
from rakelight.files import clear_errors, replace_bytes

# The last line of a page of ours: its kind, and the SHA-256 of all before that line.
_SEAL = re.compile(rb"<!-- rakelight ([a-z]+), sha256 ([0-9a-f]{64}) -->\n\Z")
_LONGEST_SEAL = 200


def sealed(page: str, kind: str) -> bytes:
    """The bytes of a page with its seal.

    >>> sealed("<p>good", "check")
    b'<p>good<!-- rakelight check, sha256 5936...512d -->\\n'
    """
    text = page.encode("utf-8", "backslashreplace")
    return text + f"<!-- rakelight {kind}, sha256 {sha256(text).hexdigest()} -->\n".encode()


def require_free_page(file: Path, *, overwrite: bool = False, kind: str = "check") -> None:
    """Raise OutputExistsError where something stands at `file` that may not be replaced.

    Replaced is, with `overwrite`, a page of this kind that was not changed since; nothing else.

    >>> require_free_page(Path("no/such/page.html"))
    """
    source = str(file)
    with clear_errors(source, "cannot be written"):
        if not (file.exists() or file.is_symlink()):
            return
        if file.is_dir():
            raise OutputExistsError(
                "a folder stands where the page is to be written",
                source=source,
                remedy="name a file in it, or choose another name",
            )
        if not overwrite:
            remedy = "choose another name, or overwrite it: overwrite=True, or --overwrite"
            raise OutputExistsError("the file exists", source=source, remedy=remedy)
        if file.is_symlink() or not file.is_file() or not _is_ours(file, kind):
            raise OutputExistsError(
                "what was not written by rakelight, or was changed since, is not overwritten",
                source=source,
                needed=f"the page of an earlier {kind}",
                remedy="move your file away, or choose another name",
            )


def _is_ours(file: Path, kind: str) -> bool:
    content = file.read_bytes()
    seal = _SEAL.search(content, max(len(content) - _LONGEST_SEAL, 0))
    if seal is None or seal[1] != kind.encode():
        return False
    return sha256(content[: seal.start()]).hexdigest().encode() == seal[2]


def write_page(file: Path, page: bytes, *, overwrite: bool = False, kind: str = "check") -> None:
    """Write a page whole or not at all; see `require_free_page` for what may be replaced.

    Raises MachineError where the disk is full or may not be written to.

    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as scratch:
    ...     write_page(Path(scratch) / "check.html", b"<p>good</p>")
    ...     (Path(scratch) / "check.html").read_bytes()
    b'<p>good</p>'
    """
    check_is(page, bytes, "page", "give what `sealed` returned")
    require_free_page(file, overwrite=overwrite, kind=kind)
    replace_bytes(file, page)

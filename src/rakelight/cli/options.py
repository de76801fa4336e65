"""Options that several commands share, and how they are read."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

import click

from rakelight.errors import InputError, OutputExistsError, printable
from rakelight.memory import require_working_directory
from rakelight.model import Finding
from rakelight.prepare import Scale

F = TypeVar("F", bound=Callable[..., Any])


class NamedPath(click.Path):
    """A path, which may not be empty: that would be the working directory.

    Nor may it begin at a working directory that was deleted.
    """

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        """The path; fails for an empty one, raises MachineError where it leads from nowhere."""
        if value == "":
            self.fail("the name is empty", param, ctx)
        path: Any = super().convert(value, param, ctx)
        require_working_directory(path, needed="one that this path begins at")
        return path


def output_options(command: F) -> F:
    """--json, --quiet and --debug."""
    for option in (
        click.option("--debug", is_flag=True, help="Show the traceback of an error."),
        click.option("--quiet", is_flag=True, help="Print nothing but errors."),
        click.option("--json", "as_json", is_flag=True, help="Print the outcome as JSON."),
    ):
        command = option(command)
    return command


def output_folder(metavar: str, text: str) -> Callable[[F], F]:
    """The required option -o/--output, a path; text : its help."""
    return click.option(
        "-o",
        "--output",
        type=NamedPath(),
        required=True,
        metavar=metavar,
        help=text,
    )


def print_findings(findings: Iterable[Finding]) -> None:
    """One line each on stderr, with what to do about it."""
    for finding in findings:
        line = f"{finding.severity}: {finding.message}"
        line += f". Fix: {finding.remedy}" if finding.remedy else ""
        click.echo(printable(line), err=True)


def findings_as_json(findings: Iterable[Finding]) -> list[dict[str, str]]:
    """What `--json` prints of findings.

    >>> findings_as_json([Finding("note", "jpeg", "JPEG")])
    [{'severity': 'note', 'code': 'jpeg', 'message': 'JPEG', 'remedy': ''}]
    """
    return [asdict(finding) for finding in findings]


def refuse_input_as_output(source: Path, output: Path, what: str = "capture") -> None:
    """Raise OutputExistsError when `output` is the input, or one lies inside the other.

    source : the input, a file or folder; what : it is, for the message
    """
    inner, outer = Path(os.path.realpath(output)), Path(os.path.realpath(source))
    if inner.is_relative_to(outer):
        wrong = f"this would be written into the {what}, which is never changed"
    elif outer.is_relative_to(inner):
        wrong = f"the {what} lies in this folder and would be replaced with it"
    else:
        return
    raise OutputExistsError(wrong, source=str(output), remedy="choose a folder beside it")


def parse_scale(text: str) -> Scale:
    """`auto` or a whole number.

    >>> parse_scale("auto"), parse_scale("2")
    ('auto', 2)
    """
    if text == "auto":
        return "auto"
    if not (text.isdecimal() and len(text) < 4):
        raise InputError(
            "not a scale", source="--scale", seen=text, needed="auto or a whole number"
        )
    return int(text)


def parse_memory(text: str) -> float:
    """Bytes of a size such as "4GB" or "800 MB".

    >>> parse_memory("4GB"), parse_memory("0.5 gb"), parse_memory("800M")
    (4000000000.0, 500000000.0, 800000000.0)
    """
    found = re.fullmatch(r"\s*([0-9]{1,9}(?:\.[0-9]{1,9})?)\s*([MG])B?\s*", text, re.IGNORECASE)
    size = 0.0 if found is None else float(found[1]) * {"M": 1e6, "G": 1e9}[found[2].upper()]
    if size == 0:
        raise InputError(
            "not a size of memory", source="--memory", seen=repr(text), needed="a size as 4GB"
        )
    return size


def parse_photographs(text: str) -> list[int]:
    """Numbers from 0 of a list such as "0-14,17", none twice.

    >>> parse_photographs("0-2,5")
    [0, 1, 2, 5]
    """

    def refused(what: str, needed: str) -> InputError:
        return InputError(what, source="--photographs", seen=repr(text), needed=needed)

    chosen: list[int] = []
    for part in text.split(","):
        span = re.fullmatch(r"\s*([0-9]{1,5})(?:-([0-9]{1,5}))?\s*", part)
        first, last = (int(span[1]), int(span[2] or span[1])) if span else (1, 0)
        if last < first:
            raise refused("not a list of photographs", "numbers and ranges as 0-14,17")
        chosen += range(first, last + 1)
    if len(set(chosen)) < len(chosen):
        raise refused("a photograph twice", "different numbers")
    return chosen

"""Options that several commands share, and how they are read."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import click

from rakelight.errors import InputError
from rakelight.prepare import Scale

F = TypeVar("F", bound=Callable[..., Any])


def output_options(command: F) -> F:
    """--json, --quiet and --debug."""
    for option in (
        click.option("--debug", is_flag=True, help="Show the traceback of an error."),
        click.option("--quiet", is_flag=True, help="Print nothing but errors."),
        click.option("--json", "as_json", is_flag=True, help="Print the outcome as JSON."),
    ):
        command = option(command)
    return command


def parse_scale(text: str) -> Scale:
    """`auto` or a whole number.

    >>> parse_scale("auto"), parse_scale("2")
    ('auto', 2)
    """
    if text == "auto":
        return "auto"
    if not text.isdecimal():
        raise InputError("not a scale", source="--scale", seen=text, needed="auto, 1, 2 or 4")
    return int(text)


def parse_photographs(text: str, count: int) -> list[int]:
    """Indices from 0 of a list such as "0-14,17"; each below `count`, none twice.

    >>> parse_photographs("0-2,5", 6)
    [0, 1, 2, 5]
    """
    chosen: list[int] = []
    for part in text.split(","):
        first, _, last = part.strip().partition("-")
        if not (first.isdecimal() and (last or first).isdecimal()):
            raise InputError(
                "not a list of photographs", source="--photographs", seen=text, needed="as 0-14,17"
            )
        chosen += range(int(first), int(last or first) + 1)
    wrong = [i for i in chosen if i >= count]
    if wrong or len(set(chosen)) < len(chosen):
        raise InputError(
            "no such photographs" if wrong else "a photograph twice",
            source="--photographs",
            seen=text,
            needed=f"different numbers from 0 to {count - 1}",
        )
    return chosen

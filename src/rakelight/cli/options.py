"""Options that several commands share, and how they are read."""

from __future__ import annotations

import re
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


def count_photographs(count: int) -> str:
    """So many, in words.

    >>> count_photographs(1), count_photographs(12)
    ('1 photograph', '12 photographs')
    """
    return "1 photograph" if count == 1 else f"{count} photographs"


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

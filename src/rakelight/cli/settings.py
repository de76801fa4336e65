"""`--set NAME=VALUE`: options of the method, read by the types that they have there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from difflib import get_close_matches
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

from rakelight.errors import InputError
from rakelight.methods import Method
from rakelight.model import finite_number


def parse_settings(texts: Sequence[str]) -> dict[str, str]:
    """Name -> value as written, of texts such as "depth_weight=3"; no name twice.

    >>> parse_settings(["depth_weight=3", "lights = white"])
    {'depth_weight': '3', 'lights': 'white'}
    """
    settings: dict[str, str] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise InputError(
                "not a setting",
                source=f"--set {text}",
                seen=repr(text),
                needed="NAME=VALUE",
                remedy="for example --set depth_weight=3",
            )
        if name in settings:
            raise InputError(
                "set twice",
                source=f"--set {name}",
                seen=f"{settings[name]} and {value}",
                needed="one value",
                remedy="leave one of them away",
            )
        settings[name] = value
    return settings


def options_with(method: Method, settings: Mapping[str, str]) -> Any:
    """The options of `method`, its defaults but for the settings.

    Raises InputError for a name that the method does not have, or a value that it does not take.

    >>> from rakelight.methods import load_method
    >>> options_with(load_method("ldr-ps"), {"max_iterations": "5"}).max_iterations
    5
    """
    kinds = get_type_hints(method.options)
    names = [field.name for field in fields(method.options)]
    values: dict[str, Any] = {}
    for name, text in settings.items():
        if name not in names:
            near = get_close_matches(name.lower().replace("-", "_"), names, n=1)
            raise InputError(
                f"{method.name} has no such option",
                source=f"--set {name}",
                seen=name,
                needed="one of " + ", ".join(names),
                remedy=f"did you mean {near[0]}?" if near else "choose one of these",
            )
        values[name] = read_value(text, kinds[name], f"--set {name}")
    try:
        return method.options(**values)
    except InputError as error:  # out of range; it names the option itself
        error.source = error.source or "--set"
        raise


def read_value(text: str, kind: Any, source: str) -> Any:
    """`text` as a value of the type `kind`: numbers, bool, Literal, None ("none"), or one of them.

    Raises InputError with what is needed.

    >>> read_value("3", float | None, "--set depth_weight"), read_value("none", float | None, "")
    (3.0, None)
    >>> read_value("3.5", int, "--set max_iterations")
    Traceback (most recent call last):
    rakelight.errors.InputError: --set max_iterations: not a value of this option (seen 3.5, needed
    a whole number). Fix: --set max_iterations=VALUE with such a value
    """
    kinds = _alternatives(kind)
    for each in kinds:
        found = _read(text, each)
        if found is not _UNREADABLE:
            return found
    raise InputError(
        "not a value of this option",
        source=source,
        seen=text,
        needed=" or ".join(_in_words(each) for each in kinds),
        remedy=f"{source}=VALUE with such a value",
    )


_UNREADABLE = object()
_BOOLS = {"true": True, "false": False}


def _alternatives(kind: Any) -> tuple[Any, ...]:
    """The types of a union, None last; of anything else itself."""
    if get_origin(kind) is Literal or not get_args(kind):
        return (kind,)
    return tuple(sorted(get_args(kind), key=lambda each: each is NoneType))


def _read(text: str, kind: Any) -> Any:
    if get_origin(kind) is Literal:
        return text if text in get_args(kind) else _UNREADABLE
    if kind is NoneType:
        return None if text.lower() == "none" else _UNREADABLE
    if kind is bool:
        return _BOOLS.get(text.lower(), _UNREADABLE)
    try:
        number = kind(text)
    except ValueError:
        return _UNREADABLE
    return number if finite_number(number) else _UNREADABLE


def _in_words(kind: Any) -> str:
    if get_origin(kind) is Literal:
        return " or ".join(map(str, get_args(kind)))
    return {float: "a number", int: "a whole number", bool: "true or false", NoneType: "none"}[kind]

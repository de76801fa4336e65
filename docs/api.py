"""Writes docs/reference/api.md: the public names, from their signatures and docstrings.

    make reference

A test keeps the page equal to the docstrings.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
from pathlib import Path

import rakelight
import rakelight.methods
import rakelight.synthetic

PAGE = Path(__file__).parent / "reference" / "api.md"
INTRODUCTION = """# Public names

Made from the docstrings by `make reference`. What the arguments mean together, with examples:
[Python](python.md). Everything else in the package may change without notice.
"""
MODULES = (rakelight, rakelight.methods, rakelight.synthetic)


def page() -> str:
    """The whole page."""
    sections = [INTRODUCTION]
    seen: set[int] = set()
    for module in MODULES:
        own = {name: getattr(module, name) for name in sorted(module.__all__)}
        documented = {name: value for name, value in own.items() if docstring(value)}
        sections.append(f"## {module.__name__}\n")
        sections += [entry(*each) for each in documented.items() if id(each[1]) not in seen]
        seen |= {id(value) for value in documented.values()}
    return "\n".join(sections)


def entry(name: str, value: object) -> str:
    """The heading of a name, its signature and what its docstring says."""
    lines = [f"### {name}\n", *described(name, value)]
    if inspect.isclass(value):
        for member, found in members(value):
            lines += described(member, found)
    return "\n".join(lines)


def members(cls: type) -> list[tuple[str, object]]:
    """The documented public methods and properties that a class defines itself."""
    own = [(name, value) for name, value in vars(cls).items() if name[0] != "_"]
    return [(f"{cls.__name__}.{name}", value) for name, value in own if docstring(value)]


def docstring(value: object) -> str:
    """The docstring of a function, class, method or property; "" for a field."""
    if isinstance(value, (classmethod, staticmethod)):
        value = value.__func__
    if not isinstance(value, (property, type)) and not inspect.isroutine(value):
        return ""
    text = inspect.getdoc(value) or ""
    # that which `dataclass` writes where there is none
    return "" if re.match(r"\w+\(.*\)( -> None)?$", text) else text


def described(name: str, value: object) -> list[str]:
    """The signature and the docstring, as they stand in the code."""
    text = f"{signature(name, value)}\n\n{docstring(value)}".rstrip()
    return [f"```text\n{text}\n```\n"]


def signature(name: str, value: object) -> str:
    """The name with its arguments, one a line where they are many."""
    if isinstance(value, property):
        kind = value.fget.__annotations__.get("return", "") if value.fget else ""
        return f"{name}: {kind}"
    if isinstance(value, (classmethod, staticmethod)):
        value = value.__func__
    if dataclasses.is_dataclass(value) and isinstance(value, type):
        fields = [field for field in dataclasses.fields(value) if field.init]
        arguments = [argument(field) for field in fields]
        return joined(name, arguments, "")
    try:
        found = inspect.signature(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return name
    arguments = []
    for each in found.parameters.values():
        if each.kind is each.KEYWORD_ONLY and "*" not in arguments:
            arguments.append("*")
        if each.name not in ("self", "cls"):
            arguments.append(parameter(each))
    result = found.return_annotation
    return joined(name, arguments, "" if result is found.empty else f" -> {result}")


def parameter(found: inspect.Parameter) -> str:
    """A parameter with its type and its default."""
    stars = "*" * ((found.kind is found.VAR_POSITIONAL) + 2 * (found.kind is found.VAR_KEYWORD))
    kind = "" if found.annotation is found.empty else f": {found.annotation}"
    default = "" if found.default is found.empty else f" = {short(found.default)}"
    return f"{stars}{found.name}{kind}{default}"


def argument(field: dataclasses.Field[object]) -> str:
    """A field with its type and its default."""
    text = f"{field.name}: {field.type}"
    if field.default is dataclasses.MISSING:
        return text if field.default_factory is dataclasses.MISSING else f"{text} = ..."
    return f"{text} = {short(field.default)}"


def short(default: object) -> str:
    """A default value as one would write it; "..." where that is long."""
    said = getattr(default, "__name__", None) or repr(default)
    return said if len(said) <= 40 else "..."


def joined(name: str, arguments: list[str], result: str) -> str:
    """name(arguments) -> result, in lines of at most 100 characters."""
    line = f"{name}({', '.join(arguments)}){result}"
    if len(line) <= 100:
        return line
    return f"{name}(\n" + "".join(f"    {each},\n" for each in arguments) + f"){result}"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")

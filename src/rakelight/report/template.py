"""Pages in one file: a jinja2 template, its style and its script, and what the page may do.

The content security policy allows the one style and the one script that are in the page, by their
hashes, and pictures from where is said; everything else is forbidden, requests above all.
"""

from __future__ import annotations

from base64 import b64encode
from hashlib import sha256
from importlib.resources import files
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup

from rakelight.errors import printable
from rakelight.export.summary import program_version


def page_text(name: str) -> str:
    """The content of a file of this folder."""
    return files("rakelight.report").joinpath(name).read_text(encoding="utf-8")


def rendered(
    template: str, *, style: str, script: str = "", image_sources: str = "data:", **values: Any
) -> str:
    """The page of a template, which may include the files of this folder.

    image_sources : where the page's pictures may come from, in the words of the policy
    values : what the template names besides style, script, policy and version

    >>> rendered("<p>{{ name }}", style="", name="<b>")
    '<p>&lt;b&gt;'
    """
    environment = Environment(
        autoescape=True,
        undefined=StrictUndefined,
        finalize=shown,
        trim_blocks=True,
        lstrip_blocks=True,
        loader=FunctionLoader(page_text),
    )
    allowed = {"script-src": script, "style-src": style}
    rules = [f"{rule} 'sha256-{_digest(text)}'" for rule, text in allowed.items() if text]
    return environment.from_string(template).render(
        policy="; ".join(
            ["default-src 'none'", *rules, f"img-src {image_sources}", "base-uri 'none'",
             "form-action 'none'"]
        ),
        style=Markup(style),
        script=Markup(script),
        version=program_version(),
        **values,
    )  # fmt: skip


def shown(value: Any) -> Any:
    """What the page says of a value: no text from outside reverses or hides the text around it."""
    return printable(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def _digest(text: str) -> str:
    return b64encode(sha256(text.encode()).digest()).decode()

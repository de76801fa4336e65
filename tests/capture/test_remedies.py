"""Whoever made a mistake is told what to do: every CaptureError of the readers has a remedy."""

import ast

import pytest

from tests.test_layers import PACKAGE, name_of

READING = sorted((PACKAGE / "capture").rglob("*.py"))


def without_remedy(source):
    """The lines on which a CaptureError is made without one."""
    calls = (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call))
    errors = (call for call in calls if getattr(call.func, "id", "") == "CaptureError")
    return [e.lineno for e in errors if "remedy" not in {keyword.arg for keyword in e.keywords}]


def test_a_missing_one_is_seen():
    assert without_remedy("raise CaptureError('no', source='a', remedy='b')") == []
    assert without_remedy("\nraise CaptureError('no', source='a')") == [2]


@pytest.mark.parametrize("path", READING, ids=name_of)
def test_every_error_says_what_to_do(path):
    assert without_remedy(path.read_text()) == []

"""House style that a program can see: functions that fit on a screen."""

import ast

import pytest

from tests.test_layers import PACKAGE, SOURCES, name_of

LONGEST = 60
"""Lines of a function from its def on, its docstring aside."""

LONGER = {
    (
        "photometry/_kernels.py",
        "linearize_rows",
    ): "a kernel: its loops share their arrays of scratch",
    ("cli/synth.py", "command"): "a parameter for each option of the command",
}


def lengths(source):
    """(name, lines without its docstring) of every function in a source, nested ones too."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            docstring = node.body[0] if ast.get_docstring(node) is not None else None
            unread = docstring.end_lineno - docstring.lineno + 1 if docstring else 0
            yield node.name, node.end_lineno - node.lineno + 1 - unread


LONG = {
    (name_of(path), function): lines
    for path in SOURCES
    for function, lines in lengths(path.read_text())
    if lines > LONGEST
}


def test_lines_are_counted_without_docstring_and_decorators():
    source = """
@once
@more(
    1
)
async def outer(
    a,
):
    '''Says
    something.
    '''

    def inner():
        return a

    return inner
"""
    assert dict(lengths(source)) == {"outer": 11 - 3, "inner": 2}


def test_functions_fit_on_a_screen():
    assert {name: lines for name, lines in LONG.items() if name not in LONGER} == {}


@pytest.mark.parametrize("name", LONGER, ids=":".join)
def test_the_longer_ones_are_still_longer(name):
    assert (PACKAGE / name[0]).is_file()
    assert name in LONG, "it is short now: take it off the list"

"""The table of findings holds all that `check` says, and what stands in it is run."""

import ast
from dataclasses import replace

import pytest

from rakelight import check_capture, refine
from rakelight.capture.video.report import REMEDIES
from rakelight.check import findings as table
from rakelight.check.findings import FINDINGS, Row, ordered
from rakelight.check.sharpness import edge_widths
from rakelight.errors import CaptureError
from rakelight.model import Finding
from tests.check.wrong_captures import sound
from tests.test_layers import PACKAGE, SOURCES, name_of

ONLY_REFINE_SAYS = {
    "albedo-bound", "depth-not-used", "depth-smoothed", "depth-weight", "first-photograph",
    "given-lights-unused",
    "narrow-beam", "room-light", "no-mesh", "normals-uncertain", "not-converged", "not-finite",
    "older-not-deleted", "refined-in-tiles", "thin-parts",
}  # fmt: skip
# Which argument is the code.
MADE_BY = {"Finding": 1, "refused_finding": 0}
# Calls whose code is not written in that file, and what it can be.
ELSEWHERE = {
    ("capture/loose_depth.py", "f.code"): set(),  # a finding said again
    ("capture/video/report.py", "code"): {f"frames-{n.replace(' ', '-')}" for n in REMEDIES},
    ("checkup/__init__.py", "code"): {"no-depth"},  # refused, of the table's codes
    ("checkup/verdict.py", "code"): set(),  # refused_finding itself
}


def strings(node, tree):
    """The texts that an expression can be, names looked up wherever the file assigns them."""
    if isinstance(node, ast.Constant):
        return {node.value}
    if isinstance(node, ast.IfExp):
        return strings(node.body, tree) | strings(node.orelse, tree)
    if not isinstance(node, ast.Name):
        return set()
    found = set()
    for target, value in assignments(tree):
        if isinstance(target, ast.Name) and target.id == node.id:
            found |= strings(value, tree)
    return found


def assignments(tree):
    """(target, value) of every assignment and loop over values that are written out."""
    pairs = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign):
            pairs += [(target, node.value) for target in node.targets]
        elif isinstance(node, ast.For | ast.comprehension) and isinstance(node.iter, ast.Tuple):
            pairs += [(node.target, each) for each in node.iter.elts]
    for target, value in pairs:
        if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
            pairs += zip(target.elts, value.elts, strict=True)
    return pairs


def codes_made(name, source):
    """The codes of all findings that a file makes."""
    tree, codes = ast.parse(source), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func) in MADE_BY:
            code = node.args[MADE_BY[ast.unparse(node.func)]]
            made = ELSEWHERE.get((name, ast.unparse(code)))
            made = strings(code, tree) if made is None else made
            assert made or (name, ast.unparse(code)) in ELSEWHERE, f"{name}:{node.lineno}"
            codes |= made
    return codes


def in_table():
    return [code for row in FINDINGS for code in row.codes]


def test_codes_are_found_however_they_are_written():
    source = """
NAMED = "named"
Finding("note", "written", "")
Finding("note", NAMED, "")
Finding("note", "one" if ONE else "other", "")
for code, count in (("in-a-loop", 1), ("last", 2)):
    Finding("note", code, "")
refused_finding("refused", error)
"""
    found = codes_made("a.py", source)
    assert found == {"written", "named", "one", "other", "in-a-loop", "last", "refused"}
    with pytest.raises(AssertionError, match=r"a\.py:1"):
        codes_made("a.py", "Finding('note', unknown, '')")


def test_the_table_holds_the_code_of_every_finding_that_check_says():
    made = set().union(*(codes_made(name_of(path), path.read_text()) for path in SOURCES))
    assert sorted(in_table()) == sorted(made - ONLY_REFINE_SAYS), "their place in the table?"
    assert made >= ONLY_REFINE_SAYS


def test_what_is_said_less_well_is_in_the_table():
    assert {code for row in FINDINGS for code in row.instead_of} <= set(in_table())


def test_every_check_is_in_the_table():
    """The checks of a capture, which are the functions that take a `Measured`."""
    written = set()
    for path in (PACKAGE / "check").glob("*.py"):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.FunctionDef) and "measured: Measured" in ast.unparse(node.args):
                written.add(node.name)
    assert len(written) == 11
    assert written == {row.check.__name__ for row in FINDINGS if row.check}


def test_what_says_more_is_said_instead():
    less, more, other = (Finding("note", code, "") for code in ("depth-missing", "black", "grey"))
    over, holes = (Finding("warning", code, "") for code in ("overexposed", "depth-holes"))
    assert ordered([other, more, less]) == (less, other, more)
    assert ordered([other, more, less, over]) == (over, less, other)
    assert ordered([other, more, less, holes]) == (holes, other, more)


def test_what_is_not_in_the_table_is_said_last():
    own, known = Finding("warning", "of-a-method-elsewhere", ""), Finding("warning", "grey", "")
    assert ordered([own, known]) == (known, own)


@pytest.fixture(scope="module")
def vase():
    return sound("vase")[0]


def with_row(monkeypatch, **flags):
    """A table whose third row is a check of the test's; the captures that it has seen."""
    seen = []

    def check(measured):
        seen.append(measured.names)
        return (Finding("warning", "too-soft", f"edges {measured(edge_widths).max():.0f} px"),)

    rows = (*FINDINGS[:2], Row(("too-soft",), check, **flags), *FINDINGS[2:])
    monkeypatch.setattr(table, "FINDINGS", rows)
    return seen


def test_a_check_in_the_table_is_run_by_check_alone(vase, monkeypatch):
    seen = with_row(monkeypatch)
    report = check_capture(vase)
    assert (report.findings[0].code, report.verdict, len(seen)) == ("too-soft", "usable", 1)
    assert "too-soft" not in {finding.code for finding in refine(vase).findings}
    assert len(seen) == 1


@pytest.mark.parametrize("stage", ["prepare", "method"])
def test_a_check_that_refine_is_to_run_is_run_by_both(vase, monkeypatch, stage):
    seen = with_row(monkeypatch, in_refine=stage)
    unnamed = replace(vase, names=())
    assert "too-soft" in {finding.code for finding in refine(unnamed).findings}
    assert check_capture(unnamed).findings[0].code == "too-soft"
    assert len(seen) == 2
    assert seen[0][3] == "photograph 3"


def test_with_a_finding_that_gains_nothing_a_capture_is_not_usable(vase, monkeypatch):
    with_row(monkeypatch, nothing_gained=True)
    report = check_capture(vase)
    assert report.verdict == "not usable"
    assert report.headline.startswith("not usable because edges")


def test_what_a_check_refuses_is_said_under_its_code(vase, monkeypatch):
    def refuses(measured):
        raise CaptureError("soft beyond use")

    monkeypatch.setattr(table, "FINDINGS", (*FINDINGS, Row(("too-soft", "softer"), refuses)))
    report = check_capture(vase)
    assert [each.code for each in report.findings if each.severity == "warning"] == ["too-soft"]
    assert report.headline == "not usable because soft beyond use"
    assert report.accuracy is None


def test_a_measure_is_taken_once_by_check(vase, monkeypatch):
    widths = []

    def counted(capture):
        widths.append(edge_widths(capture))
        return widths[-1]

    monkeypatch.setattr("rakelight.check.sharpness.edge_widths", counted)
    monkeypatch.setattr("rakelight.checkup.edge_widths", counted)
    check_capture(vase)
    assert len(widths) == 1

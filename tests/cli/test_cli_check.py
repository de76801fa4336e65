"""`rakelight check`: exit codes, what goes where."""

import io
import json
import re

import numpy as np
import pytest

from rakelight.capture import write_capture
from rakelight.checkup.report import CheckReport, PhotographCheck
from rakelight.cli.check import show
from tests.check.moved_captures import still_scene, with_depth_moved


@pytest.fixture(scope="module")
def lit(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lit") / "capture"
    write_capture(still_scene(photographs=8, size=0.2), folder, depth_scale=10_000)
    return folder


def test_the_first_line_is_the_verdict_and_each_photograph_has_one(run, refused, lit, tmp_path):
    # With a page, which is replaced only when asked, and only if a check wrote it.
    page = tmp_path / "check.html"
    ran = run("check", lit, "--html", page)
    assert (ran.code, ran.err) == (0, "")
    lines = ran.out.splitlines()
    assert re.match("good$|usable, with ", lines[0])
    assert sum(re.match(r"\s+\d{3}\.png\s", line) is not None for line in lines) == 8
    assert "the next light: from" in ran.out
    assert "expect: two thirds of the object within" in ran.out
    assert page.read_bytes().startswith(b"<!doctype html>")
    refused("check", lit, "--html", page, about=str(page), words=("--overwrite",))
    ran = run("check", lit, "--html", page, "--overwrite", "--quiet")
    assert (ran.code, ran.out) == (0, "")
    page.write_text("mine")
    refused("check", lit, "--html", page, "--overwrite", about=str(page))


def test_json(run, lit):
    told = json.loads(run("check", lit, "--json").out)
    assert told["schema"] == "rakelight-check/1"
    assert len(told["photographs"]) == 8


def test_a_page_in_no_folder_is_refused_before_the_check(refused, lit, tmp_path, monkeypatch):
    monkeypatch.setattr("rakelight.checkup.check_capture", None)
    nowhere = tmp_path / "nowhere/check.html"
    refused("check", lit, "--html", nowhere, about=str(nowhere), words=("make its folder",))


def test_what_cannot_be_refined_is_shown_and_ends_with_2(run, tmp_path):
    write_capture(with_depth_moved(still_scene(), 10, 0), tmp_path / "moved", depth_scale=10_000)
    ran = run("check", tmp_path / "moved")
    assert ran.code == 2
    assert ran.out.startswith("not usable because the depth map is not registered")
    assert ran.err.startswith("error: ")
    assert ran.err.count("\n") == 1


def test_a_capture_that_cannot_be_read_is_one_line(refused, capture):
    (capture / "capture.toml").unlink()
    refused("check", capture, about=str(capture))


def test_nothing_is_written_into_the_capture(refused, capture):
    inside = capture / "check.html"
    refused("check", capture, "--html", inside, about=str(inside))


CAMERA_NAME = "IMG_20261129_163310.png"


class Screen(io.TextIOWrapper):
    """What is printed, on a terminal or not, in letters of this encoding."""

    def __init__(self, terminal, encoding="utf-8"):
        super().__init__(io.BytesIO(), encoding, errors="backslashreplace")
        self.terminal = terminal

    def isatty(self):
        return self.terminal

    def lines(self):
        self.flush()
        shown = self.buffer.getvalue().decode(self.encoding)
        return [line.rstrip() for line in re.sub(r"\x1b\[[0-9;]*m", "", shown).splitlines()]


@pytest.fixture
def shown(monkeypatch):
    """The lines of a check of one photograph with marks, as a screen of some width shows them."""
    marks = ("does not fit the others", "under-exposed", "moved by 12.3 px")
    light = np.array([0.6, 0.0, -0.8])
    photograph = PhotographCheck(CAMERA_NAME, 1.0, 0.1, 0.5, 1.2, (3.0, -4.0), light, marks)
    report = CheckReport("usable", "usable", (), (photograph,), "multi-light")

    def shown(screen, columns):
        monkeypatch.setenv("COLUMNS", str(columns))
        monkeypatch.setattr("sys.stdout", screen)
        show(report)
        return screen.lines()

    return shown


@pytest.mark.parametrize("columns", [80, 50])
def test_names_and_numbers_are_never_cut(shown, columns):
    lines = shown(Screen(terminal=True), columns)
    row = lines.index(next(line for line in lines if CAMERA_NAME in line))
    cells = [*lines[row].split()[:7], " ".join(line[63:].strip() for line in lines[row:]).strip()]
    marks = "does not fit the others, under-exposed, moved by 12.3 px"
    assert cells == [CAMERA_NAME, "100%", "10%", "1.2", "5.0", "37°", "90°", marks]
    assert max(map(len, lines)) <= max(columns, 80)
    headings = " ".join(" ".join(lines[:row]).split())
    for word in ("photograph", "saturated", "black", "edges", "shift", "light", "axis", "from"):
        assert word in headings


def test_what_is_no_terminal_breaks_no_line(shown):
    (row,) = [line for line in shown(Screen(terminal=False), 40) if CAMERA_NAME in line]
    assert row.endswith(" does not fit the others, under-exposed, moved by 12.3 px")


def test_a_stream_without_the_sign_of_degrees_has_a_word(shown):
    text = "\n".join(shown(Screen(terminal=False, encoding="ascii"), 80))
    assert "37 deg" in text
    assert "\\x" not in text


@pytest.mark.parametrize("options", [(), ("--overwrite",)])
def test_a_folder_is_no_page(refused, capture, tmp_path, options):
    (tmp_path / "pages").mkdir()
    words = ("a folder stands where the page is to be written", "name a file in it")
    page = tmp_path / "pages"
    refused("check", capture, "--html", page, *options, about=page, words=words)

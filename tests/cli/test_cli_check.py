"""`rakelight check`: exit codes, what goes where."""

import json
import re

import pytest

from rakelight.capture import write_capture
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


def test_a_page_in_no_folder(refused, lit, tmp_path):
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

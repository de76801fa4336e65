"""The page of a check, in a browser and on the disk."""

from dataclasses import replace

import numpy as np
import pytest

from rakelight.check.next_lights import NextLight
from rakelight.checkup.report import CheckReport, PhotographCheck
from rakelight.errors import InputError, OutputExistsError
from rakelight.model import Camera, Capture, Finding
from rakelight.report.check_page import check_html, require_free_page, write_page
from tests.report.report_scenes import CONTRAST, HOSTILE

LEFT = np.array([-0.6, 0.0, -0.8])


def small_capture():
    photographs = np.tile(np.arange(40, dtype=np.uint8)[:, None, None] * 6, (2, 1, 60, 3))
    return Capture(
        photographs, np.ones((1, 40, 60), np.float32), np.ones((40, 60), bool),
        Camera(60, 40, 80.0, 80.0, 29.5, 19.5),
    )  # fmt: skip


def small_report(name="1.png"):
    photographs = (
        PhotographCheck("0.png", 0.0, 0.0, 0.5, 0.7, (0.0, 0.0), LEFT),
        PhotographCheck(name, 0.5, 0.0, 1.0, None, None, None, ("over-exposed", name)),
    )
    findings = (Finding("warning", "overexposed", f"over-exposed: {name}", "expose shorter"),)
    coming = (NextLight(np.array([0.6, 0.0, -0.8]), "from the right", 0.25),)
    return CheckReport(
        "usable", f"usable, with 1 warning; {name}", findings, photographs, "multi-light",
        next_lights=coming, source=f"captures/{name}",
    )  # fmt: skip


@pytest.fixture
def opened(browser, tmp_path):
    file = tmp_path / "check.html"
    file.write_bytes(check_html(small_report(), small_capture()))
    context = browser.new_context(offline=True, viewport={"width": 900, "height": 700})
    page, complaints = context.new_page(), []
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto(file.as_uri())
    yield page, complaints
    context.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out_from_its_ground(opened, scheme):
    page, _ = opened
    page.emulate_media(color_scheme=scheme)
    ratio, where = page.evaluate(CONTRAST)
    assert ratio >= 4.5, where


def test_the_page_in_a_browser(opened):
    page, complaints = opened
    assert page.locator("#verdict").inner_text() == "Usable, with 1 warning; 1.png"
    assert page.locator("#findings li").first.get_attribute("data-code") == "overexposed"
    assert page.locator("svg.plot .lamp").count() == 1
    light, coming = page.locator("svg.plot .lamp").bounding_box(), page.locator(".coming")
    axis = page.locator("svg.plot").bounding_box()
    middle = axis["x"] + axis["width"] / 2
    assert light["x"] + light["width"] < middle < coming.bounding_box()["x"]
    assert page.locator("figure.marked .mark").first.inner_text() == "over-exposed"
    shown = page.evaluate("[...document.images].map((each) => each.naturalWidth)")
    assert shown == [60, 60]
    assert page.evaluate("getComputedStyle(document.querySelector('.verdict')).fontWeight") == "600"
    assert not complaints


def test_a_narrow_screen_does_not_scroll_sideways(opened):
    page, _ = opened
    page.set_viewport_size({"width": 360, "height": 700})
    assert page.evaluate("document.documentElement.scrollWidth") <= 360


def test_hostile_names_are_escaped():
    page = check_html(small_report(HOSTILE), small_capture()).decode()
    assert "<script>alert" not in page
    assert "<img src=x" not in page
    assert "\u202e" not in page


def test_a_page_is_written_and_replaced_only_when_asked(tmp_path):
    file, page = tmp_path / "check.html", check_html(small_report(), small_capture())
    write_page(file, page)
    assert file.read_bytes() == page
    with pytest.raises(OutputExistsError, match="exists"):
        write_page(file, page)
    other = check_html(replace(small_report(), headline="good"), small_capture())
    write_page(file, other, overwrite=True)
    assert file.read_bytes() == other
    assert [path.name for path in tmp_path.iterdir()] == ["check.html"]


@pytest.mark.parametrize("kind", ["foreign", "changed", "empty", "link", "folder"])
def test_what_is_not_ours_is_never_replaced(tmp_path, kind):
    file, page = tmp_path / "check.html", check_html(small_report(), small_capture())
    if kind == "link":
        (tmp_path / "real.html").write_bytes(page)
        file.symlink_to(tmp_path / "real.html")
    elif kind == "folder":
        file.mkdir()
    else:
        changed = page.replace(b"1 warning", b"2 warning")
        file.write_bytes({"foreign": b"<p>mine</p>", "changed": changed, "empty": b""}[kind])
    before = None if kind == "folder" else file.read_bytes()
    words = "a folder stands" if kind == "folder" else "not written by rakelight"
    with pytest.raises(OutputExistsError, match=words):
        require_free_page(file, overwrite=True)
    with pytest.raises(OutputExistsError):
        write_page(file, page, overwrite=True)
    assert before is None or file.read_bytes() == before


def test_no_folder_is_a_clear_error(tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        write_page(tmp_path / "none" / "check.html", b"page")

"""index.html in a browser, and what it escapes."""

import numpy as np
import pytest

from rakelight.batch.page import index_html
from rakelight.batch.record import Entry, Figures
from rakelight.capture.images import encode_png
from rakelight.errors import OutputExistsError
from rakelight.report.sealed import require_free_page, write_page
from tests.report.report_scenes import HOSTILE


def figures(*warnings):
    return Figures(
        method="multi-light", photographs=5, size=(48, 36), pixels=1234, iterations=8,
        converged=True, prediction_error=0.0169, seconds=1.25, warnings=list(warnings),
    )  # fmt: skip


def done(name, *warnings):
    return Entry(source=f"/a/{name}", name=name, state="done", figures=figures(*warnings))


ENTRIES = [
    done("coin"),
    done("oven mitten #1", "the depth is shifted"),
    Entry(source="/a/bad", name="bad", state="failed", message="no depth", exit_code=2),
    Entry(source="/a/later", name="later"),
]


@pytest.fixture
def opened(browser, tmp_path):
    for entry in ENTRIES[:2]:
        (tmp_path / entry.name).mkdir()
        picture = encode_png(np.full((20, 30), 99, np.uint8))
        (tmp_path / entry.name / "preview.png").write_bytes(picture)
        (tmp_path / entry.name / "report.html").write_text(f"<title>{entry.name}</title>")
    write_page(tmp_path / "index.html", index_html(tmp_path, ENTRIES), kind="batch")
    context = browser.new_context(offline=True, viewport={"width": 900, "height": 700})
    page, complaints = context.new_page(), []
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto((tmp_path / "index.html").as_uri())
    yield page, complaints
    context.close()


def test_the_page_in_a_browser(opened):
    page, complaints = opened
    counts = page.locator("#counts").inner_text()
    assert counts == "4 captures: 2 refined, 1 of them with warnings, 1 failed, 1 still to do"
    page.wait_for_load_state("load")
    for picture in page.locator("img").all():
        picture.scroll_into_view_if_needed()
    page.evaluate("Promise.all([...document.images].map((each) => each.decode()))")
    assert page.evaluate("[...document.images].map((each) => each.naturalWidth)") == [30, 30]
    assert page.locator("#failed li").inner_text() == "bad no depth"
    assert page.locator("#waiting li").all_inner_texts() == ["later"]
    second = page.locator("#results article").nth(1)
    assert "the depth is shifted" in second.inner_text()
    assert "1,234 pixels of 48 × 36" in second.inner_text()
    assert "1.7 % off" in second.inner_text()
    assert not complaints
    second.locator("h3 a").click()
    assert page.title() == "oven mitten #1"


def test_a_narrow_screen_does_not_scroll_sideways(opened):
    page, _ = opened
    page.set_viewport_size({"width": 360, "height": 700})
    assert page.evaluate("document.documentElement.scrollWidth") <= 360


def test_hostile_names_are_escaped(tmp_path):
    entries = [
        done(HOSTILE, HOSTILE),
        Entry(source=HOSTILE, name=HOSTILE, state="failed", message=HOSTILE),
    ]
    page = index_html(tmp_path, entries).decode()
    assert "<script>alert" not in page
    assert "<img src=x" not in page
    assert "\u202e" not in page


def test_a_page_that_somebody_changed_stays(tmp_path):
    file = tmp_path / "index.html"
    write_page(file, index_html(tmp_path, ENTRIES), kind="batch")
    require_free_page(file, overwrite=True, kind="batch")
    with pytest.raises(OutputExistsError, match="the page of an earlier check"):
        require_free_page(file, overwrite=True)
    file.write_bytes(file.read_bytes().replace(b"1 failed", b"0 failed"))
    with pytest.raises(OutputExistsError, match="the page of an earlier batch"):
        require_free_page(file, overwrite=True, kind="batch")

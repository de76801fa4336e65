"""Debian's Chromium, drawing by software, and pages in it."""

import shutil
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import pytest

from rakelight.capture.images import decode_image
from rakelight.pictures.shown import object_window
from rakelight.report import report_html

SOFTWARE = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
# Counts what is drawn, before any script of the page runs.
COUNTER = """
window.drawn = 0;
const draw = WebGL2RenderingContext.prototype.drawElements;
WebGL2RenderingContext.prototype.drawElements = function (...what) {
  window.drawn += 1;
  return draw.apply(this, what);
};
window.violations = [];
document.addEventListener("securitypolicyviolation", (event) => {
  window.violations.push(event.effectiveDirective);
});
"""


@pytest.fixture(scope="module")
def launch():
    """Start the browser with further options."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("no chromium: apt install chromium")

    with playwright.sync_playwright() as running:
        start = partial(running.chromium.launch, executable_path=chromium)

        @contextmanager
        def launch(*options):
            browser = start(args=["--no-sandbox", *options])
            yield browser
            browser.close()

        yield launch


@pytest.fixture(scope="module")
def browser(launch):
    with launch(*SOFTWARE) as browser:
        yield browser


@dataclass
class Opened:
    """A report in the browser, and what happened there."""

    page: Any
    address: str
    requests: list = field(default_factory=list)
    dialogs: list = field(default_factory=list)
    complaints: list = field(default_factory=list)

    @property
    def state(self):
        return self.page.evaluate("document.documentElement.dataset.state")

    @property
    def box(self):
        return self.page.locator("#canvas").bounding_box()

    @cached_property
    def size(self):
        """(width, height) of the canvas; asking the browser every time is slow."""
        return self.box["width"], self.box["height"]

    def settle(self):
        """Wait until what was asked for has been drawn."""
        self.page.evaluate("new Promise(done => requestAnimationFrame(() => setTimeout(done)))")

    def picture(self):
        """(h, w, 3) what the canvas shows, nothing over it."""
        self.settle()
        # by script: the page's policy takes no style from outside
        show = """(what) => ["overlay", "wipe-handle", "legend"].forEach(
            (id) => { document.getElementById(id).style.visibility = what; })"""
        self.page.evaluate(show, "hidden")
        seen = decode_image(self.page.locator("#canvas").screenshot())[..., :3]
        self.page.evaluate(show, "")
        return seen

    def pixel_of(self, result, row, column):
        """(x, y) on the canvas of a pixel of the result in the first view: the camera's own."""
        rows, columns = object_window(result.mask)
        camera = result.camera.cropped(rows, columns)
        width, height = self.size
        fit = 0.94 * min(width / camera.width, height / camera.height)
        return (
            width / 2 + fit * (column - columns.start - (camera.width - 1) / 2),
            height / 2 + fit * (row - rows.start - (camera.height - 1) / 2),
        )

    def click(self, x, y):
        box = self.box
        self.page.mouse.click(box["x"] + x, box["y"] + y)


@pytest.fixture(scope="module")
def open_in(tmp_path_factory):
    """Write a report and open it in a browser."""

    def open_in(browser, result, truth=None, **context):
        file = tmp_path_factory.mktemp("report") / "report.html"
        file.write_bytes(report_html(result, truth))
        settings = {"viewport": {"width": 900, "height": 640}, "offline": True, **context}
        page = browser.new_context(**settings).new_page()
        opened = Opened(page, file.as_uri())

        def remember(request):
            if not request.url.startswith("data:"):
                opened.requests.append(request)

        page.on("request", remember)
        page.on("dialog", lambda dialog: (opened.dialogs.append(dialog.message), dialog.dismiss()))
        page.on("pageerror", lambda error: opened.complaints.append(str(error)))
        page.on("console", lambda message: opened.complaints.append(message.text))
        page.add_init_script(COUNTER)
        page.goto(opened.address)
        page.wait_for_selector("html:not([data-state=loading])", timeout=30_000)
        return opened

    return open_in


@pytest.fixture
def open_report(browser, open_in):
    """Open a report, and close it with the test."""
    pages = []

    def open_report(result, truth=None, **context):
        pages.append(open_in(browser, result, truth, **context))
        return pages[-1]

    yield open_report
    for opened in pages:
        opened.page.context.close()

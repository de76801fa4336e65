"""Size of the report of a large result, and the seconds until a browser has drawn it.

    python benchmarks/report_opening.py                     24 megapixels, 8 photographs, refined
    python benchmarks/report_opening.py --megapixels 4
    python benchmarks/report_opening.py out/*/report.html   of results that are there

A Chromium of the system, drawing by software, opens the file from disk; once before, so that
neither is read from it for the first time.  first_draw_s: until the viewer has drawn the surface
for the first time and that frame is over; ready_s: until the page says that all of it is there.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from large import FACTORS, SOURCE, measure, table, write_capture

SOFTWARE = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader")  # fmt: skip
# Notes when the first picture has been drawn, before any script of the page runs; by an attribute,
# for the page's policy lets nobody ask it by a script given as text.
WATCH = """
const draw = WebGL2RenderingContext.prototype.drawElements;
WebGL2RenderingContext.prototype.drawElements = function (...what) {
  WebGL2RenderingContext.prototype.drawElements = draw;
  draw.apply(this, what);
  this.finish();
  requestAnimationFrame(() => setTimeout(() => {
    document.documentElement.dataset.drawnAtMs = performance.now();
  }));
};
"""
LONGEST_MS = 120_000


def opened(browser: Any, report: Path) -> dict[str, float]:
    """Seconds from asking for the file."""
    page = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
    page.add_init_script(WATCH)
    began = time.perf_counter()
    page.goto(report.resolve().as_uri(), wait_until="commit")
    for what in ("[data-drawn-at-ms]", "[data-state=ready]"):
        page.wait_for_selector(f"html{what}", state="attached", timeout=LONGEST_MS)
    ready_s = time.perf_counter() - began
    first_draw_s = float(page.locator("html").get_attribute("data-drawn-at-ms")) / 1000
    page.context.close()
    return {"first_draw_s": first_draw_s, "ready_s": ready_s}


def rows_of(reports: list[Path], times: int) -> list[dict[str, Any]]:
    """A row for each report, the median of so many openings."""
    from playwright.sync_api import sync_playwright

    rows = []
    with sync_playwright() as running:
        start = running.chromium.launch
        browser = start(executable_path=shutil.which("chromium"), args=list(SOFTWARE))
        for report in reports:
            found = [opened(browser, report) for _ in range(times + 1)][1:]
            row: dict[str, Any] = {"report": str(report)}
            row["report_mb"] = round(report.stat().st_size / 1e6, 1)
            for name in found[0]:
                row[name] = round(statistics.median(each[name] for each in found), 2)
            row["slowest_s"] = round(max(each["ready_s"] for each in found), 2)
            rows.append(row)
        browser.close()
    return rows


def main() -> None:
    """Measure what the arguments ask for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("reports", nargs="*", type=Path, help="report.html of results")
    parser.add_argument("--megapixels", type=int, default=24, choices=[*FACTORS])
    parser.add_argument("--photographs", type=int, default=8)
    parser.add_argument("--memory", default="4GB", help="of the refinement")
    parser.add_argument("--times", type=int, default=3, help="how often each is opened")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    if shutil.which("chromium") is None:
        sys.exit("no chromium: apt install chromium")
    with tempfile.TemporaryDirectory() as scratch:
        reports = given.reports
        if not reports:
            sys.path.insert(0, str(SOURCE))
            capture, output = Path(scratch) / "capture", Path(scratch) / "out"
            write_capture(capture, FACTORS[given.megapixels], given.photographs)
            found = measure(capture, output, SOURCE, given.memory)
            if "failed" in found:
                sys.exit(found["failed"])
            reports = [output / "report.html"]
        rows = rows_of(reports, given.times)
    table(rows, given.json)


if __name__ == "__main__":
    main()

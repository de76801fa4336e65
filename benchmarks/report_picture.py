"""A picture of a result's report, taken in Debian's Chromium: python report_picture.py OUT PNG."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

SOFTWARE = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader"]


def main(result: Path, picture: Path) -> None:
    """Light the surface low from the left, half of it as it was before, and take the picture."""
    with sync_playwright() as running:
        browser = running.chromium.launch(
            executable_path=shutil.which("chromium"),
            args=[*SOFTWARE, "--enable-unsafe-swiftshader"],
        )
        page = browser.new_page(viewport={"width": 1180, "height": 800})
        page.goto((result / "report.html").resolve().as_uri())
        page.wait_for_selector("html[data-state=ready]")
        for key, value in (("azimuth", 300), ("elevation", 18), ("wipe", 0.4)):
            page.locator(f"#{key}").fill(str(value))
        page.locator("#wipe").blur()
        page.screenshot(path=picture)
        browser.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))

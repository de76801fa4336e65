"""report.html: a result to turn, relight and judge, in one page that needs no network.

`page.html` is the jinja2 template, `page.css` its style and `viewer/` its WebGL2 viewer; all of
it, the maps and the pictures are written into the page.  See docs/reference/report.md.
"""

from rakelight.report.page import report_html
from rakelight.report.saving import save_result

__all__ = ["report_html", "save_result"]

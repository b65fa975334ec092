"""Picture of a run's report as it is on paper: its first pages side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import pymupdf
from PIL import Image

from prooflight_studies.console.listeners import COOKIE
from prooflight_studies.screens.contact_sheets import as_png, side_by_side

if TYPE_CHECKING:
    from playwright.sync_api import Browser

    from prooflight_studies.screens.press_floor import Floor

PATH: Final = "/runs/1/report.pdf"
PAGES: Final = 2
DPI: Final = 90
"""Resolution at which the pages are drawn: text of 9 points can be read."""


def report_picture(browser: Browser, floor: Floor) -> bytes:
    """Return the first pages of the report that the console gives, as PNG."""
    context = browser.new_context(locale="en-GB")
    context.add_cookies([{"name": COOKIE, "value": floor.session, "url": floor.address}])
    answer = context.request.get(floor.address + PATH, timeout=0)
    document = pymupdf.open(stream=answer.body(), filetype="pdf")
    context.close()
    pages = [document[number].get_pixmap(dpi=DPI) for number in range(min(PAGES, len(document)))]
    return as_png(
        side_by_side([Image.frombytes("RGB", (page.width, page.height), page.samples) for page in pages])
    )

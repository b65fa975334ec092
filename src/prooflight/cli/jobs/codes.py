"""``prooflight codes``: the bar codes and matrix codes of a job, as this press's camera will read them."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

from prooflight.cli import show
from prooflight.cli.options import JobPath, Json, Pages, PressArtefact, Profile
from prooflight.reporting.wording import count

if TYPE_CHECKING:
    import typer

    from prooflight.detectors.verdict import Code
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

TOO_FINE = "not checked in scans: the resolution of this camera is too low"


def register(app: typer.Typer) -> None:
    """Add this command to the program."""
    app.command()(codes)


def codes(
    job: JobPath, press: PressArtefact, pages: Pages = None, profile: Profile = None, json: Json = False
) -> None:
    """List the bar codes and matrix codes of a job that inspection reads on every sheet.

    Each must read in the scan, to the same text, or the sheet is a misprint. Codes that this camera may fail
    to read are listed, and not required in scans.
    """
    from prooflight.pages.files import page_name
    from prooflight.pages.job import parse_pages
    from prooflight.press.artefact import Press
    from prooflight.press.pages import open_job

    loaded = Press.load(press)
    with open_job(job, loaded, profile=profile) as opened:
        numbers = parse_pages(pages, len(opened)) if pages else tuple(range(1, len(opened) + 1))
        walked = numbers if json else show.progress(numbers, total=len(numbers), what="reading codes")
        read_codes = [
            code for number in walked for code in _of_page(opened.page(number), page_name(number), loaded)
        ]
    if json:
        for name, one in read_codes:
            facts = asdict(one)
            del facts["read"]  # nothing was printed
            show.print_json({"page": name} | facts)
        return
    if not read_codes:
        show.people.print(f"{count(len(numbers), 'page')}: no code that this camera can read")
        return
    table = show.table_of(
        f"codes of {job.name}",
        ("page", "code", "text", "mm", "grade", ""),
        text_columns=("page", "code", "text", "mm", ""),
    )
    for name, one in read_codes:
        place = f"{one.width_mm:.0f} x {one.height_mm:.0f} at {one.x_mm:.0f}, {one.y_mm:.0f}"
        note = one.weakest if one.checked else TOO_FINE
        grade = "" if one.grade is None else f"{one.grade:.1f}"
        table.add_row(name, one.symbology, one.text, place, grade, note)
    show.people.print(table)


def _of_page(page: Page, name: str, press: Press) -> list[tuple[str, Code]]:
    from prooflight.detectors.base import PlannedPage
    from prooflight.inspection.codes.finding import page_codes
    from prooflight.inspection.codes.reading import foretold

    planned = PlannedPage(page, press.press_context())
    return [(name, foretold(code)) for code in page_codes(planned, press.sensors, press.geometry)]

"""Sheets and sets as a job's own files state them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.errors import RequestError
from prooflight.pages.files import write_tiff
from prooflight.pages.job import JobSource
from prooflight.pages.layout.layout import Layout
from prooflight.pages.layout.plan import SheetPlan
from prooflight.pages.pdf.facts import DocumentFacts
from prooflight.pages.raster import Page
from prooflight_line.cli.watch.job import copied, with_records

if TYPE_CHECKING:
    from pathlib import Path


def test_copies_are_counted_in_sheets(tmp_path: Path) -> None:
    for number in range(1, 6):
        blank = np.zeros((20, 20, 4), np.uint8)
        write_tiff(Page(cmyk=blank, dpi=100.0, name=f"p{number}", number=number), tmp_path / f"p{number}.tif")
    source = JobSource(path=tmp_path, dpi=100.0)
    assert copied(source, None, None) is None
    assert copied(source, None, 4) == 20
    assert copied(source, "sides=2,n-up=2x1", 4) == 8  # five pages need two sheets of four
    assert copied(source, "n-up=2x1,repeat=yes", 4) == 20
    with pytest.raises(RequestError):
        copied(source, "sides=3", 4)


def records(*pages: int) -> DocumentFacts:
    return DocumentFacts(condition="", record_pages=pages, spectra={})


def plan_of(layout: str, pages: int) -> SheetPlan:
    of_job = Layout.parse(layout).of(pages)
    sides = of_job.sides_of(pages)
    return SheetPlan(layout=of_job, sides=sides, sheets=sides // of_job.sides)


def test_records_of_one_length_are_sets() -> None:
    plan = with_records(None, records(2, 2, 2), pages=6, sheets=12)
    assert plan is not None
    assert (plan.layout.text, plan.sides, plan.sheets, plan.set_of(5)) == ("pages-a-set=2", 6, 12, 2)
    imposed = with_records(plan_of("sides=2,n-up=2x1", 8), records(4, 4), pages=4, sheets=None)
    assert imposed is not None
    assert imposed.layout.pages_a_set == 4


@pytest.mark.parametrize(
    ("facts", "layout", "pages"),
    [
        (None, None, 6),
        (records(), None, 6),
        (records(1, 1, 1), None, 3),  # each sheet is a set: nothing to put together
        (records(2, 4), None, 6),
        (records(2, 2), None, 6),  # pages outside all records
        (records(2, 2), "sides=2,n-up=2x1", 4),  # a record fills no whole sheet
        (records(2, 2), "pages-a-set=4", 4),  # the layout counts
    ],
)
def test_what_cannot_be_sets_leaves_the_plan(
    facts: DocumentFacts | None, layout: str | None, pages: int
) -> None:
    plan = None if layout is None else plan_of(layout, pages)
    assert with_records(plan, facts, pages=pages, sheets=None) == plan

"""Print job that the project makes itself: thirty A4 pages as a digital press would really print.

Everything in it is DeviceCMYK but for one spot colour.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from prooflight.files.atomic import whole_file
from prooflight.rng import stream
from prooflight.simulation.corpus.sample_job import (
    book,
    charts,
    copy_text,
    invoices,
    office,
    plates,
    quay,
    tints,
)
from prooflight.simulation.corpus.sample_job.sheet import Sheet


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampleJob:
    """Job as a file, with the titles of its pages."""

    path: Path
    page_count: int
    titles: tuple[str, ...]
    """Title of each page, in job order."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Section:
    pages: int
    draw: Callable[[Sheet], None]
    entry: tuple[str, str] | None = None
    """Title and summary in the table of contents."""


def make_sample_job(path: Path, *, seed: int = 1) -> SampleJob:
    """Write the sample job as a PDF; the same seed gives the same bytes.

    ``seed`` sets names, amounts and prices in the commercial pages. Book and photographs stay the same.
    """
    rng = stream(seed, "sample-job")
    with whole_file(path) as unfinished:
        sheet = Sheet(unfinished, copy_text.TITLE)
        for section in _sections(rng):
            first = sheet.number
            section.draw(sheet)
            if sheet.number - first != section.pages:
                message = f"a section drew {sheet.number - first} pages where {section.pages} were planned"
                raise RuntimeError(message)
        sheet.finish()
    return SampleJob(path=path, page_count=sheet.number, titles=tuple(sheet.titles))


def _sections(rng: np.random.Generator) -> list[_Section]:
    stock_rng, invoice_rng, chart_rng = rng.spawn(3)
    lots = quay.stock(stock_rng)
    run = invoices.draw_up(lots, invoice_rng)
    sections = [
        *(
            _Section(pages=2, draw=partial(book.chapter, text=text), entry=(text.title, text.summary))
            for text in copy_text.CHAPTERS
        ),
        _Section(pages=1, draw=book.glossary, entry=("Words of the trade", "A glossary")),
        _Section(pages=1, draw=plates.single, entry=("Plates", "An eye, a contact sheet and a cat")),
        _Section(pages=1, draw=plates.contact_sheet),
        _Section(pages=1, draw=plates.wrapped),
        _Section(pages=1, draw=plates.brochure, entry=("A leaflet and a lecture", "Full bleeds")),
        _Section(pages=1, draw=plates.night_launch),
        _Section(
            pages=1,
            draw=partial(office.price_list, lots=lots),
            entry=("Paperwork", "A list, a form, a letter"),
        ),
        _Section(pages=1, draw=office.form),
        _Section(pages=1, draw=office.letter),
        *(
            _Section(
                pages=1,
                draw=partial(invoices.draw, invoice=invoice),
                entry=("Invoices", "Six, no two alike") if invoice is run[0] else None,
            )
            for invoice in run
        ),
        _Section(pages=1, draw=partial(charts.page, rng=chart_rng), entry=("Charts", "The year in figures")),
        _Section(
            pages=1, draw=tints.wedges, entry=("Test forms", "Wedges, gradients, two blacks, a fifth ink")
        ),
        _Section(pages=1, draw=tints.gradients),
        _Section(pages=1, draw=tints.two_blacks),
        _Section(pages=1, draw=tints.spot_page),
        _Section(pages=1, draw=tints.poster, entry=("A poster", "Flat colours")),
    ]
    entries = []
    page = 4
    for section in sections:
        if section.entry is not None:
            entries.append((*section.entry, page))
        page += section.pages
    front = [
        _Section(pages=1, draw=book.cover),
        _Section(pages=1, draw=book.title_page),
        _Section(pages=1, draw=partial(book.contents, entries=entries)),
    ]
    return front + sections

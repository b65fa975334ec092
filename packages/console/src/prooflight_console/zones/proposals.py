"""Zones that a page proposes, which a person may accept or leave."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from prooflight.errors import ProoflightError
from prooflight.inspection.codes.finding import code_zones
from prooflight.pages.job import JobSource
from prooflight.pages.zones.rules import Rules, entry_of
from prooflight.press.artefact import Press
from prooflight.press.pages import job_source

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.pages.pdf.rip import PageMarks
    from prooflight.pages.zones.zone import Box
    from prooflight.pages.zones.zones_file import ZoneEntry

Source = Literal["box", "layer", "annotation", "code"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """One zone that a page proposes."""

    source: Source
    zone: ZoneEntry


def proposals_of(job: Path, number: int, press: Path | None, dpi: float) -> list[Proposal]:
    """Return the proposals of page ``number``, from 1; called in a process of its own.

    The area outside the BleedBox and under annotations is proposed to be ignored; layers and bar codes to be
    careful. press: whose camera must read the codes; None for no codes. dpi: resolution of a page without a
    press. Raises the errors of ``Job.page`` and ``Press.load``.
    """
    loaded = None if press is None else Press.load(press)
    source = JobSource(path=job, dpi=dpi) if loaded is None else job_source(job, loaded)
    with source.open() as opened:
        size, marks = opened.page_size_mm(number), opened.marks(number)
        proposals = [] if marks is None else _of_marks(marks, number, size)
        if loaded is None:
            return proposals
        with contextlib.suppress(ProoflightError):  # this press cannot print the page: no codes
            proposals += [Proposal(source="code", zone=zone) for zone in code_zones(opened, number, loaded)]
    return proposals


def _of_marks(marks: PageMarks, number: int, size_mm: tuple[float, float]) -> list[Proposal]:
    outside = Rules(outside_bleed="ignore").entries(marks, number, size_mm)
    proposals = [Proposal(source="box", zone=zone) for zone in outside]
    named: list[tuple[Source, str, Box]] = [("layer", name, box) for name, box in marks.layers]
    named += [
        ("annotation", next(filter(None, reversed(names)), "annotation"), box)
        for names, box in marks.annotations
    ]
    for source, name, box in named:
        zone = entry_of(name, "careful" if source == "layer" else "ignore", box, number, size_mm)
        proposals += [] if zone is None else [Proposal(source=source, zone=zone)]
    return proposals

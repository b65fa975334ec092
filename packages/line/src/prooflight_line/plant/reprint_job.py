"""A reprint as a job: the pages of all sheets to print again as one PDF, and what is left when it has been printed.

The job's sheets are those of the reprint list, in its order, each once. A run that prints it with the layout of
the first run has its own reprint list, whose sheets are by their numbers those of the job that must be printed
once more.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

from prooflight.errors import RequestError
from prooflight.files.given import GivenFiles

if TYPE_CHECKING:
    from prooflight_line.journal.records import RunRow
    from prooflight_line.plant.reprinting import Reprint, ReprintList

REMEDY: Final = "give the .json that `prooflight run reprint-job` wrote next to its PDF"
LISTS: Final = GivenFiles(error=RequestError, remedy=REMEDY, largest_mb=200)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReprintSheet:
    """One sheet of the job, and its place in the stack of the first run."""

    run_sheet: int
    """Number of the sheet in the first run, from 0."""
    copy: int
    number: int
    """Number of the sheet in the first job, from 1."""
    page: str
    pages: tuple[int, ...]
    """Its pages in the first job, from 1."""
    set_number: int
    behind: str
    """Name of the sheet that it follows in the good tray; empty: it is below all others."""

    @classmethod
    def of(cls, one: Reprint) -> Self:
        """Return a sheet of a reprint list."""
        return cls(**{field.name: getattr(one, field.name) for field in fields(cls)})


@dataclass(frozen=True, slots=True, kw_only=True)
class ReprintJob:
    """The job, as it is stored beside its PDF."""

    run: int
    """Number of the first run in its journal."""
    started_s: float
    """When the first run began. Unix time. [s]"""
    job: str
    job_digest: str
    """SHA-256 of the PDF, by which the run that prints it is known (``files.content.content_digest``)."""
    sheets: tuple[ReprintSheet, ...]

    @property
    def pages(self) -> list[int]:
        """Pages of the first job, from 1, in the order of the PDF."""
        return [page for sheet in self.sheets for page in sheet.pages]

    @property
    def text(self) -> str:
        """Return the job as JSON."""
        return json.dumps(asdict(self), indent=1) + "\n"

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read what ``text`` gave; RequestError: it is something else."""
        try:
            stored = json.loads(LISTS.read_text(path))
            sheets = tuple(
                ReprintSheet(**one | {"pages": tuple(map(int, one["pages"]))}) for one in stored["sheets"]
            )
            return cls(**stored | {"sheets": sheets})
        except OSError as error:
            raise RequestError(path, "cannot be read", remedy=REMEDY) from error
        except (ValueError, TypeError, KeyError, RecursionError):
            raise RequestError(path, "is not a reprint job", remedy=REMEDY) from None


def reprint_sheets(listed: ReprintList) -> tuple[ReprintSheet, ...]:
    """Return the sheets of a reprint list as those of a job.

    RequestError: there are none, or one has blank pages, which no page of the PDF could stand for.
    """
    sheets = tuple(map(ReprintSheet.of, listed.all()))
    if not sheets:
        raise RequestError("run reprint-job", "there is nothing to print again", remedy="no job is needed")
    full = listed.plan.layout.pages_a_sheet
    for sheet in sheets:
        if len(sheet.pages) != full:
            what = f"sheet {sheet.number} of copy {sheet.copy} has {len(sheet.pages)} of {full} pages"
            raise RequestError("run reprint-job", what, remedy="print it again from the job itself")
    return sheets


def remaining(job: ReprintJob, run: RunRow, listed: ReprintList) -> tuple[ReprintSheet, ...]:
    """Return the sheets that must be printed once more after a run of the job.

    listed: the reprint list of that run. RequestError: it printed another job.
    """
    if run.facts.job_digest != job.job_digest:
        what = f"run {run.id} printed {run.facts.job}, and not this job"
        raise RequestError("run reprinted", what, remedy="give the run that printed the reprint job")
    lacking = {one.run_sheet for one in listed.all()}
    return tuple(sheet for at, sheet in enumerate(job.sheets) if at in lacking)


def facts_of(job: ReprintJob, left: tuple[ReprintSheet, ...]) -> dict[str, Any]:
    """Return for programs what is left of a job."""
    return {
        "run": job.run,
        "job": job.job,
        "sheets": len(job.sheets),
        "left": len(left),
        "reprints": [asdict(one) for one in left],
    }

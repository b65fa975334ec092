"""Plan of a run's sheets: the side that passes at each position, its sheet and set, and the places of its pages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

from prooflight.pages.layout.imposing import Place, places_on, side_size
from prooflight.pages.layout.layout import Layout


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetPlan:
    """A job on the sheets of one run; numbers of the run's sheets count from 0."""

    layout: Layout
    sides: int
    """Sides of one copy of the job."""
    sheets: int
    """Sheets of the run."""
    page_mm: tuple[float, float] | None = None
    """Width and height of a page; None: not known, or not the same for all pages. [mm]"""
    laid_turned: bool = False
    """Whether sides enter the press turned by 90 degrees, because they fit in no other way
    (``ScanGeometry.lay``)."""

    @classmethod
    def of(cls, facts: object) -> Self | None:
        """Return the plan from the result of ``facts``; None if the run had no sheets, or the facts cannot be read."""
        if not isinstance(facts, dict):
            return None
        try:
            size, pages = facts["page_mm"], facts.get("job_pages")
            plan = cls(
                layout=replace(Layout.parse(facts["words"]), job_pages=None if pages is None else int(pages)),
                sides=int(facts["sides"]),
                sheets=int(facts["sheets"]),
                page_mm=None if size is None else (float(size[0]), float(size[1])),
                laid_turned=bool(facts["laid_turned"]),
            )
        except (KeyError, TypeError, ValueError, IndexError, AttributeError):
            return None
        return plan if plan.sides > 0 and plan.sheets > 0 else None

    @property
    def facts(self) -> dict[str, Any]:
        """Content of the plan that JSON can hold, for a run's settings and its gate's log."""
        return {
            "words": self.layout.text,
            "job_pages": self.layout.job_pages,
            "sides": self.sides,
            "sheets": self.sheets,
            "page_mm": self.page_mm,
            "laid_turned": self.laid_turned,
        }

    @property
    def passings(self) -> int:
        """Number of sides that pass the camera."""
        return self.sheets * self.layout.sides

    @property
    def sheets_a_job(self) -> int:
        """Sheets of one copy of the job."""
        return self.sides // self.layout.sides

    def side_at(self, position: int) -> int:
        """Return the side of the run that passes at a position."""
        return self.layout.side_at(position, self.sheets)

    def number_at(self, position: int) -> int:
        """Return the side of the job, from 1, that passes at a position."""
        return self.side_at(position) % self.sides + 1

    def sheet_at(self, position: int) -> tuple[int, int]:
        """Return the sheet of the run, and 0 for its front or 1 for its back."""
        return divmod(self.side_at(position), self.layout.sides)

    def positions(self, sheet: int) -> tuple[int, ...]:
        """Return the positions at which the sides of a sheet pass, front first."""
        sides = self.layout.sides
        return tuple(self.layout.position_of(sheet * sides + side, self.sheets) for side in range(sides))

    def name(self, sheet: int) -> str:
        """Return the name of a sheet of the run, for people."""
        return self.layout.sheet_name(sheet % self.sheets_a_job + 1)

    def pages(self, sheet: int) -> tuple[int, ...]:
        """Return the numbers of the job's pages on a sheet, from 1, each once."""
        sides, first = self.layout.sides, sheet % self.sheets_a_job * self.layout.sides
        numbers = [page for side in range(sides) for page in self.layout.pages_on(first + side + 1)]
        return tuple(dict.fromkeys(page for page in numbers if page is not None))

    def set_of(self, sheet: int) -> int | None:
        """Return the set of a sheet; None if the job has no sets."""
        of_set = self.layout.sheets_a_set
        return None if of_set is None else sheet // of_set

    def sheets_of(self, set_number: int) -> range:
        """Return the sheets of a set."""
        of_set = self.layout.sheets_a_set or 1
        return range(set_number * of_set, min((set_number + 1) * of_set, self.sheets))

    def places(self, *, back: bool) -> list[Place]:
        """Return the places of the pages of a side as the camera sees it, in the order of ``Layout.pages_on``. [mm]

        The list is empty if the size of the pages is not known.
        """
        if self.page_mm is None:
            return []
        side_mm = side_size(self.page_mm, self.layout)
        places = places_on(self.page_mm, side_mm, self.layout.gutter_mm, self.layout, back=back)
        return [place.turned(*side_mm) for place in places] if self.laid_turned else places


def facts_plan(settings: Mapping[str, Any]) -> SheetPlan | None:
    """Return the plan of a run's settings; None if its job was not imposed on sheets."""
    return SheetPlan.of(settings.get("layout"))

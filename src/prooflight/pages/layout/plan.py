"""A run's sheets: which side passes when, on which sheet and in which set it is, and where its pages lie."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

from prooflight.pages.layout.imposing import Place, places_on, side_size
from prooflight.pages.layout.layout import Layout

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetPlan:
    """A job on the sheets of one run; what it says of a run's sheets counts from 0."""

    layout: Layout
    sides: int
    """Of one copy of the job."""
    sheets: int
    """Of the run."""
    page_mm: tuple[float, float] | None = None
    """Width and height of a page; None: nobody knows, or they are not all alike. [mm]"""
    laid_turned: bool = False
    """Whether sides enter the press turned by 90 degrees, because only so they fit (``ScanGeometry.lay``)."""

    @classmethod
    def of(cls, facts: object) -> Self | None:
        """From what ``facts`` gave; None: the run was none of sheets, or nobody can read what it says."""
        if not isinstance(facts, dict):
            return None
        try:
            size, pages = facts["page_mm"], facts.get("job_pages")
            found = cls(
                layout=replace(Layout.parse(facts["words"]), job_pages=None if pages is None else int(pages)),
                sides=int(facts["sides"]),
                sheets=int(facts["sheets"]),
                page_mm=None if size is None else (float(size[0]), float(size[1])),
                laid_turned=bool(facts["laid_turned"]),
            )
        except (KeyError, TypeError, ValueError, IndexError, AttributeError):
            return None
        return found if found.sides > 0 and found.sheets > 0 else None

    @property
    def facts(self) -> dict[str, Any]:
        """What JSON can hold; for a run's settings and its gate's log."""
        return {
            "words": self.layout.words,
            "job_pages": self.layout.job_pages,
            "sides": self.sides,
            "sheets": self.sheets,
            "page_mm": self.page_mm,
            "laid_turned": self.laid_turned,
        }

    @property
    def passings(self) -> int:
        """How often the camera sees a side."""
        return self.sheets * self.layout.sides

    @property
    def sheets_a_job(self) -> int:
        """Sheets of one copy of the job."""
        return self.sides // self.layout.sides

    def side_at(self, position: int) -> int:
        """Which side of the run passes at a position."""
        return self.layout.side_at(position, self.sheets)

    def number_at(self, position: int) -> int:
        """Which side of the job passes, from 1."""
        return self.side_at(position) % self.sides + 1

    def sheet_at(self, position: int) -> tuple[int, int]:
        """Sheet of the run, and 0 for its front or 1 for its back."""
        return divmod(self.side_at(position), self.layout.sides)

    def positions(self, sheet: int) -> tuple[int, ...]:
        """When the sides of a sheet pass, front first."""
        sides = self.layout.sides
        return tuple(self.layout.position_of(sheet * sides + side, self.sheets) for side in range(sides))

    def name(self, sheet: int) -> str:
        """Of a sheet of the run, for people."""
        return self.layout.sheet_name(sheet % self.sheets_a_job + 1)

    def pages(self, sheet: int) -> tuple[int, ...]:
        """Numbers of the job's pages on a sheet, from 1, each once."""
        sides, first = self.layout.sides, sheet % self.sheets_a_job * self.layout.sides
        found = [page for side in range(sides) for page in self.layout.pages_on(first + side + 1)]
        return tuple(dict.fromkeys(page for page in found if page is not None))

    def set_of(self, sheet: int) -> int | None:
        """Set of a sheet; None: the job has none."""
        of_set = self.layout.sheets_a_set
        return None if of_set is None else sheet // of_set

    def sheets_of(self, set_number: int) -> range:
        """Sheets of a set."""
        of_set = self.layout.sheets_a_set or 1
        return range(set_number * of_set, min((set_number + 1) * of_set, self.sheets))

    def places(self, *, back: bool) -> list[Place]:
        """Where the pages of a side lie as the camera sees it, in the order of ``Layout.pages_on``. [mm]

        Empty: the size of the pages is not known.
        """
        if self.page_mm is None:
            return []
        side_mm = side_size(self.page_mm, self.layout)
        found = places_on(self.page_mm, side_mm, self.layout.gutter_mm, self.layout, back=back)
        return [place.turned(*side_mm) for place in found] if self.laid_turned else found


def facts_plan(settings: Mapping[str, Any]) -> SheetPlan | None:
    """Of a run's settings; None: its job was laid on no sheets."""
    return SheetPlan.of(settings.get("layout"))

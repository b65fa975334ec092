"""The option ``--layout`` of commands on jobs: imposition of pages on sheets."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from rich.text import Text

from prooflight.cli import faults, show
from prooflight.errors import visible

if TYPE_CHECKING:
    from prooflight.detectors.disposition import Disposition
    from prooflight.detectors.verdict import Verdict
    from prooflight.inspection.sheets import Counts, SetVerdict, SheetVerdict
    from prooflight.pages.job import JobSource
    from prooflight.pages.layout.plan import SheetPlan
    from prooflight.scans.geometry import ScanGeometry


def imposed(
    job: JobSource, layout_text: str | None, geometry: ScanGeometry, *, sheets: int | None = None
) -> tuple[JobSource, SheetPlan | None]:
    """Return the job as sides, and the plan of its sheets; None: no layout was given, and pages are printed
    as they are.

    ``sheets`` is the number of sheets of the run; None: the job once. Places that stay blank are reported.
    Errors as ``planned``.
    """
    if layout_text is None:
        return job, None
    from prooflight.pages.layout.layout import Layout
    from prooflight.press.sheets import planned

    layout = Layout.parse(layout_text)
    with job.open() as opened:
        plan = planned(opened, layout, geometry, sheets=sheets)
    if blank := plan.layout.blank_places:
        faults.report(
            f"the last of the job's {plan.sheets_a_job:,} sheets has {plan.layout.pages_a_sheet} places, "
            f"of which {blank} must stay blank"
        )
    return replace(job, layout=plan.layout), plan


@dataclass(frozen=True, slots=True, kw_only=True)
class _Side:
    """Side of a job that was inspected once; ``inspection.sheets.SideRow``."""

    sheet: int
    job_page: int
    verdict: Verdict
    faults: tuple[str, ...] = ()

    @property
    def disposition(self) -> Disposition:
        """Disposition of the sheet: no gate decides."""
        from prooflight.detectors.disposition import without_gate

        return without_gate(self.verdict, self.faults)[0]


def of_job(plan: SheetPlan, verdicts: Sequence[Verdict]) -> list[SheetVerdict | SetVerdict]:
    """Return the sheets and sets of a job that was inspected once, from the verdicts on its sides in their order."""
    from prooflight.inspection.sheets import Assembling

    assembling, parts = Assembling(plan), list["SheetVerdict | SetVerdict"]()
    for position in range(plan.passings):
        side = plan.side_at(position)
        verdict = verdicts[side]
        parts += assembling.add(_Side(sheet=side, job_page=position, verdict=verdict))
    return parts + assembling.end()


def print_job(parts: Sequence[SheetVerdict | SetVerdict], *, json: bool) -> None:
    """Print the sheets and sets of a job."""
    from prooflight.inspection.sheets import Counts

    if not json:
        print_sheets(parts, Counts.of(parts))
        return
    for one in parts:
        show.print_json(sheet_facts(one))


def sheet_facts(part: SheetVerdict | SetVerdict) -> dict[str, Any]:
    """Return a sheet or a set for programs: ``{"sheet_verdict": ...}`` or ``{"set_verdict": ...}``."""
    from prooflight.inspection.sheets import SheetVerdict

    if isinstance(part, SheetVerdict):
        more: dict[str, Any] = {"bad_pages": part.bad_pages, "doubled": part.doubled}
        more["disposition"] = part.disposition
        return {"sheet_verdict": asdict(part) | more | {"out_of_order": part.out_of_order}}
    return {"set_verdict": asdict(part) | {"complete": part.complete}}


def print_sheets(
    parts: Iterable[SheetVerdict | SetVerdict], counts: Counts, *, last: int | None = None
) -> None:
    """Print sheets and sets that are not clean, and the counts, for people; ``last`` limits the rows of each table."""
    from prooflight.inspection.sheets import SheetVerdict

    spoiled = [one for one in parts if not one.clean]
    sheets = [one for one in spoiled if isinstance(one, SheetVerdict)]
    sets = [one for one in spoiled if not isinstance(one, SheetVerdict)]
    if sheets:
        text_columns = ("name", "verdict", "bad pages", "why")
        table = show.table_of("Sheets to check", ("sheet", "copy", *text_columns), text_columns=text_columns)
        for one in sheets[-last if last else 0 :]:
            table.add_row(
                str(one.sheet),
                str(one.copy),
                visible(one.name),
                Text(one.verdict, style=show.VERDICT_STYLE[one.verdict]),
                ", ".join(map(str, one.bad_pages)),
                visible("; ".join(one.why)),
            )
        show.people.print(table)
    if sets:
        of_sets = ("verdict", "why")
        table = show.table_of("Sets to check", ("set", *of_sets), text_columns=of_sets)
        for own in sets[-last if last else 0 :]:
            style = show.VERDICT_STYLE[own.verdict]
            table.add_row(str(own.set_number), Text(own.verdict, style=style), "; ".join(own.why))
        show.people.print(table)
    show.people.print(sheets_line(counts))


def sheets_line(counts: Counts) -> str:
    """Return the number of sheets and sets of each kind, in one line."""
    parts = [_of("sheet", counts.sheets)]
    if any(counts.sets.values()):
        parts.append(f"{_of('set', counts.sets)}, {counts.spoiled:,} not to be delivered as they are")
    return "; ".join(parts)


def _of(what: str, counts: dict[Any, int]) -> str:
    from prooflight.reporting.wording import count

    bad, unseen = counts["misprint"], counts["not-inspected"]
    return ", ".join(
        [
            count(sum(counts.values()), what),
            f"{counts['good']:,} good",
            *([count(bad, "misprint")] if bad else []),
            *([f"{unseen:,} not inspected"] if unseen else []),
        ]
    )

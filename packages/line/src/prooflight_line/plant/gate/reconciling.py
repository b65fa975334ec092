"""Account of every sheet of a run, from journal, gate's log, and the trays as the controller logged them.

A controller's row names session and tag where it found a result, and always its encoder's count. A row
without a tag is assigned to the sheet whose expected count at the gate differs from that count by no more
than the tolerance, if only one sheet between the neighbouring rows does. If all sheets between two neighbours
went into one tray, their order does not matter. The trays that the controller reported over the wire fill the
gaps of its log, and are compared with it.
"""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, Literal

from prooflight.errors import RequestError
from prooflight.files.given import GivenFiles
from prooflight.inspection.sheets import worst
from prooflight.pages.layout.plan import SheetPlan
from prooflight_line.plant.gate.deciding import CODE_TEXTS
from prooflight_line.plant.gate.registers import Code, Result, count_distance

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from prooflight.detectors.verdict import VerdictName
    from prooflight_line.journal.records import PageRecord
    from prooflight_line.plant.gate.log import LoggedDecisions

Account = Literal["accepted", "diverted", "lost", "unseen", "not-at-gate", "did-not-come", "wrong"]
TraySource = Literal["file", "wire"]
"""Source from which trays are known: the controller's log file, or its reports over the wire."""
COLUMNS: Final = ("session", "tag", "tray", "count")
TRAY_FILES: Final = GivenFiles(
    error=RequestError,
    remedy=f"give the controller's log: JSON lines or CSV with {', '.join(COLUMNS)}",
    largest_mb=4000,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Tray:
    """A sheet at the gate, as the controller logged it."""

    session: int
    tag: int
    tray: str
    count: int
    why: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Accounted:
    """Account of one sheet."""

    account: Account
    sheet: int | None = None
    """Number of the sheet in the run; None: the run has no such sheet."""
    job_page: int | None = None
    page: str = ""
    set_number: int = 0
    verdict: str = ""
    """Verdict; empty: the sheet was not judged."""
    in_journal: bool = False
    decision: str = ""
    """accept, divert or stop; empty: there is no decision."""
    tray: str = ""
    """good or reject; empty: the sheet was not seen at the gate."""
    why: str = ""
    contested: bool = False
    """Whether the controller named two trays: one over the wire and another in its log, or both in its log."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Disagreement:
    """A sheet for which the controller's log and its reports over the wire differ."""

    sheet: int
    wire: str
    """Tray over the wire: good or reject."""
    file: str
    """Tray in the log: good or reject; empty: the log has no row of the sheet."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reconciliation:
    """Account of all sheets of one run."""

    sheets: tuple[Accounted, ...]
    tolerated: bool
    """Whether the press file lets sheets in doubt pass (policy accept)."""
    counts: Counter[str] = field(default_factory=Counter)
    off_mm: tuple[float, ...] = ()
    """Offset of each sheet from its expected position at the gate, where the controller logged its count;
    positive: it came late. [mm]"""
    source: TraySource = "wire"
    disagreements: tuple[Disagreement, ...] = ()
    """Differences between the controller's log and the wire; empty without a log."""

    @property
    def wrong(self) -> tuple[Accounted, ...]:
        """Sheets in the good tray that must not be there."""
        return tuple(one for one in self.sheets if one.account == "wrong")

    @property
    def open(self) -> tuple[Accounted, ...]:
        """Sheets that were judged and that were not seen at the gate."""
        return tuple(one for one in self.sheets if one.account == "not-at-gate")

    @property
    def lost_by(self) -> Counter[str]:
        """Number of good sheets that were lost, by reason."""
        return Counter(one.why for one in self.sheets if one.account == "lost")


def read_trays(path: Path) -> list[Tray]:
    """Read a controller's log, JSON lines or CSV; its end may be incomplete.

    RequestError: the file is neither, or lacks a column.
    """
    try:
        text = TRAY_FILES.read_text(path)
    except OSError as error:
        raise RequestError(path, "cannot be read", remedy=TRAY_FILES.remedy) from error
    trays = []
    for number, row in enumerate(_rows(text, path), start=1):
        try:
            tray = str(row["tray"])
            session, tag, count = (int(row[name]) for name in ("session", "tag", "count"))
            why = str(row.get("why") or "")
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise RequestError(path, f"row {number}: {error}", remedy=TRAY_FILES.remedy) from error
        if tray not in ("good", "reject"):
            raise RequestError(path, f"row {number}: tray is {tray!r}", remedy="good and reject are allowed")
        trays.append(Tray(session=session, tag=tag, tray=tray, count=count, why=why))
    return trays


def of_run(trays: Sequence[Tray], sessions: Iterable[int]) -> list[Tray]:
    """Return the rows of a run.

    They begin after the last row of an earlier session and end before the first row of a later one; rows of
    other sessions are left out. Rows without a session at the start of the log belong to the run if no other
    session precedes it.
    """
    own = set(sessions)
    at = [number for number, tray in enumerate(trays) if tray.session in own]
    if not at:
        return []
    first, last = at[0], at[-1]
    others = [number for number, tray in enumerate(trays) if tray.session and tray.session not in own]
    since = first if any(number < first for number in others) else 0
    until = min((number for number in others if number > last), default=len(trays))
    return [tray for tray in trays[since:until] if not tray.session or tray.session in own]


def reconciled(
    pages: Iterable[PageRecord], gate_log: LoggedDecisions, trays: Sequence[Tray] | None
) -> Reconciliation:
    """Account for a run's sheets.

    ``trays`` is the controller's log. If it is None or has no row of the run, the controller's reports over
    the wire are used, which may have gaps.
    """
    journal = {page.sheet + 1: page for page in pages}
    settings = gate_log.began.get("settings", {})
    tolerance = settings.get("tolerance_mm", 0.0) * settings.get("plc", {}).get("counts_per_mm", 0.0)
    tolerated = settings.get("policy") == "accept"
    plan = SheetPlan.of(gate_log.began.get("layout"))
    rows = of_run([row for row in trays or () if _fits(row, gate_log, tolerance)], gate_log.sessions)
    at_gate, unknown_rows = _assigned(gate_log, rows, tolerance)
    disagreements = _disagreements(gate_log, at_gate) if rows else ()
    contested = {one.sheet + 1 for one in disagreements if one.file}
    contested |= {tag for tag, logged in at_gate.items() if len({row.tray for row in logged}) > 1}
    for tag, one in _wire_trays(gate_log).items():
        at_gate.setdefault(tag, [one])
    rows_of = {
        tag: [row + 1 for row in decided.get("rows", ())] for tag, decided in gate_log.decisions.items()
    }
    with_others = {row for tag, rows in rows_of.items() for row in rows} - gate_log.decisions.keys()
    sheets = [
        _of_sheet(
            tag,
            journal.get(tag),
            worst(journal[row].verdict.verdict for row in {tag, *rows_of.get(tag, ())} if row in journal),
            gate_log,
            at_gate.get(tag, []),
            tolerated=tolerated,
            contested=tag in contested,
        )
        for tag in sorted((journal.keys() - with_others) | gate_log.decisions.keys())
    ]
    if plan is not None and plan.layout.sides > 1:
        # What was decided is known by its sheet; what was not, as yet by its side.
        sheets = [
            one
            if one.job_page is None or one.sheet is None or one.sheet + 1 in gate_log.decisions
            else replace(one, job_page=plan.sheet_at(one.job_page)[0])
            for one in sheets
        ]
    sheets += [_unknown_sheet(tray, tolerated=tolerated) for tray in unknown_rows]
    for tag, more in at_gate.items():  # what stuck below a sheet
        sheets += [_unknown_sheet(tray, tolerated=tolerated) for tray in more[1:] if tag]
    return Reconciliation(
        sheets=tuple(sheets),
        tolerated=tolerated,
        counts=Counter(one.account for one in sheets),
        off_mm=_off_mm(gate_log, rows),
        source="file" if rows else "wire",
        disagreements=disagreements,
    )


def account_of(result: Result, *, verdict: str, tray: str, came: bool, tolerated: bool) -> Account:
    """Return the account of a sheet.

    An empty ``tray`` means that the sheet was not seen at the gate. For ``tolerated`` see ``Reconciliation``.
    """
    if not came:
        return "did-not-come"
    if not tray:
        return "not-at-gate"
    if tray == "good":
        fit = (result is Result.ACCEPT or tolerated) and verdict != "misprint"
        return "accepted" if fit else "wrong"
    return "lost" if result is Result.ACCEPT else "diverted"


# --- parts ---


def _rows(text: str, path: Path) -> Iterable[Any]:
    if not text.lstrip().startswith("{"):
        return csv.DictReader(io.StringIO(text))
    lines = [line for line in text.splitlines() if line.strip()]
    rows = []
    for number, line in enumerate(lines, start=1):
        try:
            rows.append(json.loads(line))
        except (ValueError, RecursionError) as error:
            if number == len(lines) > 1 and not text.endswith("\n"):
                break  # the controller is writing it
            raise RequestError(path, f"is not JSON ({error})", remedy=TRAY_FILES.remedy) from error
    return rows


def _off_mm(gate_log: LoggedDecisions, trays: Sequence[Tray]) -> tuple[float, ...]:
    """Return the offsets of the sheets for which the controller found a result."""
    own, per_mm = (
        set(gate_log.sessions),
        gate_log.began.get("settings", {}).get("plc", {}).get("counts_per_mm", 1.0),
    )
    return tuple(
        count_distance(tray.count, gate_log.written[tray.tag]["position"]) / per_mm
        for tray in trays
        if tray.session in own and tray.tag in gate_log.written
    )


def _fits(row: Tray, gate_log: LoggedDecisions, tolerance: float) -> bool:
    """Return whether a row can be the run's: a sheet that it names came to the gate where it was expected.

    Sessions are numbers of 16 bits, so a long log may contain the same number for another run.
    """
    places = gate_log.places.get(row.tag, ()) if row.session in gate_log.sessions else ()
    return (
        not tolerance
        or not places
        or any(abs(count_distance(place, row.count)) <= tolerance for place in places)
    )


def _assigned(
    gate_log: LoggedDecisions, rows: Sequence[Tray], tolerance: float
) -> tuple[dict[int, list[Tray]], list[Tray]]:
    """Return the rows by tag, and those that belong to no sheet of the run."""
    own = set(gate_log.sessions)
    tags = [tray.tag if tray.session in own else 0 for tray in rows]
    _by_place(tags, rows, gate_log, tolerance)
    _by_order(tags, rows, gate_log)
    by_tag: dict[int, list[Tray]] = {}
    for tag, tray in zip(tags, rows, strict=True):
        if tag:
            by_tag.setdefault(tag, []).append(tray)
    return by_tag, [tray for tag, tray in zip(tags, rows, strict=True) if not tag]


def _wire_trays(gate_log: LoggedDecisions) -> dict[int, Tray]:
    """Return the trays that the controller reported over the wire, by tag."""
    return {
        tag: Tray(session=one["session"], tag=tag, tray=one["tray"], count=0)
        for tag, one in gate_log.trays.items()
        if one["tray"] in ("good", "reject")
    }


def _disagreements(gate_log: LoggedDecisions, by_tag: dict[int, list[Tray]]) -> tuple[Disagreement, ...]:
    """Return the differences between the controller's log, by tag, and the wire."""
    differing = []
    for tag, wire in sorted(_wire_trays(gate_log).items()):
        file = by_tag[tag][0].tray if tag in by_tag else ""
        if file != wire.tray:
            differing.append(Disagreement(sheet=tag - 1, wire=wire.tray, file=file))
    return tuple(differing)


def _by_place(tags: list[int], rows: Sequence[Tray], gate_log: LoggedDecisions, tolerance: float) -> None:
    """Assign rows to sheets by their expected positions, between the neighbours that are known."""
    places = {
        tag: decided["position"]
        for tag, decided in gate_log.decisions.items()
        if decided.get("position") is not None
    }
    for since, until in _gaps(tags):
        low, high = _between(tags, since, until, gate_log)
        for at in range(since, until):
            near = [
                tag
                for tag in range(low + 1, high)
                if tag in places and abs(count_distance(places[tag], rows[at].count)) <= tolerance
            ]
            if len(near) == 1:
                tags[at] = low = near[0]


def _by_order(tags: list[int], rows: Sequence[Tray], gate_log: LoggedDecisions) -> None:
    """Assign rows between known neighbours if all of them went into one tray, so that their order does not matter."""
    came = {tag for tag, decided in gate_log.decisions.items() if decided["came"]}
    for since, until in _gaps(tags):
        low, high = _between(tags, since, until, gate_log)
        left = [tag for tag in range(low + 1, high) if tag in came]
        if len(left) <= until - since and len({row.tray for row in rows[since:until]}) == 1:
            tags[since : since + len(left)] = left


def _gaps(tags: Sequence[int]) -> list[tuple[int, int]]:
    """Return first and end of each run of rows without a tag."""
    gaps, since = [], None
    for at, tag in enumerate([*tags, 1]):
        if not tag and since is None:
            since = at
        elif tag and since is not None:
            gaps.append((since, at))
            since = None
    return gaps


def _between(tags: Sequence[int], since: int, until: int, gate_log: LoggedDecisions) -> tuple[int, int]:
    """Return the tags of the rows before and after."""
    last = max(gate_log.decisions, default=0) + 1
    return (tags[since - 1] if since else 0), (tags[until] if until < len(tags) else last)


def _of_sheet(
    tag: int,
    page: PageRecord | None,
    sheet_verdict: VerdictName,
    gate_log: LoggedDecisions,
    trays: list[Tray],
    *,
    tolerated: bool,
    contested: bool,
) -> Accounted:
    """Account for one sheet; ``word`` is the verdict of all its sides."""
    decided = gate_log.decisions.get(tag)
    result = Result(decided["result"]) if decided else Result.NONE
    code = Code(decided["code"]) if decided else Code.NONE
    tray = trays[0] if trays else None
    verdict = "" if page is None else str(sheet_verdict)
    why = CODE_TEXTS.get(code, "")
    came = decided["came"] if decided else True
    tray_name = tray.tray if tray else ""
    account = account_of(result, verdict=verdict, tray=tray_name, came=came, tolerated=tolerated)
    if account == "did-not-come":
        why = "the page is missing"
    elif account == "lost" and tray:
        unsent = gate_log.unsent.get(tag)
        why = CODE_TEXTS[Code(unsent["code"])] if unsent else tray.why or "the controller reported no tray"
    return Accounted(
        account=account,
        sheet=tag - 1,
        job_page=decided["job_page"] if decided else (None if page is None else page.job_page),
        page=decided["page"] if decided else ("" if page is None else page.verdict.page),
        set_number=decided["set"] if decided else 0,
        verdict=verdict,
        in_journal=page is not None,
        decision=result.name.lower() if result else "",
        tray=tray_name,
        why=why,
        contested=contested,
    )


def _unknown_sheet(tray: Tray, *, tolerated: bool) -> Accounted:
    """Account for a sheet at the gate that the run does not know."""
    wrong = tray.tray == "good" and not tolerated
    why = tray.why or "no sheet of the run was expected at this position"
    return Accounted(account="wrong" if wrong else "unseen", tray=tray.tray, why=why)

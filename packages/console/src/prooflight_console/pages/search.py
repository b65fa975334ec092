"""Search for sheets of all runs, its files, labels for many sheets at once, and searches that people saved."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from typing import TYPE_CHECKING, Annotated, Any, Final
from urllib.parse import urlencode

from fastapi import APIRouter, Depends, Form, Path, Query, Request
from fastapi.responses import Response, StreamingResponse

from prooflight.cmyk import INK_LETTERS
from prooflight_console.access import needs
from prooflight_console.accounts.roles import Role, Who
from prooflight_console.api.common import console
from prooflight_console.pages.shell import OperatorPage, ViewerPage, page
from prooflight_console.problems import Problem
from prooflight_console.quality.searching import (
    COLUMNS,
    LABELS,
    TO_REVIEW,
    VERDICTS,
    Hit,
    SheetSearch,
    count,
    find,
    find_in_journal,
    sheet_numbers,
)
from prooflight_line.journal.defect_conditions import DefectConditions
from prooflight_line.journal.exporting import CSV_COLUMNS, csv_row, page_facts
from prooflight_line.journal.schema import json_text

if TYPE_CHECKING:
    from collections.abc import Iterator

    from prooflight_console.console import Console
    from prooflight_line.journal.records import RunRow

router = APIRouter(include_in_schema=False)
Themselves = Annotated[Who, Depends(needs(Role.VIEWER))]
"""A person who signed in; no token is accepted."""

AT_ONCE: Final = 50
EXPORTED_AT_ONCE: Final = 500
MOST_LABELLED: Final = 2000
"""Sheets that are labelled at once. Assumed: a person who looked at some of more cannot speak for all."""
_MORE: Final = ("page", "customer", "label", "ink", "size", "x", "y", "width", "height", "within", "runs")
"""Fields that are shown when the person opens them, or when they are filled in."""
_CUSTOMERS: Final = "SELECT DISTINCT customer FROM runs WHERE customer <> '' ORDER BY customer LIMIT 500"
NO_INK: Final = "none"
MOST_MM: Final = 100_000.0
RUN_COLUMNS: Final = ("run", "job", "press", "customer", "at", "label")
"""Columns before those of the journal's own CSV; at: when the sheet passed the camera, UTC."""
Text = Annotated[str, Query(max_length=200)]
Short = Annotated[str, Query(max_length=20)]
Day = Annotated[str, Query(pattern=r"^(\d{4}-\d\d-\d\d)?$", description="A day, or none.")]
Moment = Annotated[
    str,
    Query(pattern=r"^(\d{4}-\d\d-\d\d(T\d\d:\d\d)?)?$", description="A day, or a minute of one, or none."),
]
Runs = Annotated[str, Query(max_length=2000, pattern=r"^(\d{1,18}(,\d{1,18})*)?$")]
Skip = Annotated[int, Query(ge=0, lt=2**40)]
Row = Annotated[int | None, Query(ge=0, lt=2**63)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Search:
    """A search: what the form states, and the same for the index."""

    form: dict[str, str]
    search: SheetSearch
    order: str

    @property
    def query(self) -> str:
        """The query of its address."""
        return urlencode({name: value for name, value in self.form.items() if value})

    def address(self, path: str, **more: Any) -> str:
        """Return the address of the same search under another path; a value None leaves its field out."""
        fields = self.form | more
        return (
            f"{path}?{urlencode({name: value for name, value in fields.items() if value not in ('', None)})}"
        )


def _search(
    request: Request,
    job: Text = "",
    press: Text = "",
    customer: Text = "",
    page_name: Annotated[str, Query(alias="page", max_length=200)] = "",
    kind: Text = "",
    verdict: Short = TO_REVIEW,
    label: Short = "",
    ink: Short = "",
    size: Short = "",
    x: Short = "",
    y: Short = "",
    width: Short = "",
    height: Short = "",
    within: Short = "",
    since: Moment = "",
    until: Moment = "",
    runs: Runs = "",
    sort: Short = "-time",
    days: Annotated[int, Query(ge=0, le=3660, description="Until today; 0: from since to until.")] = 0,
    hours: Annotated[int, Query(ge=0, le=240, description="Until now; 0: from since to until.")] = 0,
) -> Search:
    now = datetime.fromtimestamp(console(request).accounts.clock())
    if days:
        since, until = (now.date() - timedelta(days=days - 1)).isoformat(), ""
    if hours:
        since, until = (now - timedelta(hours=hours)).isoformat(timespec="minutes"), ""
    sides = {"x": x, "y": y, "width": width, "height": height, "within": within}
    defect = conditions_of(kind=kind, ink=ink, size=size, **sides)
    search = SheetSearch(
        verdict=verdict if verdict in VERDICTS else TO_REVIEW,
        defect=defect,
        page=page_name.strip(),
        job=job.strip(),
        press=press.strip(),
        customer=customer.strip(),
        label=label if label in LABELS else None,
        runs=tuple(int(number) for number in runs.split(",") if number),
        since_s=moment_s(since),
        until_s=moment_s(until, days=1),
    )
    form = {"job": job, "press": press, "customer": customer, "page": page_name, "kind": kind}
    form |= {"verdict": search.verdict, "label": label, "ink": ink, "size": size, **sides}
    form |= {"since": since, "until": until, "runs": runs}
    order = sort if sort.removeprefix("-") in COLUMNS else "-time"
    return Search(form=form | {"sort": "" if order == "-time" else order}, search=search, order=order)


SearchForm = Annotated[Search, Depends(_search)]


@router.get("/search")
def search_page(
    request: Request,
    who: ViewerPage,
    requested: SearchForm,
    before: Row = None,
    skip: Skip = 0,
    upto: Row = None,
    labelled: Annotated[str, Query(pattern=r"^(\d{1,18}-\d{1,18}-\d{1,9}-\d{1,9})?$")] = "",
) -> Response:
    """Return matching sheets; for the next part htmx requests and gets rows alone."""
    state = console(request)
    state.index.catch_up()
    upto = state.reading.heads().row if upto is None else upto
    of_journal = requested.search.of_journal
    hits = _part(state, requested, before=before, skip=skip, limit=AT_ONCE, upto=upto)
    next_part = bool(request.headers.get("HX-Request")) and (before is not None or skip > 0)
    # The journal's next part needs no count, which would read all its tallies again.
    total = None if of_journal and next_part else count(state.index, requested.search, upto_row=upto)
    if of_journal:
        more = {"before": hits[-1].written.row} if len(hits) == AT_ONCE else None
    else:
        more = {"skip": skip + AT_ONCE, "upto": upto} if (total or 0) > skip + AT_ONCE else None
    values: dict[str, Any] = {
        "found": _with_runs(state, hits),
        "behind": None if more is None else requested.address("/search", **more),
    }
    if next_part:
        return page(request, who, "search/rows", **values)
    values |= {
        "count": total,
        "any_run": bool(state.reading.heads().run),
        "exports": {kind: requested.address(f"/search.{kind}") for kind in ("csv", "json")} if hits else {},
        "label_address": requested.address("/search/label", upto=upto),
        "sorting": None if of_journal else _sorting(requested),
        "saved": state.saved.of(who.name),
        "query": requested.query,
        "labelled": [int(part) for part in labelled.split("-")] if labelled else None,
        "indexing": state.index.progress,
        "damaged": state.index.damaged,
        "customers": [name for (name,) in state.index.query(_CUSTOMERS)],
        "inks": INK_LETTERS,
        "more_open": any(requested.form[name] for name in _MORE),
        "most_labelled": MOST_LABELLED,
    }
    return page(
        request, who, "search/search", asked=requested.form, verdicts=VERDICTS, labels=LABELS, **values
    )


@router.post("/search/label")
def label(
    request: Request,
    who: OperatorPage,
    requested: SearchForm,
    upto: Annotated[int, Query(ge=0, lt=2**63)],
    label: Annotated[str, Form(pattern="^(misprint|false-alarm|unknown)$")],
    pick: Annotated[list[str] | None, Form(max_length=MOST_LABELLED)] = None,
    note: Annotated[str, Form(max_length=1000)] = "",
) -> Response:
    """Label the picked sheets, or all that the search selects up to a row; then show the search again."""
    state = console(request)
    wanted = [_picked(text) for text in pick or ()]
    if not wanted and not requested.search.of_journal:
        state.index.catch_up()
        numbers = sheet_numbers(state.index, requested.search, limit=MOST_LABELLED + 1, upto_row=upto)
        wanted = [(run_id, sheet) for run_id, sheet, *_ in numbers]
    if not 0 < len(wanted) <= MOST_LABELLED:
        what = f"{len(wanted)} sheets: label 1 to {MOST_LABELLED} at once"
        raise Problem(422, "invalid", what)
    labels, left_out = state.label_sheets(who, label, wanted, note=note)
    done = f"{labels[0].id}-{labels[-1].id}-{len(labels)}-{left_out}" if labels else f"0-0-0-{left_out}"
    return Response(headers={"HX-Redirect": requested.address("/search", labelled=done)})


@router.post("/search/label/undo")
def undo_labels(
    request: Request,
    who: OperatorPage,
    requested: SearchForm,
    first: Annotated[int, Query(ge=1, lt=2**63)],
    last: Annotated[int, Query(ge=1, lt=2**63)],
) -> Response:
    """Undo all labels of one action; then show the search again."""
    console(request).undo_labels(who, first, last)
    return Response(headers={"HX-Redirect": requested.address("/search")})


@router.post("/search/saved")
def save(
    request: Request, who: Themselves, requested: SearchForm, name: Annotated[str, Form(max_length=200)]
) -> Response:
    """Save a search under a name, for this person."""
    console(request).saved.save(who.name, name, requested.query)
    return Response(headers={"HX-Redirect": requested.address("/search")})


@router.post("/search/saved/{number}/remove")
def remove_saved(request: Request, who: Themselves, number: Annotated[int, Path(ge=1, lt=2**63)]) -> Response:
    """Remove a saved search of this person."""
    console(request).saved.remove(who.name, number)
    return Response(headers={"HX-Redirect": "/search"})


@router.get("/search.csv")
def search_csv(request: Request, _who: ViewerPage, requested: SearchForm) -> Response:
    """Return all matching sheets as CSV, in the order shown: ``RUN_COLUMNS`` before ``CSV_COLUMNS``."""
    state, file = console(request), io.StringIO()

    def lines() -> Iterator[str]:
        writer = csv.DictWriter(file, (*RUN_COLUMNS, *CSV_COLUMNS), lineterminator="\n")
        writer.writeheader()
        for run_facts, hit in _every(state, requested):
            writer.writerow(run_facts | csv_row(hit.written.page))
            yield file.getvalue()
            file.seek(0)
            file.truncate()
        yield file.getvalue()

    return _download(lines(), "csv", "text/csv")


@router.get("/search.json")
def search_json(request: Request, _who: ViewerPage, requested: SearchForm) -> Response:
    """Return all matching sheets as one JSON array, in the order shown."""
    state = console(request)

    def lines() -> Iterator[str]:
        before = "["
        for run_facts, hit in _every(state, requested):
            yield before + json_text(run_facts | page_facts(hit.written.page))
            before = ",\n"
        yield "]" if before != "[" else "[]"

    return _download(lines(), "json", "application/json")


def _download(lines: Iterator[str], ending: str, kind: str) -> Response:
    name = f'attachment; filename="sheets.{ending}"'
    return StreamingResponse(lines, media_type=kind, headers={"Content-Disposition": name})


def _every(state: Console, requested: Search) -> Iterator[tuple[dict[str, Any], Hit]]:
    """Yield all matching sheets with facts of their run, ``EXPORTED_AT_ONCE`` at a time; damaged ones are left out."""
    while not state.index.catch_up():
        pass  # a file is complete, however long it takes
    runs: dict[int, RunRow] = {}
    upto, skip, before = state.reading.heads().row, 0, None
    while True:
        hits = _part(state, requested, before=before, skip=skip, limit=EXPORTED_AT_ONCE, upto=upto)
        for hit in hits:
            number = hit.written.run_id
            run = runs.get(number) or runs.setdefault(number, state.reading.run(number))
            at = datetime.fromtimestamp(hit.at_s, UTC).isoformat(timespec="milliseconds")
            facts = run.facts
            values = (number, facts.job, facts.press, facts.settings.get("customer", ""), at, hit.label)
            yield dict(zip(RUN_COLUMNS, values, strict=True)), hit
        if not hits:
            return
        skip, before = skip + EXPORTED_AT_ONCE, hits[-1].written.row


def _part(
    state: Console, requested: Search, *, before: int | None, skip: int, limit: int, upto: int
) -> list[Hit]:
    """Return the next matching sheets: those before a row of the journal, or of the index after ``skip`` of them."""
    if requested.search.of_journal:
        return find_in_journal(state.reading, state.index, requested.search, before=before, limit=limit)
    return find(
        state.reading,
        state.index,
        requested.search,
        order=requested.order,
        skip=skip,
        limit=limit,
        upto_row=upto,
    )


def _with_runs(state: Console, hits: list[Hit]) -> list[dict[str, Any]]:
    runs: dict[int, RunRow] = {}
    for hit in hits:
        if hit.written.run_id not in runs:
            runs[hit.written.run_id] = state.reading.run(hit.written.run_id)
    return [{"run": runs[hit.written.run_id], "page": hit.written.page, "hit": hit} for hit in hits]


def _sorting(requested: Search) -> dict[str, tuple[str, str]]:
    """Return by column the address that sorts by it, and how the list is sorted by it now (for aria-sort)."""
    sorting = {}
    for name in COLUMNS:
        current = requested.order.removeprefix("-") == name
        downwards = requested.order.startswith("-")
        first = f"-{name}" if name in ("time", "size") else name
        following = (name if downwards else f"-{name}") if current else first
        state = ("descending" if downwards else "ascending") if current else "none"
        sorting[name] = (requested.address("/search", sort=following), state)
    return sorting


def _picked(text: str) -> tuple[int, int]:
    """Return run and sheet of a picked row. Problem 422: the text names none."""
    run, _, sheet = text.partition("/")
    if not (run.isascii() and run.isdecimal() and sheet.isascii() and sheet.isdecimal() and len(text) < 40):
        raise Problem(422, "invalid", f"{text[:40]!r} is not a sheet")
    return int(run), int(sheet)


def conditions_of(*, ink: str, size: str, kind: str = "", **sides: str) -> DefectConditions:
    """Return the conditions on a defect of a form; sides: ``x``, ``y``, ``width``, ``height`` and ``within``.

    Problem 422: one is no length.
    """
    mm = {f"{name}_mm": length_mm(text, name) for name, text in sides.items()}
    return DefectConditions(
        kind=kind.strip() or None,
        ink={"": None, NO_INK: ""}.get(ink, ink if ink in INK_LETTERS else None),
        least_mm=length_mm(size, "size"),
        x_mm=mm["x_mm"],
        y_mm=mm["y_mm"],
        **{name: mm[name] or 0.0 for name in ("width_mm", "height_mm", "within_mm")},
    )


def length_mm(text: str, name: str) -> float | None:
    """Return a length of a form, with a point or a comma; None if it is empty. Problem 422: it is none."""
    if not text.strip():
        return None
    try:
        value = float(text.strip().replace(",", "."))
    except ValueError:
        value = math.nan
    if not -MOST_MM <= value <= MOST_MM or (value < 0 and name not in ("x", "y")):
        raise Problem(422, "invalid", f"{name}: {text[:20]!r} is not a length in mm")
    return value


def moment_s(text: str, *, days: int = 0) -> float | None:
    """Return the Unix time of a minute, by the clock of the console's machine; of a day alone as ``day_s``.

    Raises ``Problem`` 422 if the text is none.
    """
    if "T" not in text:
        return day_s(text, days=days)
    try:
        return datetime.fromisoformat(text).astimezone().timestamp()
    except (ValueError, OverflowError, OSError) as error:
        raise Problem(422, "invalid", f"{text} is not a time") from error


def day_s(text: str, *, days: int = 0) -> float | None:
    """Return the Unix time at which a day began, by the clock of the console's machine, or ``days`` later.

    Raises ``Problem`` 422 if the text is not a day.
    """
    if not text:
        return None
    try:
        day = date.fromisoformat(text) + timedelta(days=days)
        return datetime(day.year, day.month, day.day).astimezone().timestamp()
    except (ValueError, OverflowError, OSError) as error:
        raise Problem(422, "invalid", f"{text} is not a day") from error

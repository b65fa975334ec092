"""The report of a run as a PDF of A4 pages: figures, timeline, gate, misprints with pictures, sheets, signature line.

The same journal gives the same bytes: the document states the times of the run and none of its making.
"""

from __future__ import annotations

from datetime import datetime
from functools import partial
from typing import IO, TYPE_CHECKING, Any, Final

from reportlab.lib.pagesizes import A4
from reportlab.lib.units import mm
from reportlab.pdfgen.canvas import Canvas
from reportlab.platypus import (
    BaseDocTemplate,
    CondPageBreak,
    Frame,
    KeepTogether,
    PageBreak,
    PageTemplate,
    Spacer,
    Table,
)

from prooflight import __version__
from prooflight.reporting.defect_phrases import KINDS
from prooflight.reporting.defect_text import SheetSpan, describe
from prooflight.reporting.sentences import reason
from prooflight_line.run_package import report_style as style
from prooflight_line.run_package.report_drawings import Bars, Locator, Picture, Timeline
from prooflight_line.run_package.report_facts import kind_of, report_facts
from prooflight_line.run_package.report_texts import ReportTexts

if TYPE_CHECKING:
    from prooflight.reporting.defect_phrases import Code
    from prooflight_line.journal.labels import Label
    from prooflight_line.journal.reading import JournalReader
    from prooflight_line.journal.records import RunRow
    from prooflight_line.run_package.report_facts import ReportedIncident, ReportedSheet, ReportFacts

MARGIN: Final = 18 * mm
HEAD, FOOT = 24 * mm, 20 * mm
WIDTH: Final = A4[0] - 2 * MARGIN
GAP: Final = 6 * mm
PICTURE: Final = 40 * mm
LOCATOR: Final = 15 * mm
MOST_WARNINGS: Final = 12
MOST_LABELS: Final = 3
"""Greatest number of labels of single sheets that are shown with an incident."""
MOST_PAGES: Final = 6
"""Greatest number of names of pages that are listed for an incident."""


def write_report(file: IO[bytes], journal: JournalReader, run: RunRow, *, language: Code = "en") -> None:
    """Write the report of a run; JournalError."""
    facts, say = report_facts(journal, run), ReportTexts(language)
    style.register()
    document = BaseDocTemplate(
        file,
        pagesize=A4,
        leftMargin=MARGIN,
        rightMargin=MARGIN,
        topMargin=HEAD,
        bottomMargin=FOOT,
        title=f"{say('title')}: {run.facts.job}, {say('run', n=run.id)}",
        author=run.facts.press,
        creator=f"Prooflight {__version__}",
        lang=language,
        invariant=1,
    )
    frame = Frame(
        MARGIN, FOOT, WIDTH, A4[1] - HEAD - FOOT, leftPadding=0, rightPadding=0, topPadding=0, bottomPadding=0
    )
    document.addPageTemplates([PageTemplate(frames=[frame])])
    parts = [*_summary(facts, say), *_incidents(facts, say), *_others(facts, say), *_sheets(facts, say)]
    document.build(parts, canvasmaker=partial(_NumberedCanvas, run=run, say=say))


class _NumberedCanvas(Canvas):  # type: ignore[misc]
    """A canvas that draws head and foot when it knows how many pages there are."""

    def __init__(self, *given: Any, run: RunRow, say: ReportTexts, **named: Any) -> None:
        super().__init__(*given, **named)
        self._run, self._say = run, say
        self._finished: list[dict[str, Any]] = []

    def showPage(self) -> None:
        """Put a page aside."""
        self._finished.append(dict(self.__dict__))
        self._startPage()

    def save(self) -> None:
        """Write all pages."""
        pages = self._finished
        for number, state in enumerate(pages, start=1):
            self.__dict__.update(state)
            self._finished = pages
            self._draw_margins(number, len(pages))
            super().showPage()
        super().save()

    def _draw_margins(self, number: int, of: int) -> None:
        run, say = self._run, self._say
        right, top, bottom = A4[0] - MARGIN, A4[1] - 13 * mm, 12 * mm
        self.setStrokeColor(style.LINE)
        self.setLineWidth(0.5)
        self.line(MARGIN, top - 2.6 * mm, right, top - 2.6 * mm)
        self.line(MARGIN, bottom + 3.6 * mm, right, bottom + 3.6 * mm)
        style.draw(self, MARGIN, top, "Prooflight", bold=True, colour=style.INK)
        style.draw(self, right, top, f"{say('title')} · {say('run', n=run.id)}", align="right")
        foot = f"{run.facts.job} · {run.facts.press} · {run.facts.press_digest[:16]}"
        style.draw(self, MARGIN, bottom, style.fitted(foot, WIDTH - 30 * mm))
        style.draw(self, right, bottom, say("page", n=number, of=of), align="right")


def _moment(unix_s: float) -> str:
    return datetime.fromtimestamp(unix_s).astimezone().strftime("%Y-%m-%d %H:%M")


def _kind(kind: str, say: ReportTexts) -> str:
    return KINDS[say.language].get(kind, kind)


def _summary(facts: ReportFacts, say: ReportTexts) -> list[Any]:
    run = facts.run
    end = "" if run.end is None else f" – {_moment(run.end.ended_s)[11:]}"
    state = say(f"state.{run.state}")
    parts: list[Any] = [
        style.text(run.facts.job, "title"),
        style.text(f"{run.facts.press} · {_moment(run.facts.started_s)}{end} · {state}", "lead"),
        Spacer(0, 5 * mm),
        _figures(facts, say),
        Spacer(0, GAP),
        _pairs(facts, say),
        Spacer(0, GAP),
        _charts(facts, say),
        Spacer(0, GAP),
        *_gate(facts, say),
        *_signature(say),
    ]
    if facts.warnings:
        lines = [style.text(line, "small") for line in facts.warnings[:MOST_WARNINGS]]
        if more := len(facts.warnings) - MOST_WARNINGS:
            lines += [style.text(f"+ {say.number(more)}", "small")] if more > 0 else []
        parts += [Spacer(0, GAP), KeepTogether([style.text(say("warnings"), "heading"), *lines])]
    return parts


def _figures(facts: ReportFacts, say: ReportTexts) -> Table:
    run = facts.run
    incidents = facts.incident_count
    of = say("of", n=say.number(run.facts.sheets)) if run.facts.sheets else ""
    inside = say("in-incidents.one") if incidents == 1 else say("in-incidents", n=say.number(incidents))
    labelled = say("labelled", n=say.number(facts.labelled), of=say.number(incidents))
    cells: list[tuple[str, int | None, str, Any]] = [
        ("sheets", run.pages, of, style.INK),
        ("misprints", run.misprints, inside if run.misprints else "", style.STOP),
        ("false-alarms", facts.false_alarms, labelled if incidents else "", style.INK),
        ("not-inspected", run.not_inspected, "", style.LOOK),
        ("late", run.late, "", style.LOOK),
        ("reprint", facts.to_reprint, "", style.INK),
    ]
    rows = [
        [style.text(say(name), "label") for name, _, _, _ in cells],
        [
            style.text(
                "–" if value is None else say.number(value), "figure", colour=colour if value else None
            )
            for _, value, _, colour in cells
        ],
        [style.text(more, "small") for _, _, more, _ in cells],
    ]
    table = Table(rows, colWidths=[WIDTH / len(cells)] * len(cells))
    table.setStyle(style.FIGURES)
    return table


def _pairs(facts: ReportFacts, say: ReportTexts) -> Table:
    run = facts.run
    suspended = run.promise_suspended_from
    rate = say("rate.kept") if suspended is None else say("rate.suspended", n=suspended)
    lost = say(
        "unrecorded.what", pages=say.number(run.dropped_pages), evidence=say.number(run.dropped_evidence)
    )
    rows = [
        ("job", run.facts.job),
        ("job-digest", run.facts.job_digest),
        ("press", run.facts.press),
        ("press-digest", run.facts.press_digest),
        ("detector", run.facts.detector),
        ("source", run.facts.source),
        ("began", _moment(run.facts.started_s)),
        ("ended", "" if run.end is None else _moment(run.end.ended_s)),
        ("rate", rate),
        ("unrecorded", lost if run.dropped_pages or run.dropped_evidence else ""),
        ("remark", "" if run.end is None else run.end.detail),
        ("version", f"Prooflight {facts.version}"),
    ]
    cells = [[style.text(say(name), "label"), style.text(value, "value")] for name, value in rows if value]
    table = Table(cells, colWidths=[52 * mm, WIDTH - 52 * mm])
    table.setStyle(style.PAIRS)
    return table


def _charts(facts: ReportFacts, say: ReportTexts) -> Table:
    half = (WIDTH - GAP) / 2
    kinds = [(_kind(kind, say), count) for kind, count in facts.kinds.items()]
    most = max(map(sum, facts.timeline), default=0)
    timeline: list[Any] = [style.text(say("timeline"), "heading")]
    if most:
        legend = tuple((say(name), colour) for name, colour in style.SERIES)
        axis = f"{say('sheet')} 0", say("timeline.most", n=say.number(most)), say("end")
        timeline.append(Timeline(facts.timeline, width=half, axis=axis, legend=legend))
    else:
        timeline.append(style.text(say("timeline.none"), "value"))
    bars: list[Any] = [style.text(say("kinds"), "heading")]
    bars.append(Bars(kinds, width=half, say=say) if kinds else style.text(say("kinds.none"), "value"))
    table = Table([[timeline, "", bars]], colWidths=[half, GAP, half])
    table.setStyle(style.BARE)
    return table


def _gate(facts: ReportFacts, say: ReportTexts) -> list[Any]:
    heading = style.text(say("gate"), "heading")
    if facts.gate_trouble:
        return [KeepTogether([heading, style.text(say("gate.damaged", why=facts.gate_trouble), "value")])]
    if facts.gate is None:
        return [KeepTogether([heading, style.text(say("gate.none"), "value")])]
    counts = facts.gate.counts
    rows = [
        [
            style.text(say.number(counts[name]), "number", colour=style.STOP if name == "wrong" else None),
            style.text(say(f"account.{name}"), "value"),
        ]
        for name in ("accepted", "diverted", "lost", "unseen", "not-at-gate", "did-not-come", "wrong")
        if counts[name]
    ]
    table = Table(rows, colWidths=[20 * mm, WIDTH - 20 * mm])
    table.setStyle(style.PAIRS)
    lines = [style.text(say(f"gate.{facts.gate.source}"), "small")]
    if differ := len(facts.gate.disagreements):
        lines.append(style.text(say("gate.differ", n=say.number(differ)), "small", colour=style.STOP))
    return [KeepTogether([heading, table, *lines])]


def _incidents(facts: ReportFacts, say: ReportTexts) -> list[Any]:
    if not facts.incidents:
        return []
    head = [
        style.text(say("incidents"), "heading"),
        style.text(say("incidents.what"), "small"),
        Spacer(0, 2 * mm),
    ]
    cards = [_incident(one, say) for one in facts.incidents]
    parts: list[Any] = [PageBreak(), KeepTogether([*head, cards[0]]), *cards[1:]]
    if facts.incidents_left:
        parts.append(style.text(say("incidents.more", n=say.number(facts.incidents_left)), "small"))
    return parts


def _incident(one: ReportedIncident, say: ReportTexts) -> Table:
    incident = one.incident
    span = SheetSpan(
        first=incident.first_sheet, last=incident.last_sheet, count=incident.count, shown=incident.last_sheet
    )
    text = describe(one.verdict, sheets=span, language=say.language)
    sheets = (
        say("sheets.one", first=incident.first_sheet)
        if incident.count == 1
        else say(
            "sheets.many",
            n=say.number(incident.count),
            first=incident.first_sheet,
            last=incident.last_sheet,
        )
    )
    of_job = [name for name in incident.pages if name != f"sheet {incident.first_sheet}"]
    names = ", ".join(of_job[:MOST_PAGES]) + (", …" if len(of_job) > MOST_PAGES else "")
    verdict = one.verdict
    score = ""
    if (
        one.region is not None
        and one.region.above_good_sd is not None
        and verdict.score
        and verdict.threshold
    ):
        # Otherwise ``describe`` states it.
        numbers = say.number(verdict.score, 1), say.number(verdict.threshold, 1)
        score = f"{say('score')} {numbers[0]} / {say('threshold')} {numbers[1]}"
    pages = say("pages", names=names) if names else ""
    body = [
        style.text(" · ".join(filter(None, (say("incident", n=incident.number), sheets, pages))), "label"),
        style.text(text.title or _kind(incident.kind, say), "subject"),
        style.text(text.detail, "value"),
        style.text(" · ".join(filter(None, (f"{say('sheet')} {one.sheet}", score))), "small"),
        *(style.text(line, "value") for line in _labels(one, say)),
    ]
    picture = (
        style.text(say("no-picture"), "small")
        if one.picture is None
        else Picture(one.picture, width=PICTURE, say=say)
    )
    page = Locator(one.verdict.regions, one.picture, width=LOCATOR)
    table = Table(
        [[picture, page, body]],
        colWidths=[PICTURE + 4 * mm, LOCATOR + 5 * mm, WIDTH - PICTURE - LOCATOR - 9 * mm],
    )
    table.setStyle(style.CARD)
    return table


def _labels(one: ReportedIncident, say: ReportTexts) -> list[str]:
    """Return the incident's label, and those of single sheets."""
    if one.label is None and not one.of_sheets:
        return [f"{say('label')}: {say('label.none')}"]
    lines = [] if one.label is None else [f"{say('label')}: {_label(one.label, say)}"]
    lines += [f"{say('sheet')} {label.sheet}: {_label(label, say)}" for label in one.of_sheets[:MOST_LABELS]]
    more = len(one.of_sheets) - MOST_LABELS
    return [*lines, f"+ {say.number(more)}"] if more > 0 else lines


def _label(label: Label, say: ReportTexts) -> str:
    text = say("label.by", word=say(f"word.{label.word}"), by=label.by, at=_moment(label.at_s))
    return f"{text}: {label.note}" if label.note else text


def _others(facts: ReportFacts, say: ReportTexts) -> list[Any]:
    parts: list[Any] = [Spacer(0, GAP), CondPageBreak(30 * mm), style.text(say("others"), "heading")]
    if not facts.others:
        return [*parts, style.text(say("others.none"), "value")]
    right = ("number", "first", "last")
    rows = [
        [style.text(say("others.kind"), "column"), *(style.text(say(one), "column.right") for one in right)]
    ]
    for one in facts.others[:40]:
        why = f": {reason(one.reason, say.language)}" if one.reason else ""
        figures = (one.count, one.first_sheet, one.last_sheet)
        rows.append(
            [
                style.text(say(f"kind.{one.kind}") + why, "value"),
                *(style.text(say.number(figure), "number") for figure in figures),
            ]
        )
    table = Table(rows, colWidths=[WIDTH - 54 * mm, 18 * mm, 18 * mm, 18 * mm], repeatRows=1)
    table.setStyle(style.TABLE)
    return [*parts, table]


def _sheets(facts: ReportFacts, say: ReportTexts) -> list[Any]:
    if not facts.sheets:
        return []
    columns = ("sheet", "name", "verdict", "kind", "score", "threshold", "disposition", "label")
    right = ("sheet", "score", "threshold")
    rows = [[style.text(say(name), "column.right" if name in right else "column") for name in columns]]
    rows += [_sheet(one, say) for one in facts.sheets]
    widths = [13, 18, 24, 39, 16, 18, 28, 18]
    table = Table(rows, colWidths=[width * mm for width in widths], repeatRows=1)
    table.setStyle(style.TABLE)
    parts: list[Any] = [Spacer(0, GAP), CondPageBreak(30 * mm), style.text(say("list"), "heading"), table]
    if facts.sheets_left:
        parts.append(style.text(say("list.more", n=say.number(facts.sheets_left)), "small"))
    return parts


def _sheet(one: ReportedSheet, say: ReportTexts) -> list[Any]:
    record, verdict = one.record, one.record.verdict
    kind = (
        _kind(kind_of(verdict), say)
        if verdict.verdict == "misprint"
        else reason(verdict.reason, say.language)
    )
    colour = style.STOP if verdict.verdict == "misprint" else style.LOOK
    numbers = ("" if value is None else say.number(value, 1) for value in (verdict.score, verdict.threshold))
    return [
        style.text(str(record.sheet), "number"),
        style.text(verdict.page, "value"),
        style.text(say(f"verdict.{verdict.verdict}"), "value", colour=colour),
        style.text(kind, "value"),
        *(style.text(number, "number") for number in numbers),
        style.text(say(f"disposition.{record.disposition}"), "value"),
        style.text("" if one.label is None else say(f"word.{one.label.word}"), "value"),
    ]


def _signature(say: ReportTexts) -> list[Any]:
    third = WIDTH / 3
    names = [style.text(say(f"sign.{name}"), "label") for name in ("name", "date", "signature")]
    table = Table([["", "", ""], names], colWidths=[third] * 3, rowHeights=[11 * mm, None])
    table.setStyle(style.SIGNATURE)
    return [Spacer(0, GAP), KeepTogether([style.text(say("sign"), "heading"), table])]

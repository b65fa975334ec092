"""The page docs/reference/outlets.md: the message of each outlet for each of the ten kinds of sheet.

The kinds are the codes of the gate, and the messages come from the outlets themselves. A sheet of each kind
goes through the gate's decisions, the stream of events and the messages of every outlet, once in a run with a
gate of policy ``reject`` and once in a run without a gate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from prooflight.detectors.verdict import Verdict
from prooflight.press.gate import GateSettings, PlcSettings
from prooflight_line.journal.records import PageRecord
from prooflight_line.plant.events import Event, SheetAtGate, SheetJudged
from prooflight_line.plant.gate.deciding import CODE_TEXTS, GateDecider, disposition_of
from prooflight_line.plant.gate.passed import NAMES, PassedSheets
from prooflight_line.plant.gate.registers import Code, Result
from prooflight_line.plant.stream import EventStream
from prooflight_line.run.monitor.run import PageEvidence
from prooflight_line.run.outcomes import Outcome

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from prooflight_line.plant.gate.deciding import SheetDecision

GOOD: Final = Verdict(page="p0002", verdict="good", detector="matched_filter")
MISPRINT: Final = Verdict(page="p0002", verdict="misprint", detector="matched_filter", kind="streak")
NOT_INSPECTED: Final = Verdict.skipped("p0002", "its verdict would have come too late")
SHEETS: Final[dict[Code, tuple[Verdict, tuple[str, ...]]]] = {
    Code.GOOD: (GOOD, ()),
    Code.MISPRINT: (MISPRINT, ()),
    Code.NOT_INSPECTED: (NOT_INSPECTED, ()),
    Code.LOST_LINES: (GOOD, ("lost-lines",)),
    Code.UNKNOWN_SHEET: (replace(MISPRINT, kind="wrong-page"), ("unknown",)),
    Code.OUT_OF_PLACE: (GOOD, ("out-of-order",)),
    Code.SET_SPOILED: (GOOD, ()),
    Code.UNTIL_CLEAN_BREAK: (GOOD, ()),
    Code.TOO_LATE: (GOOD, ()),
    Code.PLACE_UNKNOWN: (GOOD, ()),
}
"""Verdict and faults of a sheet of each kind. The last four are well printed: the gate gives them their kind."""
OF_GATE: Final = frozenset({Code.SET_SPOILED, Code.UNTIL_CLEAN_BREAK, Code.TOO_LATE, Code.PLACE_UNKNOWN})
"""Kinds of sheet that exist only in a run with a gate."""
LATE: Final = frozenset({Code.TOO_LATE, Code.PLACE_UNKNOWN})
"""Kinds of sheet that the gate reports after the sheet was judged."""
GATE: Final = GateSettings(distance_mm=2000.0, plc=PlcSettings(host="plc"))
INTRODUCTION: Final = """# What each outlet says of a sheet

Written by `python -m docs.generators.plant`: each row is a sheet that went through the gate's decisions, the
stream of events and the messages of every outlet. The ten kinds are the [codes of the gate](registers.md).

A verdict says what is known of a sheet: `good`, `misprint` or `not-inspected`. A disposition says what becomes of it,
and `decided_by` by what rule. Programs that move or release sheets go by the disposition, never by the verdict.

| disposition | says |
|---|---|
| `accept` | the sheet goes to the good sheets |
| `hold` | it is released to nobody before a person has seen it: no gate takes it out, and nobody vouches for it |
| `divert` | it goes out of the good sheets |
| `stop` | so it does, and the press is stopped |
"""
WITH: Final = """## With a gate

The policy is `reject`. `sheet-judged` comes when the sheet is decided, `sheet-at-gate` when it has passed the gate.
Verdict and disposition are the same in `sheet-judged` (MQTT, webhooks, `ResultContent` of OPC UA), in the API, in
`--json`, in exports and in reports. The exit code is that of `watch` for a run with this sheet and good ones: 0, 1 (a
misprint) or 3 (a sheet was not inspected, or nobody vouches for it); 5 where inspection could not keep up.
"""
WITHOUT: Final = """## Without a gate

A misprint that the costs of the press file accept is `accept` by `costs`. Sets and the order of the stack are the
gate's: without one, the kinds of these have no row.
"""
HEAD: Final = ("kind of sheet", "verdict", "disposition", "exit code", "XJMF", "OPC UA")


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetMessages:
    """Messages of all outlets about one sheet."""

    judged: Event
    at_gate: SheetAtGate | None
    decision: SheetDecision | None

    @property
    def sheet(self) -> SheetJudged:
        """Body of the event."""
        assert isinstance(self.judged.body, SheetJudged)
        return self.judged.body


def outlets_page() -> str:
    """Return the text of the page."""
    with_gate = [_row(code, messages_of(code)) for code in SHEETS]
    without = [_row(code, messages_of(code, gate=False)) for code in SHEETS if code not in OF_GATE]
    costs = replace(MISPRINT, stopping_costs_more=True)
    without.insert(2, _row(Code.MISPRINT, _judged(_record(costs, ())), name="`misprint`, accepted by costs"))
    gate_head = (*HEAD, "registers: `result`, `code`", "`sheet-at-gate`")
    return "\n".join([INTRODUCTION, WITH, _table(gate_head, with_gate), WITHOUT, _table(HEAD, without)])


def messages_of(code: Code, *, gate: bool = True) -> SheetMessages:
    """Return the messages of all outlets about a sheet of a kind, which is the second sheet of a run."""
    verdict, faults = SHEETS[code]
    record = _record(verdict, faults)
    if not gate:
        return _judged(record)
    settings = GATE
    if code is Code.SET_SPOILED:
        settings = replace(GATE, pages_a_set=2)
    if code is Code.UNTIL_CLEAN_BREAK:
        settings = replace(GATE, divert="until-clean-break")
    decider = GateDecider(settings=settings, job_pages=2)
    first = MISPRINT if code in (Code.SET_SPOILED, Code.UNTIL_CLEAN_BREAK) else GOOD
    decider.decide(replace(record, sheet=0, job_page=0, verdict=first, faults=()))
    decision = decider.decide(record)
    passed: list[SheetAtGate] = []
    sheets = PassedSheets(passed.append)
    sheets.decided(decision)
    if code in LATE:
        sheets.passed(decision.tag, now_s=0.0, unsent=code)
        sheets.ended()  # the controller found no result for it, and so names no sheet
    else:
        sheets.written(decision.tag)
        sheets.confirmed(decision.tag, "good" if decision.result is Result.ACCEPT else "reject")
    judged = _judged(replace(record, gate=disposition_of(decision.result)))
    return replace(judged, at_gate=passed[0], decision=decision)


# --- parts ---


def _record(verdict: Verdict, faults: tuple[str, ...]) -> PageRecord:
    shown = None if "unknown" in faults else 1
    return PageRecord(
        sheet=1, job_page=shown, verdict=verdict, late=False, first_line=0, time_s=0.0, faults=faults
    )


def _judged(record: PageRecord) -> SheetMessages:
    events: list[Event] = []
    stream = EventStream([events.append], press="press", stream="s", clock=lambda: 0.0)
    stream.observe(Outcome(record=record, evidence=PageEvidence()))
    judged = next(event for event in events if isinstance(event.body, SheetJudged))
    return SheetMessages(judged=judged, at_gate=None, decision=None)


def _row(code: Code, messages: SheetMessages, *, name: str = "") -> list[str]:
    sheet = messages.sheet
    row = [
        name or (f"`{NAMES[code]}`: {CODE_TEXTS[code]}" if code is not Code.GOOD else "`good`"),
        f"`{sheet.verdict}`",
        f"`{sheet.disposition}` by `{sheet.decided_by}`",
        str(_exit_code(code)),
        _xjmf(messages.judged),
        _opcua(sheet),
    ]
    if messages.decision is None or messages.at_gate is None:
        return row
    gate = messages.at_gate
    late = "" if gate.in_time else ", not in time"
    result = (
        f"{int(messages.decision.result)}, {int(messages.decision.code)}" if gate.in_time else "none in time"
    )
    return [*row, result, f"`{gate.code}`{late}; tray `{gate.tray}`"]


def _xjmf(judged: Event) -> str:
    from prooflight_line.plant.outlets import xjmf_messages as xjmf

    root = xjmf.read(xjmf.signals([judged], device_id="press", job="job"))
    names = {"x": xjmf.NAMESPACE}
    result = root.find(".//x:QualityControlResult", names)
    attributes = [
        f"{name} {result.get(name)}" for name in ("Passed", "Failed", "Measurements") if result.get(name)
    ]
    comments = [one.text for one in root.findall(".//x:Resource/x:Comment", names)]
    return ", ".join([*attributes, comments[-1]])


def _opcua(sheet: SheetJudged) -> str:
    from prooflight_line.plant.outlets import opcua, opcua_types

    states = {opcua_types.COMPLETED: "completed", opcua_types.ABORTED: "aborted"}
    return f"{states[opcua.result_state(sheet)]}, severity {opcua.severity(sheet)}"


def _exit_code(code: Code) -> int:
    """Return the exit code for the sheet itself; 3 where it passed the gate without its result.

    The numbers are those of ``cli.exit_codes``, which lies above; a test compares them.
    """
    sheet = messages_of(code, gate=False).sheet
    return 3 if code in LATE or sheet.disposition == "hold" else int(sheet.verdict == "misprint")


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)

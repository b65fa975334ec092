"""A run in the terminal: one status line, and a line for each alarm. The console shows the rest."""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from rich.text import Text

from prooflight.errors import plain, sentence
from prooflight.reporting import wording
from prooflight.reporting.defect_text import describe
from prooflight_line.run.pace import REMEDY
from prooflight_line.run.status import Phase

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from prooflight_line.cameras.camera import Health
    from prooflight_line.run.outcomes import Outcome
    from prooflight_line.run.status import Status

PHASES: Final = {Phase.INSPECTING: "green", Phase.FAULT: "bold red"}
ACTIONS: Final = {"accept": "green", "reprint": "yellow", "stop": "bold red"}


def run_line(
    status: Status,
    *,
    deadline_s: float | None,
    cameras: Mapping[str, Health] = MappingProxyType({}),
    sheets: str = "",
) -> Text:
    """Return the state of a run in one line, the most urgent first.

    Parameters
    ----------
    deadline_s : time for a verdict; None if the source waits for the inspection
    cameras : health of the source's cameras, by name
    sheets : counts of sheets and sets by verdict, in words, where the job's sheets have several sides or its
        pages belong together
    """
    line = Text.assemble((f" {status.phase.upper()} ", f"reverse {PHASES.get(status.phase, 'yellow')}"), "  ")
    urgent = list(_urgent(status, cameras))
    line.append("".join(f"{sentence(text)}; " for text in urgent), "bold red")
    return line.append(", ".join(_counts(status, deadline_s, sheets)))


def alarm_lines(outcome: Outcome) -> Iterator[Text]:
    """Yield a line for a misprint, and one for each announcement of the run that came with this sheet."""
    record = outcome.record
    verdict = record.verdict
    if verdict.verdict == "misprint":
        what = describe(verdict).sentence
        name = f"sheet {record.sheet}"
        page = "" if verdict.page == name else f", {plain(verdict.page)}"
        yield Text(f"{name}{page}: {what}", style="red")
    for one in outcome.announcements:
        what = sentence(one.text.rpartition(":")[0])
        yield Text.assemble(f"sheet {one.sheet}: ", (one.action.upper(), ACTIONS[one.action]), f" {what}")


def preparation(status: Status) -> str:
    """Say how many designs are ready before the first line, and how long the others will take."""
    ready = f"{status.ahead} of {wording.count(status.to_prepare, 'design')} ready"
    left = status.to_prepare - status.ahead
    if left <= 0 and status.to_rehearse:
        return f"{ready}, warmed up: {status.rehearsed} of {status.to_rehearse}"
    if left <= 0 or not status.ahead:
        return ready
    return f"{ready}, about {math.ceil(status.elapsed_s * left / status.ahead)} s left"


def _urgent(status: Status, cameras: Mapping[str, Health]) -> Iterator[str]:
    if status.overloaded:
        yield f"inspection cannot keep up: {status.out_of_time} sheets not inspected; {REMEDY}"
    if status.detail:
        yield status.detail
    if status.promise_suspended:
        yield wording.suspended(status.promise_suspended)
    for name, health in cameras.items():
        if not health.present:
            yield f"camera {plain(name)} is away"
        elif health.lines_lost:
            yield f"camera {plain(name)} lost {health.lines_lost:,} lines"


def _counts(status: Status, deadline_s: float | None, sheets: str) -> Iterator[str]:
    if status.phase is Phase.PREPARING and status.to_prepare:
        yield preparation(status)
    yield f"{wording.count(status.pages_seen, 'sheet')}, {status.good:,} good"
    yield f"{wording.count(status.misprints, 'misprint')}, {status.not_inspected:,} not inspected"
    missing = max(status.missing, status.absent)
    for name, number in (("late", status.late), ("missing", missing)):
        if number:
            yield f"{number:,} {name}"
    yield from (f"{number} {kind}" for kind, number in sorted(status.faults.items()))
    if sheets:
        yield sheets
    yield f"{status.pages_per_s:.2f} pages/s"
    verdict = status.stages["verdict"]
    limit = "" if deadline_s is None else f" of {deadline_s * 1e3:.0f}"
    yield f"verdicts after {verdict.median_ms:.0f} ms, 99.9 % within {verdict.p999_ms:.0f}{limit} ms"

"""How a run's gate is, from its log as it grows: only lines that are new are read."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, Literal

from prooflight.plant.gate.handshake import State
from prooflight.plant.gate.log import log_path
from prooflight.plant.gate.reconciling import account_of
from prooflight.plant.gate.registers import Code, Result

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.journal.records import RunRow
    from prooflight.plant.gate.reconciling import Reconciliation
    from prooflight.server.reading.gate import Gated

AT_ONCE_BYTES: Final = 8_000_000
"""Of a log, in one look: one of a long run is caught up with in several."""

GateState = Literal["away", "joining", "aligning", "ready", "unknown", "ended", "damaged"]
"""That of the handshake while the run goes on. unknown: the log does not say. damaged: it cannot be read on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GateHealth:
    """What the gate's log says so far; trays as the controller said them over the wire."""

    state: GateState
    decided: int
    """Sheets that came."""
    diverted: int
    """Of these, decided not to go to the good tray."""
    too_late: int
    """Sheets that passed before the controller had their result."""
    reconciled: int
    """Sheets of which decision and tray are both known."""
    last_reconciled: int | None
    """The last of these, by number; None: the controller has said no tray yet."""
    lost: int
    """Good sheets in the reject tray."""
    wrong: int
    """Sheets in the good tray against their decision."""
    first_wrong: int | None

    @property
    def lamp(self) -> Literal["good", "look", "bad", "off"]:
        """bad: a sheet is where it must not be, or the controller is not there."""
        if self.wrong or self.state in ("away", "damaged"):
            return "bad"
        if self.state in ("ended", "unknown"):
            return "off"
        return "look" if self.state != "ready" or self.lost or self.too_late else "good"


@dataclass(slots=True)
class _Read:
    """Of one log, so far."""

    path: Path
    upto: int = 0
    state: GateState = "unknown"
    tolerated: bool = False
    decided: dict[int, tuple[Result, Code, bool]] = field(default_factory=dict)
    """By tag, until a tray is known."""
    counts: Counter[str] = field(default_factory=Counter)
    last: int | None = None
    first_wrong: int | None = None

    def add(self, row: dict[str, Any]) -> None:
        """One line. KeyError, TypeError, ValueError: it is not as it should be."""
        match row["kind"]:
            case "run":
                self.state = "away"
                self.tolerated = row.get("settings", {}).get("policy") == "accept"
            case "state":
                self.state = State(row["state"]).value
            case "decision":
                result, came = Result(row["result"]), bool(row["came"])
                self.decided[int(row["tag"])] = result, Code(row["code"]), came
                self.counts["decided"] += came
                self.counts["refused"] += came and result is not Result.ACCEPT
            case "unsent":
                self.counts["unsent"] += 1
            case "tray" if (found := self.decided.pop(int(row["tag"]), None)) is not None:
                self._reconcile(int(row["tag"]) - 1, *found, tray=str(row["tray"]))
            case "end":
                self.state = "ended"

    def _reconcile(self, sheet: int, result: Result, code: Code, came: bool, *, tray: str) -> None:
        verdict = "misprint" if code is Code.MISPRINT else ""
        account = account_of(result, verdict=verdict, tray=tray, came=came, tolerated=self.tolerated)
        self.counts["reconciled"] += 1
        self.counts[account] += 1
        self.last = sheet if self.last is None else max(self.last, sheet)
        if account == "wrong" and self.first_wrong is None:
            self.first_wrong = sheet


class GateFollower:
    """Of the run that was asked for last; one thread at a time."""

    def __init__(self, journal: Path) -> None:
        self._journal = journal
        self._read: _Read | None = None

    def of(self, run: RunRow, gated: Gated | None = None) -> GateHealth | None:
        """As of now; None: the run has no gate.

        gated: what became of its sheets; where the controller's log says it, that counts.
        """
        path = log_path(self._journal, run.id)
        try:
            size = path.stat().st_size
        except OSError:
            return None
        read = self._read
        if read is None or read.path != path or size < read.upto:
            read = self._read = _Read(path=path)
        _go_on(read)
        told = read.counts
        ended = run.state != "running" and read.state != "damaged"
        health = GateHealth(
            state="ended" if ended else read.state,
            decided=told["decided"],
            diverted=told["refused"],
            too_late=told["unsent"],
            reconciled=told["reconciled"],
            last_reconciled=read.last,
            lost=told["lost"],
            wrong=told["wrong"],
            first_wrong=read.first_wrong,
        )
        return health if gated is None or gated.found.source == "wire" else _by_log(health, gated.found)


def _by_log(health: GateHealth, found: Reconciliation) -> GateHealth:
    """With trays as the controller's log has them."""
    numbers = [one.sheet for one in found.sheets if one.tray and one.decision and one.sheet is not None]
    return replace(
        health,
        reconciled=len(numbers),
        last_reconciled=max(numbers, default=None),
        lost=found.counts["lost"],
        wrong=found.counts["wrong"],
        first_wrong=next((one.sheet for one in found.wrong if one.sheet is not None), None),
    )


def _go_on(read: _Read) -> None:
    """Read whole lines that are new."""
    if read.state == "damaged":
        return
    try:
        with read.path.open("rb") as file:
            file.seek(read.upto)
            lines, newline, _torn = file.read(AT_ONCE_BYTES).rpartition(b"\n")
        for line in lines.splitlines():
            read.add(json.loads(line))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        read.state = "damaged"
    else:
        read.upto += len(lines) + len(newline)

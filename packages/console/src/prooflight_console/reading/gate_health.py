"""Health of a run's gate, from its log as it grows: only new lines are read."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, Literal

from prooflight_line.plant.gate.handshake import State
from prooflight_line.plant.gate.log import log_path
from prooflight_line.plant.gate.reconciling import account_of
from prooflight_line.plant.gate.registers import Code, Result

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight_console.reading.gate import Gated
    from prooflight_line.journal.records import RunRow
    from prooflight_line.plant.gate.reconciling import Reconciliation

AT_ONCE_BYTES: Final = 8_000_000
"""Bytes of a log that are read at once; that of a long run is read in several steps."""

GateState = Literal["away", "joining", "aligning", "ready", "unknown", "ended", "damaged"]
"""State of the handshake while the run goes on.

unknown: the log does not name it. damaged: the log cannot be read further.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class GateHealth:
    """Health of a gate by its log so far; trays are as the controller reported them over the wire."""

    state: GateState
    decided: int
    """Number of sheets that came."""
    diverted: int
    """Number of these that were decided not to go to the good tray."""
    too_late: int
    """Number of sheets that passed before the controller had their result."""
    reconciled: int
    """Number of sheets with both a decision and a tray."""
    last_reconciled: int | None
    """Greatest number of these sheets; None if the controller has reported no tray yet."""
    lost: int
    """Number of good sheets in the reject tray."""
    wrong: int
    """Number of sheets in the good tray against their decision."""
    first_wrong: int | None

    @property
    def lamp(self) -> Literal["good", "look", "bad", "off"]:
        """State of the lamp; bad if a sheet is in a wrong tray, or the controller is not there."""
        if self.wrong or self.state in ("away", "damaged"):
            return "bad"
        if self.state in ("ended", "unknown"):
            return "off"
        return "look" if self.state != "ready" or self.lost or self.too_late else "good"


@dataclass(slots=True)
class _Read:
    """State of reading one log."""

    path: Path
    upto: int = 0
    state: GateState = "unknown"
    tolerated: bool = False
    decided: dict[int, tuple[Result, Code, bool]] = field(default_factory=dict)
    """Decisions by tag, until their trays are known."""
    counts: Counter[str] = field(default_factory=Counter)
    last: int | None = None
    first_wrong: int | None = None

    def add(self, row: dict[str, Any]) -> None:
        """Add one line; raises KeyError, TypeError or ValueError if it is malformed."""
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
            case "tray" if (decision := self.decided.pop(int(row["tag"]), None)) is not None:
                self._reconcile(int(row["tag"]) - 1, *decision, tray=str(row["tray"]))
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
    """Follower of the log of the run that was requested last; not thread-safe."""

    def __init__(self, journal: Path) -> None:
        self._journal = journal
        self._read: _Read | None = None

    def of(self, run: RunRow, gated: Gated | None = None) -> GateHealth | None:
        """Return the current health; None if the run has no gate.

        gated: accounts of its sheets; those by the controller's log have precedence over the wire.
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
        counts = read.counts
        ended = run.state != "running" and read.state != "damaged"
        health = GateHealth(
            state="ended" if ended else read.state,
            decided=counts["decided"],
            diverted=counts["refused"],
            too_late=counts["unsent"],
            reconciled=counts["reconciled"],
            last_reconciled=read.last,
            lost=counts["lost"],
            wrong=counts["wrong"],
            first_wrong=read.first_wrong,
        )
        return health if gated is None or gated.accounts.source == "wire" else _by_log(health, gated.accounts)


def _by_log(health: GateHealth, accounts: Reconciliation) -> GateHealth:
    """Return the health with trays from the controller's log."""
    numbers = [one.sheet for one in accounts.sheets if one.tray and one.decision and one.sheet is not None]
    return replace(
        health,
        reconciled=len(numbers),
        last_reconciled=max(numbers, default=None),
        lost=accounts.counts["lost"],
        wrong=accounts.counts["wrong"],
        first_wrong=next((one.sheet for one in accounts.wrong if one.sheet is not None), None),
    )


def _go_on(read: _Read) -> None:
    """Read the complete lines that are new."""
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

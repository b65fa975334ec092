"""The gate as one output: on while an accepted sheet passes, off for all others and when nothing is written.

The output is timed by the camera's lines, so its accuracy depends on the delay of the link: see
docs/how-to/gate.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight_line.plant.gate.handshake import State
from prooflight_line.plant.gate.log import PlantError
from prooflight_line.plant.gate.registers import Result
from prooflight_line.plant.gate.waiting import Waiting

if TYPE_CHECKING:
    from prooflight_line.plant.gate.link import Wire


class CoilProtocol(Waiting):
    """A ``Talk`` that holds sheets until their time at the gate, and sets the output accordingly."""

    session = 0
    """Session number, always 0: an output has no sessions."""

    def begin(self, wire: Wire) -> None:
        """Switch the output off and become ready; see ``Talk``."""
        wire.set_coil(False)
        self._went(State.READY, "")

    def turn(self, wire: Wire) -> None:
        """Write the output in every exchange, because it falls off when nothing is written; see ``Talk``."""
        started_s = self._clock()
        wire.set_coil(self._wanted(started_s))
        if self._clock() - started_s > self._half_s():
            # What was written may have come while another sheet passed.
            raise PlantError("PLC", "it answers too slowly for an output", remedy="use style = 'registers'")

    def end(self, wire: Wire) -> None:
        """Switch the output off; see ``Talk``."""
        wire.set_coil(False)

    def lost(self, why: str) -> None:
        """Go to the state ``AWAY``; see ``Talk``."""
        self._went(State.AWAY, why)

    @property
    def _rejects(self) -> bool:
        """Whether a sheet without a result is rejected: always, because an unwritten output is off under any policy."""
        return True

    def _half_s(self) -> float:
        """Return the time in which a sheet travels the tolerance, but at least one cycle. [s]"""
        speed = self._tracker.speed_mm_s
        cycle_s = self._settings.plc.cycle_ms / 1e3
        return cycle_s if not speed else max(self._settings.tolerance_mm / speed, cycle_s)

    def _wanted(self, now_s: float) -> bool:
        """Return whether the sheet at the gate is an accepted one."""
        half_s, wanted = self._half_s(), False
        with self._guard:
            self._overdue(now_s, after_s=half_s)
            for one in self._sheets.values():
                due_s = self._due_s(one)
                if due_s is not None and now_s >= due_s - half_s:
                    wanted |= one.decision.result is Result.ACCEPT
                    if not one.taken:
                        self._written(one, session=0, position=0, at_s=now_s)
        return wanted

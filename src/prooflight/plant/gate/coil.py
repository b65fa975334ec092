"""The gate as one output: on while a sheet passes that is accepted, off for all others and where nobody writes.

We time it by the camera's lines, so it is as good as the link is prompt: see docs/how-to/gate.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight.plant.gate.handshake import State
from prooflight.plant.gate.log import PlantError
from prooflight.plant.gate.registers import Result
from prooflight.plant.gate.waiting import Waiting

if TYPE_CHECKING:
    from prooflight.plant.gate.link import Wire


class CoilTalk(Waiting):
    """Sheets wait for their time at the gate; a ``Talk`` that sets the output by it."""

    session = 0
    """An output knows none."""

    def begin(self, wire: Wire) -> None:
        """See ``Talk``."""
        wire.set_coil(False)
        self._went(State.READY, "")

    def turn(self, wire: Wire) -> None:
        """See ``Talk``: written every time, for the output falls off where nobody writes."""
        asked_s = self._clock()
        wire.set_coil(self._wanted(asked_s))
        if self._clock() - asked_s > self._half_s():
            # What was written may have come while another sheet passed.
            raise PlantError("PLC", "it answers too slowly for an output", remedy="use style = 'registers'")

    def end(self, wire: Wire) -> None:
        """See ``Talk``."""
        wire.set_coil(False)

    def lost(self, why: str) -> None:
        """See ``Talk``."""
        self._went(State.AWAY, why)

    @property
    def _rejects(self) -> bool:
        """An output is off where nobody writes, whatever the policy."""
        return True

    def _half_s(self) -> float:
        """How long a sheet takes over the tolerance; never less than a cycle."""
        speed = self._tracker.speed_mm_s
        cycle_s = self._settings.plc.cycle_ms / 1e3
        return cycle_s if not speed else max(self._settings.tolerance_mm / speed, cycle_s)

    def _wanted(self, now_s: float) -> bool:
        """Whether the sheet at the gate is one that is accepted."""
        half_s, wanted = self._half_s(), False
        with self._guard:
            self._overdue(now_s, after_s=half_s)
            for one in self._sheets.values():
                due_s = self._tracker.due_s(one.line)
                if due_s is not None and now_s >= due_s - half_s:
                    wanted |= one.decision.result is Result.ACCEPT
                    if not one.taken:
                        self._written(one, session=0, position=0, at_s=now_s)
        return wanted

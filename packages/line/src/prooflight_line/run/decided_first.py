"""Order in which sheets are decided by a gate and reported: a misprint is decided before it is explained."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from prooflight.detectors.disposition import Disposition
    from prooflight_line.run.outcomes import Outcome


@dataclass(frozen=True, slots=True, kw_only=True)
class DecidedFirst:
    """Report of outcomes that lets a gate decide each of them once; called in the order of the run."""

    decide: Callable[[Outcome], Outcome] | None
    """Function of the gate, which returns an outcome with its decision; None: there is no gate."""
    tell: Callable[[Outcome], None]
    """Function to which the decided outcomes are reported."""
    _decided: dict[int, Disposition | None] = field(default_factory=dict)
    """Decisions on sheets that are not reported yet, by their numbers; held if the gate failed to decide."""

    def early(self, outcome: Outcome) -> None:
        """Let the gate decide the next sheet before it is reported, as a misprint that is still being explained."""
        if self.decide is not None:
            sheet = outcome.record.sheet
            self._decided[sheet] = "hold"
            self._decided[sheet] = self.decide(outcome).record.gate

    def __call__(self, outcome: Outcome) -> None:
        """Report an outcome, decided; a sheet that the gate fails to decide is reported as held."""
        sheet = outcome.record.sheet
        if self.decide is None:
            self.tell(outcome)
            return
        try:
            if sheet not in self._decided:
                self.early(outcome)
        finally:
            record = replace(outcome.record, gate=self._decided.pop(sheet))
            self.tell(replace(outcome, record=record))

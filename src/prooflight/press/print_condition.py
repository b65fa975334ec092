"""Printing condition and paper of a press, and what a job that asks for others is warned of."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Self

from prooflight.errors import JobError, plain
from prooflight.pages.warnings import WHOLE_FILE, PageWarning

if TYPE_CHECKING:
    from prooflight.pages.job import Job

CONDITION, BRAND, WEIGHT = "condition", "substrate_brand", "substrate_weight_gsm"
"""Names in ``Press.origin``; absent where the press file states nothing, so that digests stay."""
KIND: Final = "print-condition"
"""Kind of the warning."""
SAME_WEIGHT: Final = 0.05
"""Greatest difference of two weights that are the same paper. assumed: mills deliver within some 4 to 5 %."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PrintCondition:
    """What a press or a job states; empty or None: nothing."""

    name: str = ""
    """Name of the characterised printing condition, such as FOGRA51."""
    brand: str = ""
    """Brand of the paper."""
    weight_gsm: float | None = None
    """Weight of the paper. [g/m2]"""

    @classmethod
    def of_origin(cls, origin: Mapping[str, str]) -> Self:
        """Return the condition that a press artefact was built for."""
        weight = None
        with contextlib.suppress(KeyError, ValueError):
            weight = float(origin[WEIGHT])
        return cls(name=origin.get(CONDITION, ""), brand=origin.get(BRAND, ""), weight_gsm=weight)

    @property
    def facts(self) -> dict[str, str]:
        """The condition as texts for ``Press.origin``."""
        weight = "" if self.weight_gsm is None else f"{self.weight_gsm:g}"
        return {
            key: text for key, text in ((CONDITION, self.name), (BRAND, self.brand), (WEIGHT, weight)) if text
        }

    def differences(self, wanted: PrintCondition) -> Iterator[str]:
        """Yield one sentence for each point in which a job wants otherwise; what either does not state is no point."""
        if self.name and wanted.name and _letters(self.name) != _letters(wanted.name):
            yield (
                f"the job is made for {plain(wanted.name)}, and this press is characterised for "
                f"{plain(self.name)}: its colours will differ from the proof"
            )
        if self.brand and wanted.brand and _letters(self.brand) != _letters(wanted.brand):
            yield (
                f"the ticket asks for {plain(wanted.brand)}, and this press is characterised on "
                f"{plain(self.brand)}: load that paper, or use a press built for the other"
            )
        here, there = self.weight_gsm, wanted.weight_gsm
        if here and there and abs(here / there - 1) > SAME_WEIGHT:
            yield (
                f"the ticket asks for {there:g} g/m2, and this press is characterised on {here:g} g/m2: "
                "load that paper, or use a press built for the other"
            )


def condition_warnings(
    job: Job, press: PrintCondition, *, wanted: PrintCondition | None = None
) -> list[PageWarning]:
    """Return warnings where a job's output intent, or what its ticket asks for, is not what the press prints.

    press: what the press prints. wanted: paper of the ticket; None: there is none.
    """
    wanted = wanted or PrintCondition()
    with contextlib.suppress(JobError):  # a damaged file is reported by its pages
        facts = job.document_facts()
        if facts is not None:
            wanted = replace(wanted, name=facts.condition)
    return [PageWarning(page=WHOLE_FILE, kind=KIND, message=what) for what in press.differences(wanted)]


def _letters(name: str) -> str:
    """Return a name without blanks, hyphens and case, in which names of conditions are written differently."""
    return "".join(letter for letter in name.casefold() if letter.isalnum())

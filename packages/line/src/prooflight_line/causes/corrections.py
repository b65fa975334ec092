"""Corrections that a run's rows offer to the press (``run.monitor.corrections``)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight_line.run.monitor.corrections import DAMPING, INK_CHANNELS, correction_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight_line.journal.records import PageRecord
    from prooflight_line.run.monitor.corrections import Correction


def corrections_of(
    records: Sequence[PageRecord], *, since_sheet: int = 0, damping: float = DAMPING
) -> list[Correction]:
    """Return the state of each channel that was measured, in the order of the channels.

    Parameters
    ----------
    records
        Rows of the run in their order, good ones too.
    since_sheet
        First sheet that was printed after the last correction; earlier ones say nothing of the press as it is set.
    damping
        Share of a deviation that is offered, above 0 and at most 1. [-]

    ValueError: the damping is none.
    """
    since = [record for record in records if record.sheet >= since_sheet]
    offers = (
        correction_of(
            channel,
            [(one.sheet, one.nuisance[channel.name]) for one in since if channel.name in one.nuisance],
            damping=damping,
        )
        for channel in INK_CHANNELS
    )
    return [offer for offer in offers if offer is not None]

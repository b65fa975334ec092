"""Corrections that are offered to the press: offsets of density and register with their uncertainty, damped.

Nothing is applied here. An offer is a share of the deviation that was measured since the last correction took
effect. If it is applied each time, and measured anew on sheets that were printed with it, the deviation follows
e' = (1 - g) e + noise with the damping g: for 0 < g <= 1 its pole 1 - g is real and not negative, so that it
approaches 0 from one side, without oscillation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight_line.causes.trends import INK_CHANNELS, noise_sd

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight_line.journal.records import PageRecord
    from prooflight_line.run.monitor.channels import Channel

DAMPING: Final = 0.5
"""Share of a deviation that is offered. assumed: a deviation is halved each time, and noise is not amplified."""
SHEETS: Final = 20
"""Latest sheets that are averaged. assumed: four seconds at 5 sheets a second."""
LEAST_SHEETS: Final = 8
SURE_SDS: Final = 3.0
"""Least deviation for which a correction is offered, in standard deviations of the mean."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Correction:
    """An offer for one channel."""

    channel: Channel
    deviation: float
    """Mean deviation of the latest sheets, in the channel's own unit (share of ink, or mm)."""
    sd: float
    """Standard deviation of this mean."""
    offset: float
    """Amount to add to the press's setting; 0: the deviation is not sure."""
    sheets: int
    """Number of sheets that it rests on."""
    last_sheet: int


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
    if not 0 < damping <= 1:
        message = f"damping must be above 0 and at most 1, got {damping}"
        raise ValueError(message)
    since = [record for record in records if record.sheet >= since_sheet]
    corrections = []
    for channel in INK_CHANNELS:
        measured = [(one.sheet, one.nuisance[channel.name]) for one in since if channel.name in one.nuisance]
        latest = measured[-SHEETS:]
        if len(latest) < LEAST_SHEETS:
            continue
        values = np.array([value for _, value in latest])
        mean, sd = float(values.mean()), noise_sd(values) / float(np.sqrt(values.size))
        sure = abs(mean) > SURE_SDS * sd
        corrections.append(
            Correction(
                channel=channel,
                deviation=mean,
                sd=sd,
                offset=-damping * mean if sure else 0.0,
                sheets=values.size,
                last_sheet=latest[-1][0],
            )
        )
    return corrections

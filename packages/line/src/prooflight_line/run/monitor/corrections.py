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

from prooflight_line.run.monitor.channels import drift_channels

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight_line.run.monitor.channels import Channel

DAMPING: Final = 0.5
"""Share of a deviation that is offered. assumed: a deviation is halved each time, and noise is not amplified."""
SHEETS: Final = 20
"""Latest sheets that are averaged. assumed: four seconds at 5 sheets a second."""
LEAST_SHEETS: Final = 8
SURE_SDS: Final = 3.0
"""Least deviation for which a correction is offered, in standard deviations of the mean."""
INK_CHANNELS: Final = tuple(
    channel for channel in drift_channels(()) if channel.name.startswith(("gain-", "register-"))
)


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
    first_sheet: int
    last_sheet: int


def correction_of(
    channel: Channel, measured: Sequence[tuple[int, float]], *, damping: float = DAMPING
) -> Correction | None:
    """Return the state of one channel by its latest sheets; None: it was measured on too few.

    Parameters
    ----------
    measured
        Number of each sheet on which the channel was measured, in the order of the run, and its deviation, in the
        channel's own unit.
    damping
        Share of a deviation that is offered, above 0 and at most 1. [-]

    ValueError: the damping is none.
    """
    if not 0 < damping <= 1:
        message = f"damping must be above 0 and at most 1, got {damping}"
        raise ValueError(message)
    latest = measured[-SHEETS:]
    if len(latest) < LEAST_SHEETS:
        return None
    values = np.array([value for _, value in latest])
    mean, sd = float(values.mean()), noise_sd(values) / float(np.sqrt(values.size))
    return Correction(
        channel=channel,
        deviation=mean,
        sd=sd,
        offset=-damping * mean if abs(mean) > SURE_SDS * sd else 0.0,
        sheets=values.size,
        first_sheet=latest[0][0],
        last_sheet=latest[-1][0],
    )


def noise_sd(values: NDArray[np.float64]) -> float:
    """Return the standard deviation of values, of at least two, from their differences from one to the next.

    The mean square of the differences of independent values is twice their variance (von Neumann 1941).
    """
    return max(float(np.sqrt(np.mean(np.diff(values) ** 2) / 2)), 1e-9)

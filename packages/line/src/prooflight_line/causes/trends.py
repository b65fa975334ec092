"""Drifts and steps of what is measured on every sheet: ink densities, and the register of planes."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from scipy import special

from prooflight_line.run.monitor.corrections import INK_CHANNELS, noise_sd

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight_line.journal.records import PageRecord
    from prooflight_line.run.monitor.channels import Channel

FALSE_ALARM_RATE: Final = 0.01
"""Chance that a run without a change has a trend, all channels together. assumed: as that of repeats."""
LEAST_SHEETS: Final = 8
LEAST_SIDE: Final = 4
"""Least number of sheets on each side of a step. assumed: fewer are outliers as well as a step."""
LEAST_PLANES: Final = 3
"""Planes from which on it is known which of them is displaced."""
LEAST_SHARE: Final = 0.25
"""Least change that is a cause, as a share of the channel's tolerance. assumed: a smaller one explains no
misprint."""
NEAR: Final = 0.5
"""Share of its tolerance beyond which a channel may be why a sheet has marks. Assumed: what is recorded of a misprint
is a part of what it is off by, and varies by a third of a tolerance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trend:
    """A change of one channel over a run."""

    channel: Channel
    shape: Literal["drift", "step"]
    sheet: int
    """First sheet after a step; first sheet of the run for a drift."""
    last_sheet: int
    beyond: tuple[int, ...]
    """Sheets from then on that are beyond the channel's tolerance."""
    near: tuple[int, ...]
    """Sheets from then on that are beyond half of the tolerance."""
    change: float
    """Height of a step, or change over the run, in the channel's own unit."""
    sd: float
    """Standard deviation of the change."""
    z: float
    """Change over its standard deviation."""


def trends_of(records: Sequence[PageRecord]) -> list[Trend]:
    """Return the channels that drifted or stepped, the largest change in tolerances first.

    A line and every step are fitted by least squares; the one with the greater z counts, if z is above the
    quantile of a normal distribution at the false-alarm rate over the number of fits (Bonferroni). The noise is
    that of the differences of neighbouring sheets, to which a drift and a step hardly contribute.
    """
    trends = []
    amounts = [(one.sheet, _between_planes(one.nuisance)) for one in records]
    for channel in INK_CHANNELS:
        rows = [(sheet, own[channel.name]) for sheet, own in amounts if channel.name in own]
        if len(rows) < LEAST_SHEETS:
            continue
        sheets, values = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
        fits = len(INK_CHANNELS) * len(rows)
        limit = -float(special.ndtri(FALSE_ALARM_RATE / (2 * fits)))
        trend = _trend(channel, sheets, values)
        if abs(trend.z) > limit and abs(trend.change) > LEAST_SHARE * channel.tolerance:
            trends.append(trend)
    return sorted(trends, key=lambda trend: -abs(trend.change) / trend.channel.tolerance)


def _between_planes(amounts: Mapping[str, float]) -> dict[str, float]:
    """Return amounts with the register of each plane relative to the median of the others.

    A page lies where most of its design lies: where the plane that prints most of it is displaced, the amounts say
    that all others are, the other way. Of two planes either may be displaced, and their amounts stay.
    """
    between = dict(amounts)
    for axis in ("-x", "-y"):
        planes = {
            name: value
            for name, value in amounts.items()
            if name.startswith("register-") and name.endswith(axis)
        }
        for name, value in planes.items() if len(planes) >= LEAST_PLANES else ():
            between[name] = value - median(other for key, other in planes.items() if key != name)
    return between


def _trend(channel: Channel, sheets: NDArray[np.int64], values: NDArray[np.float64]) -> Trend:
    noise = noise_sd(values)
    count = values.size
    centred = sheets - sheets.mean()
    slope = float((centred * values).sum() / (centred**2).sum())
    slope_sd = noise / float(np.sqrt((centred**2).sum()))
    before = np.arange(LEAST_SIDE, count - LEAST_SIDE + 1)
    sums = np.cumsum(values)[before - 1]
    steps = (values.sum() - sums) / (count - before) - sums / before
    step_sd = noise * np.sqrt(1 / before + 1 / (count - before))
    z = steps / step_sd
    at = int(np.argmax(np.abs(z)))
    if abs(z[at]) > abs(slope / slope_sd):
        shape: Literal["drift", "step"] = "step"
        first, change, sd = int(sheets[before[at]]), float(steps[at]), float(step_sd[at])
    else:
        span = int(sheets[-1] - sheets[0])
        shape, first, change, sd = "drift", int(sheets[0]), slope * span, slope_sd * span

    def beyond(share: float) -> tuple[int, ...]:
        off = (sheets >= first) & (np.abs(values) > share * channel.tolerance)
        return tuple(sheets[off].tolist())

    return Trend(
        channel=channel,
        shape=shape,
        sheet=first,
        last_sheet=int(sheets[-1]),
        beyond=beyond(1.0),
        near=beyond(NEAR),
        change=change,
        sd=sd,
        z=change / sd,
    )

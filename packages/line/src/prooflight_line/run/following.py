"""Adaptation to slow changes of lamp and paper, so that they neither raise alarms nor mask faults that should.

Few amounts are adapted, on purpose: the light of each sensor and six smooth waves of the lamp across the field,
which vary on a good press anyway. A streak, a spot, an ink or a register error cannot be adapted to, however
slowly it grows. Each amount follows the pages by exponential smoothing with a small gain, with each page's step
limited by its scatter, and never leaves a bound around its value at commissioning. Reaching the bound is evidence
in itself, and the adapted amounts count in full for the run (``run.monitor.run``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from prooflight.detectors.base import LAMP_WAVES

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from prooflight.press.artefact import Press

PACE: Final = 1 / 32
"""Gain of the exponential smoothing: it lags a steady drift by 32 pages and passes an eighth of a page's
scatter."""
MOST_SDS: Final = 2.0
"""Limit of a page's deviation, in standard deviations: a misprint moves the level no more than a good page
does."""
BOUND_SDS: Final = 3.0
"""Bound of the adaptation, in standard deviations of good presses: one press in 370 would reach it."""
RENEW_PAGES: Final = 50
"""Least number of pages between two predictions of the same designs."""
RENEW_SHARE: Final = 0.4
"""Share of the standard deviation by which an amount must move before designs are predicted again. The level
scatters by 0.13 standard deviations; a smaller share would predict every design again each 50 pages."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Adapting:
    """Amounts that are adapted during a run; call ``see`` with every page in the order of the run."""

    names: tuple[str, ...]
    sd: NDArray[np.float64]
    """Standard deviation of each amount among good presses and prints. [-]"""
    level: NDArray[np.float64]
    """Present level of each amount, relative to the press artefact. [-]"""
    used: NDArray[np.float64]
    """Level of each amount with which designs are predicted. [-]"""
    reported: NDArray[np.bool_]
    """Amounts that were already reported to be at their bound."""
    last: NDArray[np.int64]
    """(1,) sheet at which designs were last predicted again."""

    @classmethod
    def begin(cls, press: Press) -> Self:
        """Return the state before the first page: all levels are 0."""
        prior = press.print_prior
        names = [f"light-{sensor.name}" for sensor in press.sensors]
        names += [f"lamp-{k}" for k in range(1, LAMP_WAVES + 1)]
        white = float(np.hypot(prior.white, prior.common))
        zeros = np.zeros(len(names))
        return cls(
            names=tuple(names),
            sd=np.concatenate([np.full(len(press.sensors), white), prior.lamp_sd]),
            level=zeros,
            used=zeros.copy(),
            reported=np.zeros(len(names), bool),
            last=np.full(1, -RENEW_PAGES),
        )

    @property
    def bound(self) -> NDArray[np.float64]:
        """Largest level that each amount may reach. [-]"""
        return BOUND_SDS * self.sd

    def whole(self, values: Mapping[str, float], used: NDArray[np.float64]) -> dict[str, float]:
        """Return a page's amounts relative to the press artefact, from those relative to a prediction at ``used``."""
        level_of = dict(zip(self.names, used.tolist(), strict=True))
        return {name: value + level_of.get(name, 0.0) for name, value in values.items()}

    def see(self, values: Mapping[str, float]) -> list[tuple[str, float]]:
        """Adapt to a page's amounts; return those that have just reached their bound, with their levels."""
        deviation = np.array([values.get(name, np.nan) for name in self.names]) - self.level
        step = PACE * np.clip(np.nan_to_num(deviation), -MOST_SDS * self.sd, MOST_SDS * self.sd)
        self.level[:] = np.clip(self.level + step, -self.bound, self.bound)
        new_at_bound = (np.abs(self.level) >= self.bound) & ~self.reported
        self.reported[new_at_bound] = True
        return [(self.names[i], float(self.level[i])) for i in np.flatnonzero(new_at_bound)]

    def renewed(self, press: Press, sheet: int) -> Press | None:
        """Return the press to predict with from now on, or None if the levels have not moved enough."""
        moved = np.abs(self.level - self.used) > RENEW_SHARE * self.sd
        if sheet - self.last[0] < RENEW_PAGES or not moved.any():
            return None
        self.last[0] = sheet
        self.used[:] = self.level
        return followed(press, self.names, self.used)


def followed(press: Press, names: tuple[str, ...], level: NDArray[np.float64]) -> Press:
    """Return the press with these amounts of light multiplied into its sensors' column gains."""
    level_of = dict(zip(names, level.tolist(), strict=True))
    u = (np.arange(press.geometry.pixels) + 0.5) / press.geometry.pixels
    lamp = sum(level_of[f"lamp-{k}"] * np.cos(k * np.pi * u) for k in range(1, LAMP_WAVES + 1))
    sensors = tuple(
        replace(
            sensor,
            column_gain=(sensor.column_gain * (1 + level_of[f"light-{sensor.name}"] + lamp)).astype(
                sensor.column_gain.dtype
            ),
        )
        for sensor in press.sensors
    )
    return replace(press, sensors=sensors)

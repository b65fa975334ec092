"""Slow changes of lamp and paper are followed, so that they neither alarm nor hide what does.

What is followed is small on purpose: the light of each sensor and six smooth waves of the lamp across the field, the
amounts that a good press changes anyway. A streak, a spot, an ink or a register cannot be followed, however slowly it
comes. Each amount goes after the pages with a small pace, after no page faster than its scatter allows, and never
further from where the press was commissioned than a bound; to stand at the bound is evidence of its own, and what
has been followed counts in full for the run (``line.monitor.run``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from prooflight.detectors.base import LAMP_WAVES
from prooflight.detectors.matched_filter.fit.nuisance import PrintPrior

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from prooflight.press.artefact import Press

PACE: Final = 1 / 32
"""Of what a page is off, followed: lags a steady drift by 32 pages, scatters by an eighth of a page's scatter."""
MOST_SDS: Final = 2.0
"""A page that is further off counts as so far: a misprint moves it no more than a good page."""
BOUND_SDS: Final = 3.0
"""Of what good presses do: one press in 370 would stand there."""
RENEW_PAGES: Final = 50
"""Between times that designs are predicted anew."""
RENEW_SHARE: Final = 0.4
"""Of the standard deviation: designs are predicted anew when an amount has moved by so much. What is followed scatters
by 0.13 of it, and to run after that would have every design made again every 50 pages."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Adapting:
    """Amounts that are followed; ``see`` every page in the order of the run."""

    names: tuple[str, ...]
    sd: NDArray[np.float64]
    """What good presses and prints do, by amount. [-]"""
    level: NDArray[np.float64]
    """Now, over what the press artefact says. [-]"""
    used: NDArray[np.float64]
    """With which designs are predicted. [-]"""
    told: NDArray[np.bool_]
    """Amounts that have been said to stand at their bound."""
    last: NDArray[np.int64]
    """(1,) sheet at which designs were last predicted anew."""

    @classmethod
    def begin(cls, press: Press) -> Self:
        """Nothing is followed yet."""
        known = PrintPrior() if press.ours is None else press.ours.model.prior
        waves = np.arange(1, LAMP_WAVES + 1)
        power = np.exp(-((np.pi * known.lamp_length * waves) ** 2) / 4)
        lamp = known.lamp * np.sqrt(power / (0.5 * power.sum() + 0.5))
        names = [f"light-{sensor.name}" for sensor in press.sensors] + [f"lamp-{k}" for k in waves]
        white = float(np.hypot(known.white, known.common))
        zeros = np.zeros(len(names))
        return cls(
            names=tuple(names),
            sd=np.concatenate([np.full(len(press.sensors), white), lamp]),
            level=zeros,
            used=zeros.copy(),
            told=np.zeros(len(names), bool),
            last=np.full(1, -RENEW_PAGES),
        )

    @property
    def bound(self) -> NDArray[np.float64]:
        """How far each amount may be followed. [-]"""
        return BOUND_SDS * self.sd

    def whole(self, values: Mapping[str, float], used: NDArray[np.float64]) -> dict[str, float]:
        """A page's amounts, found against a prediction that followed ``used``, over what the press artefact says."""
        of = dict(zip(self.names, used.tolist(), strict=True))
        return {name: value + of.get(name, 0.0) for name, value in values.items()}

    def see(self, values: Mapping[str, float]) -> list[tuple[str, float]]:
        """Follow a page's whole amounts; returns those that come to stand at their bound, with their levels."""
        off = np.array([values.get(name, np.nan) for name in self.names]) - self.level
        step = PACE * np.clip(np.nan_to_num(off), -MOST_SDS * self.sd, MOST_SDS * self.sd)
        self.level[:] = np.clip(self.level + step, -self.bound, self.bound)
        news = (np.abs(self.level) >= self.bound) & ~self.told
        self.told[news] = True
        return [(self.names[i], float(self.level[i])) for i in np.flatnonzero(news)]

    def renewed(self, press: Press, sheet: int) -> Press | None:
        """The press to predict with from now on, if it has moved enough to be worth it."""
        moved = np.abs(self.level - self.used) > RENEW_SHARE * self.sd
        if sheet - self.last[0] < RENEW_PAGES or not moved.any():
            return None
        self.last[0] = sheet
        self.used[:] = self.level
        return followed(press, self.names, self.used)


def followed(press: Press, names: tuple[str, ...], level: NDArray[np.float64]) -> Press:
    """The press with these amounts of light in its columns' gains."""
    of = dict(zip(names, level.tolist(), strict=True))
    u = (np.arange(press.geometry.pixels) + 0.5) / press.geometry.pixels
    lamp = sum(of[f"lamp-{k}"] * np.cos(k * np.pi * u) for k in range(1, LAMP_WAVES + 1))
    sensors = tuple(
        replace(
            sensor,
            column_gain=(sensor.column_gain * (1 + of[f"light-{sensor.name}"] + lamp)).astype(
                sensor.column_gain.dtype
            ),
        )
        for sensor in press.sensors
    )
    return replace(press, sensors=sensors)

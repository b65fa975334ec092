"""Good prints and misprints of a page design, seen in one of the worlds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from prooflight.prediction.predict import Prediction, predict
from prooflight.scans.placement import IN_PLACE, Placement
from prooflight.simulation.fast import fast_mean_variance, noisy
from prooflight.simulation.misprints.kinds import Misprint, draw_misprint
from prooflight.simulation.prints import Print, composed
from prooflight.simulation.scans import TRIES, ideal_scan, passes_gate
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import World, amounts_of, gate

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Printed:
    """Printed page, good or a misprint: its raster, and its placement by a misprint."""

    page: Page
    expected: Prediction
    """Prediction of exactly this page by the press's tables."""
    placement: Placement = IN_PLACE
    misprint: Misprint | None = None
    """Misprint; None: a good print."""
    draws: int = 0
    """Number of misprints drawn until one reached the gate."""

    @property
    def kind(self) -> str:
        """Return the kind of misprint; empty: a good print."""
        return self.misprint.kind if self.misprint else ""

    @property
    def severity(self) -> float:
        """Return the severity of the misprint; 0: a good print."""
        return self.misprint.severity if self.misprint else 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimulatedDay:
    """Press on one day: all parameters that its prints share."""

    press: Press
    session: Session | None
    """Session of the day; None in the ideal world, where every day is alike."""

    @classmethod
    def begin(cls, world: World, press: Press, rng: np.random.Generator) -> SimulatedDay:
        """Begin a new day."""
        session = None if world == "ideal" else Session.draw(amounts_of(press, world), press, rng)
        return cls(press=press, session=session)

    def expected(self, page: Page, placement: Placement = IN_PLACE) -> Prediction:
        """Predict a page at this placement by the tables."""
        sensors, geometry = self.press.sensors, self.press.geometry
        return predict(page, sensors=sensors, geometry=geometry, placement=placement, threads=1)

    def good(self, page: Page) -> Printed:
        """Print a page without a misprint."""
        return Printed(page=page, expected=self.expected(page))

    def wrong(
        self,
        good: Printed,
        kind: str,
        *,
        others: Sequence[int],
        fetch: Callable[[int], Page],
        rng: np.random.Generator,
    ) -> Printed | None:
        """Print a misprint of a kind, its severity drawn uniformly from 0..1.

        None if nine draws all stay below the gate.

        A draw that changes too little is drawn again, severity and all, at most 8 times (``worlds.toml``).
        """
        for draw in range(1, TRIES + 1):
            drawn = draw_misprint(good.page, kind, float(rng.random()), others=others, fetch=fetch, rng=rng)
            changed = self.expected(drawn.page, drawn.placement)
            if passes_gate(good.expected, changed, self.press, gate()):
                return Printed(
                    page=drawn.page,
                    expected=changed,
                    placement=drawn.placement,
                    misprint=drawn.misprint,
                    draws=draw,
                )
        return None

    def seen(self, printed: Printed, rng: np.random.Generator) -> Prediction:
        """Return mean and variance of the camera's signal of one more print."""
        if self.session is None:
            return printed.expected
        return self.seen_in_press(printed.page, rng, printed.placement)

    def seen_in_press(
        self, page: Page, rng: np.random.Generator, placement: Placement = IN_PLACE
    ) -> Prediction:
        """Return the same for a page at a misprint's placement, in the press world, whatever the tables predict."""
        assert self.session is not None
        print_ = Print.draw(self.session, self.press, page, rng)
        moved = replace(print_, placement=composed(placement, print_.placement))
        return fast_mean_variance(page, self.press, self.session, moved)

    def recorded(self, seen: Prediction, rng: np.random.Generator) -> NDArray[np.uint16]:
        """Draw the scan. (sensors, lines, pixels) [DN]"""
        return ideal_scan(seen, self.press, rng) if self.session is None else noisy(seen, self.press, rng)

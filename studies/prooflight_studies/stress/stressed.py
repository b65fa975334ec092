"""A press day under a nuisance, each of whose prints has a twin without it."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from prooflight.camera.sensor import ROUNDING_DN2
from prooflight.prediction.predict import Prediction
from prooflight.rng import stream
from prooflight.scans.placement import IN_PLACE, Placement
from prooflight.simulation.captures import SimulatedDay
from prooflight.simulation.fast import fast_mean_variance
from prooflight.simulation.prints import Print, composed
from prooflight_studies.stress.nuisances import Passing

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.press.press_file import PressFile
    from prooflight_studies.stress.nuisances import Nuisance


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StressedDay(SimulatedDay):
    """A day in the press world under a nuisance, which the expectations of its tables do not include."""

    nuisance: Nuisance
    true_press: Press
    place: tuple[float, float]
    """``Passing.place``."""
    others: Sequence[int] = ()
    fetch: Callable[[int], Page] | None = None

    def seen_in_press(
        self, page: Page, rng: np.random.Generator, placement: Placement = IN_PLACE
    ) -> Prediction:
        """Return ``SimulatedDay.seen_in_press`` of the same print under the nuisance.

        ``rng`` is drawn from as there and no further: the nuisance has its own generator, seeded by what ``rng`` would
        draw next.
        """
        assert self.session is not None
        print_ = Print.draw(self.session, self.press, page, rng)
        own = stream(int(deepcopy(rng).integers(2**63)), "stress-nuisance")
        where = composed(placement, print_.placement)
        where = self.nuisance.moved(where, page, self.press.geometry, own)
        seen = fast_mean_variance(page, self.true_press, self.session, replace(print_, placement=where))
        passing = Passing(
            press=self.press,
            page=page,
            placement=where,
            place=self.place,
            others=self.others,
            fetch=self.fetch,
        )
        change = self.nuisance.light_change(passing, own)
        return seen if change is None else lit_otherwise(seen, change, self.press)


def stressed(
    day: SimulatedDay,
    nuisance: Nuisance,
    *,
    rng: np.random.Generator,
    others: Sequence[int] = (),
    fetch: Callable[[int], Page] | None = None,
    press_file: PressFile | None = None,
) -> StressedDay:
    """Return the day under a nuisance; with equal rng, its prints are those of ``day`` but for the nuisance.

    rng: draws what is constant for the day. others, fetch: designs, for show-through. press_file: that the press was
    built from, for the effect of a lamp. ValueError: the day is not of the press world, or the nuisance lacks what it
    needs.
    """
    if day.session is None:
        raise ValueError("nuisances are of the press world: this day has no session")
    return StressedDay(
        press=day.press,
        session=nuisance.session(day.session),
        nuisance=nuisance,
        true_press=nuisance.true_press(day.press, press_file),
        place=(float(rng.random()), float(rng.random())),
        others=tuple(others),
        fetch=fetch,
    )


def lit_otherwise(seen: Prediction, change: NDArray[np.floating], press: Press) -> Prediction:
    """Multiply the light by 1 + change, (sensors, lines, pixels) once broadcast; a change of 0 keeps every bit.

    The variance except that of rounding takes the same factor: exact for shot noise, and to first order of a few per
    cent for halftone (which scales with the square) and for read noise (which stays).
    """
    offset = np.stack([sensor.column_offset_dn for sensor in press.sensors])[:, None]
    top = np.array([sensor.top_code_dn for sensor in press.sensors], np.float32)[:, None, None]
    more = change.astype(np.float32)
    mean = seen.expected_dn + (seen.expected_dn - offset) * more
    variance = seen.variance_dn2 + (seen.variance_dn2 - np.float32(ROUNDING_DN2)) * more
    return Prediction(expected_dn=mean.clip(0, top), variance_dn2=variance)

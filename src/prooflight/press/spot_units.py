"""Units of a press that print spot inks of their own, and what they print of a job.

A press that prints a spot colour by its process inks has no unit of it, and prints it by the file's tint transform.
Prediction's tables are over the four process inks. So the ink of a unit is predicted as the mixture of these that gives
this press's camera the same light, tint by tint (decision 45).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Self

import numpy as np
from pydantic import Field

from prooflight.files.fields import NO_OTHER_FIELDS
from prooflight.pages.spots.spot_ink import STEPS, SpotInk, SpotPrint
from prooflight.prediction.mixtures import mixtures
from prooflight.spectra import BANDS

if TYPE_CHECKING:
    from prooflight.prediction.tables import SensorModel
    from prooflight.press.job_spectra import JobSpectra

MOST_UNITS: Final = 12
"""Greatest number of units. Assumed: presses with twelve printing units in all are the largest."""
LIGHT_OFF: Final = 0.02
"""Greatest difference of light, as a share of paper white, of which no warning is given.

Assumed: prints of one page vary by as much from day to day.
"""
OPAQUE: Final = 0.5
"""Opacity from which an ink hides more of what it overprints than it shows."""
PRESS_FILE: Final = "the press file"

Factor = Annotated[float, Field(strict=True, ge=0, le=2, allow_inf_nan=False)]
Spectrum = Annotated[tuple[Factor, ...], Field(min_length=BANDS, max_length=BANDS)]
Response = Annotated[
    tuple[Annotated[float, Field(strict=True, ge=0, le=1e6, allow_inf_nan=False)], ...],
    Field(min_length=BANDS, max_length=BANDS),
]
Tint = Annotated[float, Field(strict=True, ge=0, le=1)]


@dataclass(frozen=True, slots=True, kw_only=True)
class SpotUnit:
    """A unit that prints one spot ink; its spectra, if the press file states them."""

    __pydantic_config__: ClassVar = NO_OTHER_FIELDS

    name: Annotated[str, Field(strict=True, min_length=1, max_length=255)]
    """Name of the colorant in PDFs."""
    tint: tuple[Tint, ...] = ()
    """Tints of ``SpotInk.tint``; empty: the press file states no spectrum, and jobs do."""
    measured: tuple[Spectrum, ...] = ()
    on_black: Spectrum | None = None
    condition: Annotated[str, Field(strict=True, max_length=255)] = ""

    def __post_init__(self) -> None:
        """Check that there is a spectrum for each tint, rising to the solid."""
        rising = all(low < high for low, high in zip(self.tint, self.tint[1:], strict=False))
        if len(self.tint) != len(self.measured) or not rising or self.tint[-1:] not in ((), (1.0,)):
            message = f"spot ink {self.name} must have a spectrum for each tint, rising to 1"
            raise ValueError(message)

    @classmethod
    def of(cls, ink: SpotInk) -> Self:
        """Return the unit that prints a measured ink."""
        return cls(
            name=ink.name,
            tint=tuple(ink.tint.tolist()),
            measured=tuple(map(tuple, ink.measured.tolist())),
            on_black=None if ink.on_black is None else tuple(ink.on_black.tolist()),
            condition=ink.condition,
        )

    @property
    def ink(self) -> SpotInk | None:
        """Return the spectra of the press file; None: it states none."""
        if not self.tint:
            return None
        return SpotInk(
            name=self.name,
            tint=np.array(self.tint),
            measured=np.array(self.measured),
            on_black=None if self.on_black is None else np.array(self.on_black),
            condition=self.condition,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SpotUnits:
    """The units of a press, and what its camera makes of a spectrum."""

    __pydantic_config__: ClassVar = NO_OTHER_FIELDS

    units: Annotated[tuple[SpotUnit, ...], Field(min_length=1, max_length=MOST_UNITS)]
    response_dn: Annotated[tuple[Response, ...], Field(min_length=1, max_length=16)]
    """Light signal of each sensor by the reflectance of each of 36 bands, above dark, column gain 1. [DN]"""
    paper: Spectrum
    """Reflectance factor of the paper for which the press was characterised. [-]"""

    @classmethod
    def from_plain(cls, plain: Mapping[str, Any]) -> Self:
        """Return the units from their form in JSON, that of ``dataclasses.asdict``."""
        units = []
        for one in plain["units"]:
            black = one["on_black"]
            units.append(
                SpotUnit(
                    name=one["name"],
                    tint=tuple(one["tint"]),
                    measured=tuple(map(tuple, one["measured"])),
                    on_black=None if black is None else tuple(black),
                    condition=one["condition"],
                )
            )
        response = tuple(map(tuple, plain["response_dn"]))
        return cls(units=tuple(units), response_dn=response, paper=tuple(plain["paper"]))

    @property
    def take_from_jobs(self) -> bool:
        """Return whether a unit takes its spectrum from jobs."""
        return any(unit.ink is None for unit in self.units)

    def prints(self, sensors: Sequence[SensorModel], job: JobSpectra) -> tuple[SpotPrint, ...]:
        """Return what the units print of a job.

        The press file's spectrum of an ink comes before the job's: it was measured of this ink on this press, the job's
        is of the ink as it was specified, on whatever it was specified for.
        """
        return tuple(self._print(sensors, unit, job) for unit in self.units)

    def _print(self, sensors: Sequence[SensorModel], unit: SpotUnit, job: JobSpectra) -> SpotPrint:
        ink = unit.ink or job.inks.get(unit.name)
        if ink is None:
            fault = job.faults.get(unit.name)
            why = "neither the press file nor the job states its spectrum" if fault is None else str(fault)
            text = f"this press prints it by a unit of its own, and {why}: it is predicted by the file's tint transform"
            return SpotPrint(name=unit.name, warnings=(text,))
        paper = np.array(self.paper)
        own = ink.on_paper(paper)
        light_dn = (
            np.array([own.reflectance(tint) for tint in np.linspace(0, 1, STEPS)])
            @ np.array(self.response_dn).T
        )
        mixed = mixtures(sensors, light_dn)
        off = float(np.abs(mixed.off).max())
        warnings = []
        if off > LIGHT_OFF:
            worst = int(np.abs(mixed.off).max(axis=1).argmax())
            tint = 100 * worst / (STEPS - 1)
            warnings.append(
                f"no mixture of process inks gives this camera its signal, which is predicted {100 * off:.1f} % of "
                f"white off at a tint of {tint:.0f} %: good prints of it may be called misprints"
            )
        opacity = job.solidities.get(unit.name) if ink.opacity is None else ink.opacity
        if opacity is not None and opacity >= OPAQUE:
            warnings.append(
                f"it is opaque ({opacity:.2f}), and predicted as transparent where it overprints other inks"
            )
        recipes = tuple(tuple(recipe) for recipe in mixed.cmyk.tolist())
        return SpotPrint(name=unit.name, mixture=recipes, light_off=off, warnings=tuple(warnings))

"""Spectra that are stated of a job's spot inks, and what a press prints of these inks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from prooflight.commissioning.inks import inks_of
from prooflight.pages.warnings import WHOLE_FILE, PageWarning
from prooflight.press.job_spectra import JobSpectra
from prooflight.press.spot_units import PRESS_FILE
from prooflight.reporting.wording import count
from prooflight.spectra import delta_e00, lab

if TYPE_CHECKING:
    from prooflight.inks.reflectance import ReflectanceModel
    from prooflight.pages.job import Job
    from prooflight.pages.spots.spot_ink import SpotPrint
    from prooflight.press.artefact import Press

KIND: Final = "spot-spectrum"
"""Kind of the warning that spectra of an ink cannot be read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedSpots:
    """Spot inks of a job, and what a press prints of them."""

    spectra: JobSpectra = field(default_factory=JobSpectra)
    """Spectra that the job states, and those of the press's own units."""
    units: Mapping[str, SpotPrint] = field(default_factory=dict)
    """Inks that the press prints by units of their own."""
    process: ReflectanceModel | None = None
    """Ink model of the press; None: there is no press, or it carries none."""

    @classmethod
    def of(cls, job: Job, press: Press | None) -> Self:
        """Read the spectra that are stated of a job's inks; JobError: damaged."""
        if press is None:
            return cls()
        stated = JobSpectra.of(job.source.path, job.document_facts())
        units = () if press.spot_units is None else press.spot_units.units
        own = {unit.name: unit.ink for unit in units if unit.ink is not None}
        origins = {**stated.origins, **dict.fromkeys(own, PRESS_FILE)}
        spectra = replace(stated, inks={**stated.inks, **own}, origins=origins)
        return cls(
            spectra=spectra,
            units={spot.name: spot for spot in job.source.spots},
            process=inks_of(press) if spectra.inks and press.ink_facts else None,
        )

    @property
    def warnings(self) -> tuple[PageWarning, ...]:
        """One warning for each spectrum that cannot be read."""
        return tuple(
            PageWarning(page=WHOLE_FILE, kind=KIND, message=str(error), object_name=name)
            for name, error in self.spectra.faults.items()
        )

    def delta_e00(self, name: str, cmyk: Sequence[int] | None) -> float | None:
        """Return how far the print of a full spot ink lies from its spectrum, by CIEDE2000 (D50, 2 degrees).

        cmyk: what is printed for it, 0 to 255. None: no spectrum is stated, nothing is printed, or the press prints it
        by a unit of its own, so that process inks only stand for it.
        """
        ink = self.spectra.inks.get(name)
        if ink is None or cmyk is None or self.process is None or name in self.units:
            return None
        printed = self.process.reflectance(np.array(cmyk) / 255)
        return round(float(delta_e00(lab(ink.solid), lab(printed))), 2)

    def spectrum(self, name: str) -> dict[str, Any] | None:
        """Return what is stated of an ink's spectrum, for programs; None: nothing is."""
        ink = self.spectra.inks.get(name)
        if ink is None:
            return None
        return {
            "from": self.spectra.origins[name],
            "condition": ink.condition or None,
            "tints": len(ink.tint),
            "opacity": self.spectra.solidities.get(name) if ink.opacity is None else ink.opacity,
        }

    def spectrum_text(self, name: str) -> str:
        """Return the same for people, in a few words."""
        stated = self.spectrum(name)
        if stated is None:
            return "not stated"
        parts = [
            stated["from"],
            stated["condition"] or "condition not stated",
            count(stated["tints"], "tint"),
        ]
        return ", ".join(parts + ([] if stated["opacity"] is None else [f"opacity {stated['opacity']:.2f}"]))

    def light_off_percent(self, name: str) -> float | None:
        """Return the light of a unit's ink that prediction misses, in per cent of white; None: it has no unit."""
        unit = self.units.get(name)
        return None if unit is None or not unit.mixture else round(100 * unit.light_off, 2)

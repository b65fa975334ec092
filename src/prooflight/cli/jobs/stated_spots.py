"""Spot inks whose spectra a job's file states (CxF/X-4), beside what the inks of a press print of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from prooflight.commissioning.inks import inks_of
from prooflight.errors import ChartError
from prooflight.pages.spots.cxf import read_spot_ink
from prooflight.pages.warnings import WHOLE_FILE, PageWarning
from prooflight.spectra import delta_e00, lab

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from prooflight.inks.reflectance import ReflectanceModel
    from prooflight.pages.job import Job
    from prooflight.pages.spots.spot_ink import SpotInk
    from prooflight.press.artefact import Press

KIND: Final = "spot-spectrum"
"""Kind of the warning that spectra of an ink cannot be read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedSpots:
    """Spot inks of a job, and the process inks of a press."""

    inks: Mapping[str, SpotInk]
    """By their names; empty: the file states none, or there is no press."""
    process: ReflectanceModel | None
    """Ink model of the press; None: there is no press, or it carries none."""
    warnings: tuple[PageWarning, ...] = ()

    @classmethod
    def of(cls, job: Job, press: Press | None) -> Self:
        """Read the spectra that a job states; what cannot be read is a warning. JobError: the file is damaged."""
        facts = None if press is None else job.document_facts()
        if press is None or facts is None or not facts.spectra or not press.ink_facts:
            return cls(inks={}, process=None)
        inks, warnings = dict[str, SpotInk](), list[PageWarning]()
        for name, text in facts.spectra.items():
            try:
                inks[name] = read_spot_ink(text, name)
            except ChartError as error:
                warnings.append(PageWarning(page=WHOLE_FILE, kind=KIND, message=str(error), object_name=name))
        return cls(inks=inks, process=inks_of(press), warnings=tuple(warnings))

    def delta_e00(self, name: str, cmyk: Sequence[int] | None) -> float | None:
        """Return how far the print of a full spot ink lies from its spectrum, by CIEDE2000 (D50, 2 degrees).

        cmyk: what is printed for it, 0 to 255. None: the file states no spectrum, or nothing is printed.
        """
        ink = self.inks.get(name)
        if ink is None or cmyk is None or self.process is None:
            return None
        printed = self.process.reflectance(np.array(cmyk) / 255)
        return round(float(delta_e00(lab(ink.solid), lab(printed))), 2)

"""Spectra of the spot inks of a job: in a CxF file beside it, and in its PDF."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Self

from prooflight.errors import ChartError
from prooflight.pages.spots.cxf import read_cxf, read_spot_ink, spot_names

if TYPE_CHECKING:
    from prooflight.pages.pdf.facts import DocumentFacts
    from prooflight.pages.spots.spot_ink import SpotInk


@dataclass(frozen=True, slots=True, kw_only=True)
class JobSpectra:
    """Spectra that a job states of its spot inks, all by the names of these."""

    inks: Mapping[str, SpotInk] = field(default_factory=dict)
    origins: Mapping[str, str] = field(default_factory=dict)
    """Where the spectrum of each ink is from: the file beside the job, or the job."""
    faults: Mapping[str, ChartError] = field(default_factory=dict)
    """Inks whose spectra are stated but cannot be read, and why."""
    solidities: Mapping[str, float] = field(default_factory=dict)
    """Opacities, 0 to 1, of inks without a spectrum (MixingHints of the output intent)."""

    @classmethod
    def of(cls, path: Path, facts: DocumentFacts | None) -> Self:
        """Read the spectra of a job at ``path`` with these facts, which only one that is a single PDF has.

        ``JOB.cxf`` beside ``JOB.pdf`` comes before the PDF's own spectra, as somebody gave it for this print.
        """
        if facts is None:
            return cls()
        texts = {name: ("the job", text) for name, text in facts.spectra.items()}
        inks: dict[str, SpotInk] = {}
        origins, faults = dict[str, str](), dict[str, ChartError]()
        given = path.with_suffix(".cxf")
        if given.is_file():
            try:
                text = read_cxf(given)
                texts |= dict.fromkeys(spot_names(text, str(given)), (given.name, text))
            except ChartError as error:
                faults[""] = error
        for name, (origin, text) in texts.items():
            try:
                inks[name] = read_spot_ink(text, name, file="" if origin == "the job" else str(given))
                origins[name] = origin
            except ChartError as error:
                faults[name] = error
        return cls(inks=inks, origins=origins, faults=faults, solidities=facts.solidities)

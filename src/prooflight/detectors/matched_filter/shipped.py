"""The ranking that is shipped with Prooflight, trained on simulated presses with other cameras than a user's.

Its units are standard deviations of good pages, so that a press only has to measure its own good pages.
`prooflight study ranking` makes the file.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import save

from prooflight.artefact import Tensors
from prooflight.detectors.false_alarm_rate import ReferenceScores
from prooflight.detectors.matched_filter.model import DetectorModel
from prooflight.files.atomic import whole_file
from prooflight.files.schema import part_of

FILE: Final = "ranking.safetensors"
KIND: Final = "prooflight ranking"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ShippedRanking:
    """A model that is not adapted to any press, and its scores of pages that it was not trained on."""

    model: DetectorModel
    references: ReferenceScores
    """Scores of good pages."""
    misprints: NDArray[np.float64]
    """(pages,) scores of misprints, rising, by models adapted to as many pages as `press build` prints."""

    def caught(self, threshold: float) -> float:
        """Return the share of the misprints above a threshold. [-]"""
        return float((self.misprints > threshold).mean())

    def save(self, path: Path) -> None:
        """Write to ``path`` atomically."""
        model = self.model.facts()
        model["threshold"] = None
        arrays = {f"model.{name}": np.ascontiguousarray(a) for name, a in self.model.arrays().items()}
        arrays |= {"reference": self.references.worst, "misprints": self.misprints}
        texts = {"kind": KIND, "document": json.dumps(model, sort_keys=True)}
        arrays["reference_pages"] = self.references.pages
        with whole_file(path) as unfinished:
            unfinished.write_bytes(save(arrays, texts))

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read what ``save`` wrote; it is part of the program, and not checked again."""
        file = Tensors(path)
        arrays, facts = file.arrays(), json.loads(file.texts["document"])
        facts["threshold"] = np.inf
        return cls(
            model=DetectorModel.from_parts(part_of(arrays, "model."), facts),
            references=ReferenceScores(pages=arrays["reference_pages"], worst=arrays["reference"]),
            misprints=arrays["misprints"],
        )


@cache
def shipped_ranking() -> ShippedRanking:
    """Return the ranking of this version."""
    with resources.as_file(resources.files("prooflight.detectors.matched_filter").joinpath(FILE)) as path:
        return ShippedRanking.load(Path(path))

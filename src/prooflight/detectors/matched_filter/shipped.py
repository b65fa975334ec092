"""The ranking that comes with Prooflight: learned once, on simulated presses of other cameras than a user's.

Its units are standard deviations of what good pages do, so that a press only has to say what its own good pages do.
`prooflight study ranking` makes the file.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from safetensors.numpy import save

from prooflight.artefact import Tensors
from prooflight.detectors.false_alarm_rate import ReferenceScores
from prooflight.detectors.matched_filter.model import DetectorModel
from prooflight.files.atomic import whole_file
from prooflight.files.schema import part_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

FILE: Final = "ranking.safetensors"
KIND: Final = "prooflight ranking"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ShippedRanking:
    """A model that no press has adapted yet, and what it said of pages that had not taught it."""

    model: DetectorModel
    references: ReferenceScores
    """Of good pages."""
    misprints: NDArray[np.float64]
    """(pages,) scores of misprints, rising, where as many pages made it fit as `press build` prints."""

    def caught(self, threshold: float) -> float:
        """Share of the misprints above a threshold. [-]"""
        return float((self.misprints > threshold).mean())

    def save(self, path: Path) -> None:
        """Write to ``path``, whole or not at all."""
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
        """Read what ``save`` wrote; it comes with the program, and is not looked at twice."""
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
    """That of this version."""
    with resources.as_file(resources.files("prooflight.detectors.matched_filter").joinpath(FILE)) as path:
        return ShippedRanking.load(Path(path))

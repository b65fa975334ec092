"""Identification of a press's RIP from scans of good pages: growth of each ink, and how surely edges lie."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.cmyk import INKS
from prooflight.commissioning.rip_identification import Identified, identified_from_edges, ink_edges
from prooflight.errors import ScanError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from prooflight.detectors.base import Inspection
    from prooflight.detectors.verdict import Verdict
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

HALF: Final = 4
"""Pixels that are looked at to either side of an edge: the lens blurs it over some two."""
CELL_TILES: Final = 4
"""Side of the cells that have an offset each: 13 mm at 0.1 mm. Paper and planes move a print by parts of a pixel that
vary over some centimetres."""
ALONE: Final = 0.02
"""Largest difference, as a share of paper white, that other inks may make where an ink counts as alone."""


def identified_from_scans(inspected: Iterable[tuple[Page, Inspection]], press: Press) -> Identified:
    """Identify growth and residual of each ink from good pages of a press, as they enter it, and their inspections.

    What a day's dot gain adds to edges is part of the growth, and what its prints scatter by is part of the residual.
    ScanError: none of the scans could be placed.
    """
    expected: list[list[NDArray[np.float32]]] = [[] for _ in range(INKS)]
    seen: list[list[NDArray[np.float32]]] = [[] for _ in range(INKS)]
    alone: list[list[NDArray[np.bool_]]] = [[] for _ in range(INKS)]
    unplaced: list[Verdict] = []
    press_context, white = press.press_context(), press.sensors[0].white_dn
    for page, inspection in inspected:
        if inspection.verdict.shift_mm is None:
            unplaced.append(inspection.verdict)
            continue
        all_inks = inspection.expect().expected_dn[0]
        measured = inspection.measured_dn[0].astype(np.float32)
        for ink in range(INKS):
            if not page.cmyk[..., ink].any():
                continue
            single = np.zeros_like(page.cmyk)
            single[..., ink] = page.cmyk[..., ink]
            prediction = press_context.predict(replace(page, cmyk=single), inspection.placement)
            only = prediction.expected_dn[0][inspection.area]
            expected[ink].append(-all_inks)
            seen[ink].append(-measured)
            alone[ink].append(np.abs(only - all_inks) < ALONE * white)
    if unplaced and not any(expected):
        first = unplaced[0]
        what = "could not be placed" + f": {first.reason}" * bool(first.reason)
        raise ScanError(
            first.page, what, remedy="give scans of good prints of the job, by this press's camera"
        )
    levels = press.sensors[0].mean_dn
    inks = []
    for ink in range(INKS):
        solid = tuple(levels.shape[0] - 1 if other == ink else 0 for other in range(INKS))
        span = float(levels[0, 0, 0, 0] - levels[solid])
        inks.append(
            ink_edges(expected[ink], seen[ink], span=span, half=HALF, alone=alone[ink], cell_tiles=CELL_TILES)
        )
    return identified_from_edges(inks, 1e3 * press.geometry.pixel_pitch_mm)

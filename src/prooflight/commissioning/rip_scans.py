"""Identification of a press's RIP from scans of good pages: growth of each ink, and how surely edges lie."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.cmyk import INKS
from prooflight.commissioning.rip_identification import Identified, identified_from_edges, ink_edges
from prooflight.errors import ScanError
from prooflight.inspection.inspector import Inspector
from prooflight.inspection.job import pair
from prooflight.press.pages import open_job

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.press.artefact import Press

HALF: Final = 4
"""Pixels that are looked at to either side of an edge: the lens blurs it over some two."""
ALONE: Final = 0.02
"""Largest difference, as a share of paper white, that other inks may make where an ink counts as alone."""


def identified_from_scans(
    job: Path, scans: Path, press: Press, *, progress: Callable[[str], None] = lambda _: None
) -> Identified:
    """Identify growth and residual of each ink from good pages; errors as ``pair``; ScanError: no page is placed."""
    inspector = Inspector(press)
    expected: list[list[NDArray[np.float32]]] = [[] for _ in range(INKS)]
    seen: list[list[NDArray[np.float32]]] = [[] for _ in range(INKS)]
    alone: list[list[NDArray[np.bool_]]] = [[] for _ in range(INKS)]
    white = press.sensors[0].white_dn
    with open_job(job, press) as pages:
        for page, scan in pair(pages, scans, partly=True):
            progress(f"measuring edges of {page.name}")
            inspection = inspector.inspect(page, scan)
            if inspection.verdict.kind in ("wrong-page",):
                continue
            station, area = press.station(), inspection.area
            all_inks = inspection.expect().expected_dn[0]
            measured = inspection.measured_dn[0].astype(np.float32)
            for ink in range(INKS):
                if not page.cmyk[..., ink].any():
                    continue
                single = np.zeros_like(page.cmyk)
                single[..., ink] = page.cmyk[..., ink]
                only = station.predict(replace(page, cmyk=single), inspection.placement).expected_dn[0][area]
                expected[ink].append(-all_inks)
                seen[ink].append(-measured)
                alone[ink].append(np.abs(only - all_inks) < ALONE * white)
    if not any(expected):
        raise ScanError(scans, "shows no page of the job in its place", remedy="give scans of good prints")
    levels = press.sensors[0].mean_dn
    solids = np.eye(INKS, dtype=int) * (levels.shape[0] - 1)
    inks = []
    for ink in range(INKS):
        span = float(levels[0, 0, 0, 0] - levels[tuple(solids[ink])])
        inks.append(ink_edges(expected[ink], seen[ink], span=span, half=HALF, alone=alone[ink]))
    return identified_from_edges(inks, 1e3 * press.geometry.pixel_pitch_mm)

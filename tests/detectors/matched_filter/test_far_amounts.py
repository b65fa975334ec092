"""Ink that is far off is stated in full, and by the ink alone that is: on small pages, 36 x 44 mm, raster 0.053 mm."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.detectors.matched_filter.fit.modes import Modes, moved, pixel_map, prepare_modes
from prooflight.detectors.matched_filter.fit.nuisance import (
    FitBlocks,
    NuisanceModel,
    PlacedScan,
    ResidualVariance,
    page_colours,
    summed_blocks,
)
from prooflight.detectors.print_prior import PrintPrior
from prooflight.pages.raster import Page
from prooflight.prediction.predict import predict
from prooflight.scans.placement import IN_PLACE
from prooflight.simulation.scans import ideal_scan

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.press.artefact import Press

DPI = 481.8
CYAN, BLACK = 0, 3


def stems(share: float = 1.0) -> Page:
    """Stems of 0.4 mm, some of cyan, printed in this share, and some of black."""
    rng = np.random.default_rng(3)
    rows, columns, stem = 835, 683, 8
    kinds = rng.choice(3, (rows // stem + 1, columns // stem + 1), p=(0.7, 0.15, 0.15))
    kinds[:4], kinds[-4:], kinds[:, :4], kinds[:, -4:] = 0, 0, 0, 0
    wide = np.kron(kinds, np.ones((stem, stem), np.int64))[:rows, :columns]
    cmyk = np.zeros((rows, columns, 4), np.uint8)
    cmyk[..., CYAN] = np.rint(200 * share * (wide == 1))
    cmyk[..., BLACK] = 230 * (wide == 2)
    return Page(cmyk=cmyk, dpi=DPI, name="stems", number=1)


def scan_of(press: Press, page: Page) -> NDArray[np.uint16]:
    seen = predict(page, sensors=press.sensors, geometry=press.geometry, threads=1)
    return ideal_scan(seen, press, np.random.default_rng(3))


def placed_of(press: Press, page: Page, scan: NDArray[np.uint16]) -> PlacedScan:
    sensors, geometry = press.sensors, press.geometry
    own, where = prepare_modes(page, sensors=sensors, geometry=geometry), pixel_map(page, geometry, IN_PLACE)
    return PlacedScan(
        measured_dn=scan,
        seen=predict(page, sensors=sensors, geometry=geometry, threads=1),
        modes=Modes(images=moved(own.images, where), sensors=len(sensors)),
        where=where,
        sensors=sensors,
        colours=page_colours(own.cover),
    )


@pytest.mark.parametrize(("share", "found"), [(1.0, {}), (0.8, {CYAN: -0.2})])
def test_an_ink_far_off_is_named_with_all_of_its_amount(
    press: Press, share: float, found: dict[int, float]
) -> None:
    page, scan = stems(), scan_of(press, stems(share=share))
    sensors, geometry = press.sensors, press.geometry
    placed = placed_of(press, page, scan)
    blocks = FitBlocks.of(placed.seen_by_all())
    model = NuisanceModel.of(
        blocks,
        summed_blocks(placed, blocks, 1),
        sensors=sensors,
        colours=placed.colours,
        planes=np.zeros((4, 2)),
        pixel_mm=geometry.pixel_pitch_mm,
        prior=PrintPrior(),
        residual_variance=ResidualVariance(),
    )
    assert model.free_gains() == {ink: pytest.approx(gain, abs=0.04) for ink, gain in found.items()}

"""Good prints' own ways are found and taken out; what is wrong stays: on a small page of tints, 36 x 44 mm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.detectors.matched_filter.fit.modes import Modes, moved, pixel_map, prepare_modes
from prooflight.detectors.matched_filter.fit.nuisance import (
    Fit,
    PrintPrior,
    ResidualVariance,
    fit_nuisances,
    page_colours,
)
from prooflight.detectors.matched_filter.fit.residuals import in_register, residual_images
from prooflight.detectors.matched_filter.statistics.boxes import boxes, cells_of
from prooflight.detectors.matched_filter.statistics.local_evidence import (
    MODES,
    SIZES,
    Scatter,
    summed,
    t_statistic,
)
from prooflight.pages.raster import Page
from prooflight.prediction.predict import predict
from prooflight.scans.placement import IN_PLACE, Placement
from prooflight.simulation.scans import ideal_scan

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.statistics.local_evidence import Sums
    from prooflight.press.artefact import Press

DPI = 481.8
CYAN, BLACK = 0, 3


@pytest.fixture(scope="module")
def tints() -> Page:
    """Bars of cyan tints, a field of black, the rest paper."""
    cmyk = np.zeros((835, 683, 4), np.uint8)
    for bar in range(6):
        cmyk[60 + 60 * bar : 110 + 60 * bar, 60:620, CYAN] = 40 * (bar + 1)
    cmyk[500:700, 100:500, BLACK] = 120
    return Page(cmyk=cmyk, dpi=DPI, name="tints", number=1)


def recoloured(page: Page, ink: int, factor: float) -> Page:
    cmyk = page.cmyk.astype(np.float32)
    cmyk[..., ink] *= factor
    return Page(cmyk=np.rint(cmyk).clip(0, 255).astype(np.uint8), dpi=page.dpi, name=page.name, number=1)


@dataclass(frozen=True)
class Judged:
    fit: Fit
    sums: Sums
    left: NDArray[np.float32]
    weight: NDArray[np.float32]
    noise: NDArray[np.float64]


def judged(press: Press, page: Page, scan: NDArray[np.uint16], placement: Placement = IN_PLACE) -> Judged:
    sensors, geometry, pitch = press.sensors, press.geometry, press.geometry.pixel_pitch_mm
    seen = predict(page, sensors=sensors, geometry=geometry, placement=placement, threads=1)
    own = prepare_modes(page, sensors=sensors, geometry=geometry)
    where = pixel_map(page, geometry, placement)
    modes = Modes(images=moved(own.images, where), sensors=len(sensors))
    colours = page_colours(own.cover)
    fit = fit_nuisances(
        scan, seen, modes, where, sensors=sensors, colours=colours, planes=np.zeros((4, 2)), pixel_mm=pitch,
        prior=PrintPrior(), residual_variance=ResidualVariance(),
    )  # fmt: skip
    left, weight, of_edges, noise = residual_images(
        scan, seen, modes, where, fit, sensors=sensors, colours=colours, residual_variance=ResidualVariance()
    )
    raw = left.copy()
    sums = summed(
        left,
        weight,
        of_edges,
        seen,
        modes,
        where,
        sensors=sensors,
        geometry=geometry,
        page_width_mm=page.width_mm,
    )
    return Judged(fit=fit, sums=sums, left=raw, weight=weight, noise=noise)


def scan_of(press: Press, page: Page, *, times: float = 1.0, seed: int = 3) -> NDArray[np.uint16]:
    seen = predict(page, sensors=press.sensors, geometry=press.geometry, threads=1)
    seen.expected_dn[:] *= times
    return ideal_scan(seen, press, np.random.default_rng(seed))


def greatest(sums: Sums, name: str, size: int = 8) -> float:
    """|T| of a mode, boxes of one size."""
    mode, place = MODES.index(name), SIZES.index(size)
    own, power, edges = boxes(list(cells_of(sums))[place])
    t = t_statistic(own[mode], power[mode], edges[mode], Scatter.white().boxes[mode, place])
    return float(np.abs(t).max())


def test_modes_are_derivatives_of_the_prediction(press: Press, tints: Page) -> None:
    def seen(factor: float) -> NDArray[np.float32]:
        page = recoloured(tints, CYAN, factor)
        return predict(page, sensors=press.sensors, geometry=press.geometry, threads=1).expected_dn[0]

    modes = prepare_modes(tints, sensors=press.sensors, geometry=press.geometry)
    difference = (seen(1.05) - seen(0.95)) / 0.1
    light = difference / np.maximum(press.sensors[0].column_gain, 1e-3)
    inked = modes.cover[CYAN] > 0.1
    # 2 % of white: slopes are linear between nodes 16 bytes apart. All bytes are multiples of 40 and stay whole.
    assert np.abs(light - modes.gain[0, CYAN])[inked].max() < 0.02 * press.sensors[0].white_dn
    assert not modes.gain[0, BLACK][modes.cover[BLACK] == 0].any()


def test_a_good_scan_leaves_noise(press: Press, tints: Page) -> None:
    found = judged(press, tints, scan_of(press, tints))
    inside = found.weight[0] > 0
    z = (found.left * np.sqrt(found.weight))[0][inside]
    assert (
        0.4 < z.std() < 1.05
    )  # the stated variance holds texture and tolerances that this scan does not have
    assert found.noise[0] == pytest.approx(1, abs=0.15)
    assert np.abs(found.fit.gain[:, 0]).max() < 0.02
    assert greatest(found.sums, "add-K") < 6


def test_light_and_ink_gain_are_found_and_taken_out(press: Press, tints: Page) -> None:
    printed = recoloured(tints, CYAN, 1.03)
    found = judged(press, tints, scan_of(press, printed, times=0.99))
    assert found.fit.white[0] == pytest.approx(-0.01, abs=0.004)
    assert found.fit.gain[CYAN, 0] == pytest.approx(0.03, abs=0.01)
    assert np.abs(found.left[0][found.weight[0] > 0].mean()) < 2


def test_too_much_ink_stays_as_evidence(press: Press, tints: Page) -> None:
    found = judged(press, tints, scan_of(press, recoloured(tints, CYAN, 0.8)))
    assert found.fit.gain[CYAN, 0] < -0.1
    assert np.abs(found.fit.pulls).max() > 5


def test_a_spot_is_seen_where_it_lies(press: Press, tints: Page) -> None:
    printed = Page(cmyk=tints.cmyk.copy(), dpi=DPI, name="spot", number=1)
    printed.cmyk[740:760, 300:320, BLACK] = 100
    found = judged(press, tints, scan_of(press, printed))
    cells = next(cells_of(found.sums))
    own, power, edges = boxes(cells)
    t = t_statistic(own[4], power[4], edges[4], np.array([1.0, 1.0, 0.0]))
    row, column = np.unravel_index(int(np.argmax(t)), t.shape)
    x, y, _, _ = cells.box_mm(found.sums, int(row), int(column))
    assert t.max() > 20
    assert (x, y) == pytest.approx((310 * 25.4 / DPI, 750 * 25.4 / DPI), abs=1.5)


def test_planes_go_back_by_whole_raster_pixels_and_no_further_than_good_ones(tints: Page) -> None:
    planes = np.zeros((4, 2))
    planes[CYAN] = 0.06, -1.0
    page, left = in_register(tints, planes, good_mm=0.114)
    pixel = tints.pixel_mm
    assert left[CYAN] == pytest.approx((0.06 - pixel, -1.0 + 4 * pixel))
    assert np.array_equal(page.cmyk[:-4, 1:, CYAN], tints.cmyk[4:, :-1, CYAN])
    assert np.array_equal(page.cmyk[..., BLACK], tints.cmyk[..., BLACK])
    same, _ = in_register(tints, np.zeros((4, 2)), good_mm=0.114)
    assert same is tints

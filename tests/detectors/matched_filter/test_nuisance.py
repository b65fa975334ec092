"""Good prints' own ways are found and taken out; what is wrong stays: on a small page of tints, 36 x 44 mm."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from prooflight.detectors.matched_filter.analysis import with_added
from prooflight.detectors.matched_filter.fit.modes import (
    AddedInks,
    Modes,
    PixelMap,
    moved,
    pixel_map,
    prepare_modes,
)
from prooflight.detectors.matched_filter.fit.nuisance import (
    COLOUR_LENGTH,
    COLOURS,
    FOLLOWED,
    Fit,
    FitBlocks,
    NuisanceModel,
    PlacedScan,
    ResidualVariance,
    page_colours,
    summed_blocks,
)
from prooflight.detectors.matched_filter.fit.residuals import in_register, residual_images
from prooflight.detectors.matched_filter.statistics.boxes import boxes, cells_of
from prooflight.detectors.matched_filter.statistics.local_evidence import (
    MODES,
    SIZES,
    Scatter,
    assumed_light,
    summed,
    t_statistic,
)
from prooflight.detectors.print_prior import PrintPrior
from prooflight.pages.raster import Page
from prooflight.prediction.predict import Prediction, predict
from prooflight.prediction.printed import PrintedPage
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


def nuisance_fit(placed: PlacedScan, **of: Any) -> Fit:
    blocks = FitBlocks.of(placed.seen_by_all())
    sums = summed_blocks(placed, blocks, 1)
    return NuisanceModel.of(blocks, sums, sensors=placed.sensors, colours=placed.colours, **of).fit()


@dataclass(frozen=True)
class Judged:
    fit: Fit
    sums: Sums
    left: NDArray[np.float32]
    weight: NDArray[np.float32]
    noise: NDArray[np.float64]


def judged(
    press: Press,
    page: Page,
    scan: NDArray[np.uint16],
    placement: Placement = IN_PLACE,
    *,
    planes: NDArray[np.float64] | None = None,
) -> Judged:
    sensors, geometry, pitch = press.sensors, press.geometry, press.geometry.pixel_pitch_mm
    planes = np.zeros((4, 2)) if planes is None else planes
    own = prepare_modes(page, sensors=sensors, geometry=geometry)
    where = pixel_map(page, geometry, placement)
    placed = PlacedScan(
        measured_dn=scan,
        seen=predict(page, sensors=sensors, geometry=geometry, placement=placement, threads=1),
        modes=Modes(images=moved(own.images, where), sensors=len(sensors)),
        where=where,
        sensors=sensors,
        colours=page_colours(own.cover),
    )
    placed = with_added(placed, AddedInks(page, sensors=sensors, geometry=geometry, bins=1))
    fit = nuisance_fit(
        placed, planes=planes, pixel_mm=pitch, prior=PrintPrior(), residual_variance=ResidualVariance()
    )
    light = placed.light()
    left, weight, of_edges, noise = residual_images(placed, fit, light, residual_variance=ResidualVariance())
    raw = left.copy()
    sums = summed(
        placed,
        light,
        left,
        weight,
        of_edges,
        geometry=geometry,
        page_width_mm=page.width_mm,
        prior=PrintPrior(),
    )
    return Judged(fit=fit, sums=sums, left=raw, weight=weight, noise=noise)


def scan_of(press: Press, page: Page, *, times: float = 1.0, seed: int = 3) -> NDArray[np.uint16]:
    seen = predict(page, sensors=press.sensors, geometry=press.geometry, threads=1)
    seen.expected_dn[:] *= times
    return ideal_scan(seen, press, np.random.default_rng(seed))


def greatest(sums: Sums, name: str, size: int = 8) -> float:
    """|T| of a mode, boxes of one size."""
    mode, place = MODES.index(name), SIZES.index(size)
    own, power, edges = boxes(list(cells_of(sums, assumed_light(PrintPrior())))[place])
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
    cells = next(cells_of(found.sums, assumed_light(PrintPrior())))
    own, power, edges = boxes(cells)
    t = t_statistic(own[4], power[4], edges[4], np.array([1.0, 1.0, 0.0]))
    row, column = np.unravel_index(int(np.argmax(t)), t.shape)
    x, y, _, _ = cells.box_mm(found.sums, int(row), int(column))
    assert t.max() > 20
    assert (x, y) == pytest.approx((310 * 25.4 / DPI, 750 * 25.4 / DPI), abs=1.5)


def _cover(recipes: NDArray[np.floating]) -> NDArray[np.float32]:
    """A patch of each recipe (n, 4), of as many pixels each, beside bare paper."""
    every = np.concatenate([np.zeros((1, 4)), recipes]).astype(np.float32)
    return np.repeat(np.repeat(every.T[:, None], 8, axis=1), 8, axis=2)


def test_what_colours_do_not_follow_is_the_variance_that_remains_of_a_gaussian_process() -> None:
    """Its conditional variance, solved for outright; to the single precision that centres are kept in."""
    recipes = np.rint(np.random.default_rng(5).random((60, 4)) * 16) / 16
    found = page_colours(_cover(recipes))
    assert len(found.centres) == COLOURS

    def kernel(some: NDArray[np.floating], other: NDArray[np.floating]) -> NDArray[np.float64]:
        return np.exp(-((some[:, None] - other) ** 2).sum(axis=2) / COLOUR_LENGTH**2)

    across = kernel(recipes, found.centres)
    left = 1 - (across * np.linalg.solve(kernel(found.centres, found.centres), across.T).T).sum(axis=1)
    assert found.unfollowed == pytest.approx(np.sqrt(left.mean()), rel=1e-4)
    assert found.widening == pytest.approx(found.unfollowed / FOLLOWED)
    assert found.widening > 1


def test_a_page_of_few_colours_is_followed_and_judged_as_others() -> None:
    few = page_colours(_cover(np.random.default_rng(5).random((COLOURS // 2, 4))))
    assert few.unfollowed < FOLLOWED
    assert few.widening == 1
    assert page_colours(np.zeros((4, 8, 8), np.float32)).unfollowed == 0


def test_planes_go_back_by_whole_raster_pixels_and_no_further_than_good_ones(tints: Page) -> None:
    planes = np.zeros((4, 2))
    planes[CYAN] = 0.06, -1.0
    printed, left = in_register(tints, planes, good_mm=0.114)
    assert isinstance(printed, PrintedPage)
    page = printed.composed()
    pixel = tints.pixel_mm
    assert left[CYAN] == pytest.approx((0.06 - pixel, -1.0 + 4 * pixel))
    assert np.array_equal(page.cmyk[:-4, 1:, CYAN], tints.cmyk[4:, :-1, CYAN])
    assert np.array_equal(page.cmyk[..., BLACK], tints.cmyk[..., BLACK])
    same, _ = in_register(tints, np.zeros((4, 2)), good_mm=0.114)
    assert same is tints


def test_edges_that_lie_off_besides_add_to_their_variance_but_where_good_prints_are_exact() -> None:
    known = ResidualVariance(edge=0.0009)
    assert known.with_edges_off(0.04).edge == pytest.approx(0.0025)
    assert known.with_edges_off(0.0) == known
    assert ResidualVariance.none().with_edges_off(0.04).exact


# --- one amount, in closed form ---

WHITE = 0.01
LIGHT_DN = 1000.0
OFF_DN = 2.0
BLOCKS, BLOCK_PIXELS = 4, 64


def fit_of_light(
    press: Press,
    *,
    variance_dn2: float = 0.0,
    step_dn: float = 0.0,
    texture_dn2: float = 0.0,
    residual_variance: ResidualVariance,
) -> Fit:
    """Paper that is a little too light, and good prints that differ in nothing but light, by 1 %.

    step_dn: it goes so far up and down across, with a period of four pixels: half its square is its squared slope.
    """
    sensor = replace(press.sensors[0], column_offset_dn=np.zeros(32, np.float32))
    shape = (1, 32, 32)
    waves = np.array([0, 1, 0, -1], np.float32) * np.float32(step_dn)
    seen = Prediction(
        expected_dn=np.broadcast_to(np.float32(LIGHT_DN) + np.tile(waves, 8), shape).astype(np.float32),
        variance_dn2=np.full(shape, variance_dn2, np.float32),
    )
    modes = Modes(images=np.zeros((2 * 4 + 1 + 4, 32, 32), np.float32), sensors=1)
    modes.texture[:] = texture_dn2
    inside = np.zeros(shape[1:], bool)
    inside[8:24, 8:24] = True
    nodes = np.zeros((2, 2), np.float32)
    none = dict.fromkeys(("common", "lamp", "shape", "gain", "tilt", "dot"), 0.0)
    placed = PlacedScan(
        measured_dn=seen.expected_dn + np.float32(OFF_DN),
        seen=seen,
        modes=modes,
        where=PixelMap(across=nodes, along=nodes, inside=inside),
        sensors=[sensor],
        colours=page_colours(modes.cover),
    )
    return nuisance_fit(
        placed,
        planes=np.zeros((4, 2)),
        pixel_mm=0.1,
        prior=replace(PrintPrior(), white=WHITE, **none),
        residual_variance=residual_variance,
    )


@pytest.mark.parametrize(
    ("variance_dn2", "given"),
    [
        (80.0, {"variance_dn2": 80.0 * BLOCK_PIXELS}),
        (
            80.0,
            {
                "texture_dn2": 40.0 * BLOCK_PIXELS,
                "residual_variance": ResidualVariance(edge=0, contrast=2, share=0, dark=0),
            },
        ),
        (0.05**2 * 200**2 / 2, {"step_dn": 200.0}),
        (
            0.05**2 * 200**2 / 2 + 4 * 0.1 * 200**2 / 2 / BLOCK_PIXELS,
            {"step_dn": 200.0, "residual_variance": ResidualVariance(edge=0.1, contrast=0, share=0, dark=0)},
        ),
        (9.0**2, {"residual_variance": ResidualVariance(edge=0, contrast=0, share=9.0 / LIGHT_DN, dark=0)}),
    ],
    ids=["noise", "halftone", "edges of all blocks", "edges of each block", "light"],
)
def test_blocks_count_for_a_fifth_each_beside_what_good_prints_do(
    press: Press, variance_dn2: float, given: dict[str, Any]
) -> None:
    """The mean of a normal amount, of which each block says so much that is so unsure: the rest is the prior's."""
    fit = fit_of_light(press, **{"residual_variance": ResidualVariance.none()} | given)
    told = 0.2 * BLOCKS * (LIGHT_DN * WHITE) ** 2 / variance_dn2  # 0.5 to 2 times what is known before
    assert 0.4 < told < 2.5
    assert fit.white[0] == pytest.approx(OFF_DN / LIGHT_DN * told / (1 + told), rel=2e-3)
    scatter = np.sqrt(told / (1 + told))  # of such an estimate on good prints, in the prior's
    assert fit.pulls[0] == pytest.approx(fit.white[0] / WHITE / scatter, rel=2e-3)
    assert fit.lost == 0


def test_planes_are_taken_to_lie_within_a_quarter_of_their_tolerance_of_where_they_were_found(
    press: Press, tints: Page
) -> None:
    """An ink that the page does not have stays where registration says, cyan's bars where they are."""
    found = judged(
        press, tints, scan_of(press, tints), planes=np.array([[0.2, 0.1], [0.3, -0.4], [0, 0], [0, 0]])
    )
    prior_pixels = 0.25 * PrintPrior().plane_mm / press.geometry.pixel_pitch_mm
    assert found.fit.planes[1] == pytest.approx([0.3, -0.4])
    assert found.fit.planes[CYAN] == pytest.approx([0, 0], abs=0.05)
    assert found.fit.planes.ravel() == pytest.approx(found.fit.pulls[-8:] * prior_pixels)

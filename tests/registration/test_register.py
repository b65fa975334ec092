"""Where a page lies: on small pages, 36 x 44 mm under 400 pixels."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numba import njit

from prooflight.kernels.registration.measuring import SUMS, solved
from prooflight.kernels.registration.rendering import render_tile
from prooflight.pages.raster import Page
from prooflight.prediction.predict import predict
from prooflight.registration import landmarks as landmarks_module
from prooflight.registration import register as register_module
from prooflight.registration import search
from prooflight.registration.field import Basis, Waves, fitted
from prooflight.registration.pose import Pose, slopes
from prooflight.registration.register import Prior, prepare, printed_shares, register
from prooflight.registration.tiles import TileMoves, Workspace, measured
from prooflight.scans.placement import IN_PLACE, Placement
from prooflight.simulation.prints import draw_placement
from prooflight.simulation.scans import ideal_scan
from prooflight.simulation.worlds import Amounts

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.press.artefact import Press
    from prooflight.registration.register import Landmarks, Registration

DPI = 481.8
TILE = 32


def landmarks_of(page: Page, press: Press) -> Landmarks:
    prediction = predict(page, sensors=press.sensors, geometry=press.geometry, threads=1)
    return prepare(page, prediction, sensors=press.sensors, geometry=press.geometry)


def scan_of(page: Page, press: Press, placement: Placement, seed: int = 1) -> NDArray[np.uint16]:
    seen = predict(page, sensors=press.sensors, geometry=press.geometry, placement=placement, threads=1)
    return ideal_scan(seen, press, np.random.default_rng(seed))


def error_pixels(found: Registration, truth: Placement, page: Page, press: Press) -> NDArray[np.float64]:
    """(points, 2) how far what is said to be seen lies off what is, on a grid of 2 mm over the page."""
    x, y = np.meshgrid(np.arange(1, page.width_mm, 2.0), np.arange(1, page.height_mm, 2.0))
    size = {"page_width_mm": page.width_mm, "page_height_mm": page.height_mm}
    tile_moves, is_ = found.placement.seen_mm(x, y, **size), truth.seen_mm(x, y, **size)
    off = np.stack([a - b for a, b in zip(tile_moves, is_, strict=True)], axis=-1).reshape(-1, 2)
    return off / [press.geometry.pixel_pitch_mm, press.geometry.line_pitch_mm]


def painted(page: Page, change: Callable[[NDArray[np.uint8]], None]) -> Page:
    cmyk = page.cmyk.copy()
    change(cmyk)
    return replace(page, cmyk=cmyk)


@pytest.fixture(scope="module")
def landmarks(page: Page, press: Press) -> Landmarks:
    return landmarks_of(page, press)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_good_print_is_found_to_a_tenth_of_a_pixel(
    page: Page, press: Press, landmarks: Landmarks, seed: int
) -> None:
    truth = draw_placement(Amounts.stated().page, page, np.random.default_rng(seed))
    found = register(landmarks, scan_of(page, press, truth))
    off = error_pixels(found, truth, page, press)
    assert found.located
    assert not found.off_place
    # The goal of the press world's local field is 0.12 rms; noise alone leaves far less on a page full of edges.
    assert np.sqrt(np.mean(off**2)) < 0.1
    assert np.abs(off).max() < 0.5
    assert found.residual_rms_pixels < 0.1


@pytest.mark.parametrize(
    "truth",
    [
        Placement(shift_mm=(2.9, -1.5)),
        Placement(shift_mm=(-2.0, 8.0)),
        Placement(shift_mm=(0.3, -0.2), skew_deg=0.6),
        Placement(skew_deg=-1.0),
        Placement(shift_mm=(0.1, 0.2), stretch_percent=(0.1, -0.1)),
    ],
)
def test_a_page_far_off_its_place_is_found_there(
    page: Page, press: Press, landmarks: Landmarks, truth: Placement
) -> None:
    found = register(landmarks, scan_of(page, press, truth))
    assert found.located
    assert found.off_place == (max(map(abs, truth.shift_mm)) >= 1.8 or abs(truth.skew_deg) >= 0.3)
    # A page a degree off is rendered upright in tiles of 32 pixels, 0.3 pixels off at their corners.
    assert np.abs(error_pixels(found, truth, page, press)).max() < 0.5


def test_a_page_is_found_though_refining_its_coarse_place_led_astray(
    page: Page, press: Press, landmarks: Landmarks, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on a real page of dense type, whose strokes beat with coarse pixels."""
    truth = Placement(shift_mm=(-0.37, 0.39), skew_deg=-0.05)
    scan = scan_of(page, press, truth)

    def astray(_page: object, _scan: object, start: Pose, **_: object) -> Pose:
        return start.moved(np.array([-0.8, 0.1, 0, 0, 0]))

    monkeypatch.setattr(search, "refined", astray)
    found = register(landmarks, scan)
    assert found.located
    assert np.sqrt(np.mean(error_pixels(found, truth, page, press) ** 2)) < 0.1  # as a good print's


def test_a_missing_plane_or_block_leaves_the_page_where_it_is(
    page: Page, press: Press, landmarks: Landmarks
) -> None:
    truth = Placement(shift_mm=(0.4, -0.6), skew_deg=0.08)

    def without_black(cmyk: NDArray[np.uint8]) -> None:
        cmyk[..., 3] = 0

    def without_block(cmyk: NDArray[np.uint8]) -> None:
        cmyk[200:600, 100:500] = 0

    for spoil in (without_black, without_block):
        found = register(landmarks, scan_of(painted(page, spoil), press, truth))
        off = error_pixels(found, truth, page, press)
        assert found.located
        assert np.sqrt(np.mean(off**2)) < 0.24  # twice the goal for a whole page
        assert found.tiles_matching < 0.95


def test_planes_off_register_are_told_from_the_sheet(press: Press, page: Page, landmarks: Landmarks) -> None:
    """All ink moved by 2 raster pixels, one camera pixel, on a sheet in its place."""

    def all_ink_right(cmyk: NDArray[np.uint8]) -> None:
        cmyk[:, 2:] = cmyk[:, :-2].copy()

    found = register(landmarks, scan_of(painted(page, all_ink_right), press, IN_PLACE))
    pixel_mm = press.geometry.pixel_pitch_mm
    # Not the shift alone: on so small a page the warp may take a part of it.
    off = error_pixels(found, Placement(shift_mm=(pixel_mm, 0.0)), page, press)
    assert np.abs(off.mean(axis=0)).max() < 0.15
    assert found.sheet_mm[0] / pixel_mm == pytest.approx(-1, abs=0.15)


def test_threads_share_tiles_out_and_change_nothing(press: Press, page: Page, landmarks: Landmarks) -> None:
    scan = scan_of(page, press, Placement(shift_mm=(0.3, -0.2), skew_deg=0.05))
    one, other = register(landmarks, scan), register(landmarks, scan, threads=3)
    assert one.placement.shift_mm == other.placement.shift_mm
    assert one.tiles_used == other.tiles_used
    assert one.placement.warp is not None
    assert other.placement.warp is not None
    assert (one.placement.warp.nodes_mm == other.placement.warp.nodes_mm).all()


def test_a_blank_page_has_its_edges(press: Press, page: Page) -> None:
    blank = replace(page, cmyk=np.zeros_like(page.cmyk))
    truth = Placement(shift_mm=(0.5, 0.7), skew_deg=-0.05)
    found = register(landmarks_of(blank, press), scan_of(blank, press, truth))
    assert found.located
    assert np.abs(error_pixels(found, truth, page, press)).max() < 0.5


def test_nothing_in_view_is_not_found(press: Press, page: Page, landmarks: Landmarks) -> None:
    """No page at all: bare backing, with noise."""
    scan = scan_of(page, press, Placement(shift_mm=(0.0, 500.0)))
    found = register(landmarks, scan)
    assert not found.located
    assert found.reason
    assert not found.off_place


def test_another_page_is_not_taken_for_this_one(
    press: Press, page: Page, landmarks: Landmarks, make_page: Callable[..., Page]
) -> None:
    """Its sheet may be found, by its edges, or nothing; never a wrong place with confidence."""
    for seed in range(20, 26):
        truth = Placement(shift_mm=(0.5, -0.4))
        found = register(landmarks, scan_of(make_page(seed), press, truth))
        assert found.tiles_foreign > 0.2
        if found.located:
            off = np.array(found.placement.shift_mm) + found.sheet_mm - truth.shift_mm
            assert np.abs(off).max() < 0.1
    rng = np.random.default_rng(3)
    noise = rng.integers(0, 4000, (1, 456, 400), dtype=np.uint16)
    assert not register(landmarks, noise).located


def test_a_page_that_repeats_itself_without_an_edge_in_view_is_ambiguous(press: Press) -> None:
    """Stripes over the whole field, page edges out of view: one period, 2.5 mm, is as good as another across."""
    columns = round(60 * DPI / 25.4)
    cmyk = np.zeros((700, columns, 4), np.uint8)
    cmyk[:, np.arange(columns) % 48 < 24, 3] = 255
    stripes = Page(cmyk=cmyk, dpi=DPI, name="p0001", number=1)
    found = register(landmarks_of(stripes, press), scan_of(stripes, press, Placement(shift_mm=(0.3, 0.1))))
    assert not found.located


def test_two_sensors_know_more_than_one(two_sensor_press: Press, page: Page) -> None:
    truth = Placement(shift_mm=(0.33, -0.21), skew_deg=0.05)
    both = register(landmarks_of(page, two_sensor_press), scan_of(page, two_sensor_press, truth))
    assert both.located
    assert np.abs(error_pixels(both, truth, page, two_sensor_press)).max() < 0.3


def test_the_stated_uncertainty_covers_the_error(press: Press, page: Page, landmarks: Landmarks) -> None:
    """Centre's error over stated sd, 12 placements: within 4 sd each, alpha 1e-3 over all of them."""
    for seed in range(12):
        truth = draw_placement(Amounts.stated().page, page, np.random.default_rng([9, seed]))
        found = register(landmarks, scan_of(page, press, truth, seed=seed))
        mean = error_pixels(found, truth, page, press).mean(axis=0) * press.geometry.pixel_pitch_mm
        assert (np.abs(mean) < 4 * np.array(found.shift_sd_mm)).all()


def test_pose_is_placement_the_other_way_round() -> None:
    """A page point displaced by the pose is seen, by ``Placement``, where it came from."""
    pose = Pose(x_mm=0.7, y_mm=-0.3, turn=np.deg2rad(0.7), across=4e-4, along=-3e-4)
    rng = np.random.default_rng(0)
    points = rng.uniform(0, 200, (50, 2))
    from_centre = points - 100
    moves = np.stack(pose.displacement_mm(*from_centre.T), axis=1)
    placement = Placement(
        shift_mm=(pose.x_mm, pose.y_mm), skew_deg=0.7, stretch_percent=(100 * pose.across, 100 * pose.along)
    )
    seen = placement.seen_mm(*(points + moves).T, page_width_mm=200, page_height_mm=200)
    assert np.stack(seen, axis=1) == pytest.approx(points, abs=1e-9)
    step = np.array([1e-4, 2e-4, 1e-6, 1e-6, -1e-6])
    change = np.stack(Pose().moved(step).displacement_mm(*from_centre.T))
    assert np.einsum("anj,j->an", slopes(*from_centre.T), step) == pytest.approx(change, abs=1e-9)


def test_waves_have_the_covariance_they_stand_for() -> None:
    """exp(-(d / l)^2), on the page, to what the waves left out hold."""
    waves = Waves.over(60.0, 90.0, 25.0, 1e-4)
    x, y = np.array([-30.0, 0.0, 12.0, 30.0, 30.0]), np.array([-45.0, 0.0, 5.0, 45.0, 20.0])
    at = waves.at(x, y)
    distance2 = (x[:, None] - x) ** 2 + (y[:, None] - y) ** 2
    # The rectangle's mirror images, two lengths off, and the waves left out leave some per cent at the corners.
    assert (at * waves.variance) @ at.T == pytest.approx(np.exp(-distance2 / 25.0**2), abs=0.05)


def test_a_tile_in_its_place_says_so(press: Press, page: Page, landmarks: Landmarks) -> None:
    """Rendered tiles are the prediction: measured in place they say 0, half a pixel off half a pixel."""
    tiles = np.arange(landmarks.lines.size)
    scan = scan_of(page, press, Placement(shift_mm=(0.5 * press.geometry.pixel_pitch_mm, 0.0)))
    for guess in (0.0, 0.5):
        tile_moves = measured(
            landmarks, scan, tiles, np.tile([guess, 0.0], (tiles.size, 1)), unsure_pixels=0.3
        )
        sd = np.sqrt(np.linalg.inv(tile_moves.precision[tile_moves.good])[:, [0, 1], [0, 1]])
        move = tile_moves.moves[tile_moves.good]
        sharp = sd < 0.1
        # One step of half a pixel is right to about a tenth (linear in the displacement); none is right to noise.
        tolerance = 0.15 if guess == 0 else 0.03
        assert np.median(move[sharp[:, 0], 0]) == pytest.approx(0.5 - guess, abs=tolerance)
        assert np.median(move[sharp[:, 1], 1]) == pytest.approx(0, abs=tolerance)


@pytest.mark.parametrize(("ratio", "off"), [(2.0, (0.0, 0.0)), (1.9, (0.4, -0.3)), (0.7, (-0.2, 0.1))])
def test_tiles_are_rendered_as_numpy_does_it(press: Press, ratio: float, off: tuple[float, float]) -> None:
    pixel_mm = press.geometry.pixel_pitch_mm / ratio
    taps = landmarks_module._sensor_taps(press.sensors[0], np.array([ratio] * 2), pixel_mm, np.full(2, 0.1))
    count = taps.across.shape[1]
    rng = np.random.default_rng(3)
    width = -(-(int(34 * ratio) + count + 3) // 16) * 16
    window = rng.normal(size=(width, width)).astype(np.float32)
    out = np.empty((3, TILE, TILE), np.float32)
    x, y = 1.3 + off[0], 1.6 + off[1]
    rendered = njit(lambda *arguments: render_tile(*arguments))
    rendered(window, x, y, taps, Workspace.of(width, size=TILE), out)

    def weights(begin: float, table: NDArray[np.float32]) -> NDArray[np.float64]:
        matrix = np.zeros((TILE, width))
        for pixel in range(TILE):
            first, share = divmod(begin + pixel * ratio, 1)
            matrix[pixel, int(first) : int(first) + count] = table[int(share * len(table))]
        return matrix

    across, by_x, along, by_y = (
        weights(begin, table) for begin, table in zip((x, x, y, y), taps[:4], strict=True)
    )
    np.testing.assert_allclose(out[0], along @ window @ across.T, atol=1e-4)
    np.testing.assert_allclose(out[1], along @ window @ by_x.T, atol=1e-4)
    np.testing.assert_allclose(out[2], by_y @ window @ across.T, atol=1e-4)


def test_sums_are_solved_for_what_made_them() -> None:
    rng = np.random.default_rng(1)
    truth = np.array([3.0, 0.1, 0.4, -0.2])
    model = rng.normal(0, 1, (200, 4)) * [1, 20, 5, 5]
    model[:, 0] = 1
    error = model @ truth
    normal, asked = model.T @ model, model.T @ error
    sums = np.zeros(SUMS + 1)
    sums[:10], sums[10:14] = normal[np.triu_indices(4)], asked
    assert njit(lambda given: solved(given))(sums) == pytest.approx(truth, rel=1e-2)


def test_a_fit_is_the_most_likely_one_written_out() -> None:
    """Compiled normal equations, from sums of cosines, beside the dense ones: the same solution and uncertainty."""
    rng = np.random.default_rng(4)
    points = rng.uniform(-1, 1, (30, 2)) * [30, 45]
    basis = Basis.of(points, 60.0, 90.0, Prior())
    shares = rng.dirichlet(np.ones(5), (30, 2))[..., :4]
    root = rng.normal(0, 20, (30, 2, 2))
    precision, moves = root @ root.transpose(0, 2, 1), rng.normal(0, 0.05, (30, 2))
    found = fitted(basis, np.arange(30), moves, precision, shares, weight=np.ones(30))
    count = basis.waves.variance.size
    rows = np.zeros((30, 2, 13 + 2 * count))
    rows[..., :5] = basis.fixed.transpose(1, 0, 2)
    for axis in range(2):
        rows[:, axis, 5 + axis : 13 : 2] = shares[:, axis]
        rows[:, axis, 13 + axis * count : 13 + (axis + 1) * count] = basis.at
    normal = np.einsum("tak,tab,tbl->kl", rows, precision, rows) + np.diag(1 / basis.scale**2)
    expected = np.linalg.solve(normal, np.einsum("tak,tab,tb->k", rows, precision, moves))
    assert found.solution / basis.scale == pytest.approx(expected / basis.scale, abs=1e-6)
    covariance = np.linalg.inv(normal)
    sd = np.sqrt(np.einsum("tak,kl,tal->ta", rows[:5], covariance, rows[:5]))
    assert found.sd_mm(np.arange(5), shares[:5]) == pytest.approx(sd, rel=1e-6)
    assert found.left_mm == pytest.approx(moves - rows @ expected, abs=1e-7)
    other = rng.normal(0, 0.05, (30, 2))
    how: dict[str, Any] = {"weight": rng.uniform(0.1, 1, 30), "pose": Pose(x_mm=0.1, turn=1e-3)}
    fresh = fitted(basis, np.arange(30), other, precision, shares, **how)
    before = fitted(basis, np.arange(30), moves, precision, shares, **how)
    again = fitted(basis, np.arange(30), other, precision, shares, **how, root=before.root)
    assert again.solution == pytest.approx(fresh.solution, abs=1e-12)
    others = rng.dirichlet(np.ones(5), (30, 2))[..., :4]
    fresh = fitted(basis, np.arange(30), other, precision, others, **how)
    again = fitted(basis, np.arange(30), other, precision, others, **how, waves_root=before.root)
    assert again.solution == pytest.approx(fresh.solution, abs=1e-12)


def unmoved(gain: np.ndarray) -> TileMoves:
    """Tiles in their places, all seen, with so much of their contrast each (tiles,)."""
    yes = np.ones(gain.size, bool)
    return TileMoves(
        moves=np.zeros((gain.size, 2)),
        precision=np.zeros((gain.size, 2, 2)),
        seen=yes,
        good=yes,
        foreign=~yes,
        gain=gain,
        gain_sd=np.full(gain.size, 0.01),
    )


def test_a_plane_without_contrast_does_not_count() -> None:
    """Black missing: tiles of black alone are empty, those half black have half their contrast."""
    shares = np.zeros((400, 2, 4))
    shares[:100, :, 3], shares[100:200, :, 0], shares[200:300, :, [0, 3]] = 1, 1, 0.5
    gain = np.repeat([0.0, 1.0, 0.5, 1.0], 100)
    tile_moves = unmoved(gain)
    kept = printed_shares(shares, tile_moves)
    assert (kept[..., 3] == 0).all()
    assert kept[100:300, :, 0] == pytest.approx(1)
    assert (kept[300:] == 0).all()
    assert printed_shares(shares, replace(tile_moves, gain=np.ones(400))) == pytest.approx(shares)


def test_prior_is_the_press_worlds() -> None:
    amounts = Amounts.stated()
    prior = Prior()
    assert prior.warp_across_um == amounts.page.warp_across_um
    assert prior.warp_along_um == amounts.page.warp_along_um
    assert prior.plane_um == amounts.register.plane_um


def test_tiles_that_show_something_else_do_not_stand_for_a_plane() -> None:
    """Black missing: a quarter of its tiles has four times the contrast, of something else; their mean is 1."""
    shares = np.zeros((400, 2, 4))
    shares[..., 3] = 1
    gain = np.repeat([0.0, 4.0], [300, 100])
    tile_moves = unmoved(gain)
    assert gain.mean() == 1
    assert (printed_shares(shares, tile_moves) == 0).all()
    assert printed_shares(shares, replace(tile_moves, gain=1 - gain / 4)) == pytest.approx(shares)


def test_planes_are_told_apart_by_their_shares_of_tiles() -> None:
    """Black missing where no tile has one ink alone: what is left of each is cyan's share."""
    shares = np.zeros((200, 2, 4))
    shares[:100, :, [0, 3]], shares[100:, :, [0, 3]] = (0.2, 0.8), (0.8, 0.2)
    tile_moves = unmoved(shares[:, 0, 0])
    kept = printed_shares(shares, tile_moves)
    assert kept[..., 0] == pytest.approx(1)
    assert (kept[..., 3] == 0).all()


def test_tiles_that_seem_to_lie_beyond_a_step_do_not_stretch_the_page(
    page: Page, press: Press, landmarks: Landmarks, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As those on a strip of bare paper beside a dark page, which look like the design some pixels away."""
    truth = Placement(shift_mm=(0.2, -0.1))
    at_left = landmarks.basis.points_mm[:, 0] < landmarks.basis.points_mm[:, 0].min() + 2

    def with_strip(
        known: Landmarks, scan: object, tiles: NDArray[np.intp], *args: object, **how: object
    ) -> object:
        found = measured(known, scan, tiles, *args, **how)  # type: ignore[arg-type]
        return replace(found, moves=found.moves + np.where(at_left[tiles], 4.0, 0.0)[:, None] * [1.0, 0.0])

    monkeypatch.setattr(register_module, "measured", with_strip)
    found = register(landmarks, scan_of(page, press, truth))
    assert at_left.sum() > 3
    assert found.located
    assert np.abs(found.placement.stretch_percent).max() < 0.03
    assert np.sqrt(np.mean(error_pixels(found, truth, page, press) ** 2)) < 0.1


def test_what_no_tile_tells_is_as_it_is_on_good_prints_wherever_the_search_ended() -> None:
    """Tiles that tell how far down they lie, and nothing else, of a page that is sought 2 mm aside and stretched."""
    points = np.random.default_rng(5).uniform(-1, 1, (40, 2)) * [30, 45]
    basis, pose = Basis.of(points, 60.0, 90.0, Prior()), Pose(x_mm=2.0, y_mm=0.5, across=4e-3)
    down = np.broadcast_to(np.diag([0.0, 1e4]), (40, 2, 2))
    found = fitted(basis, np.arange(40), np.zeros((40, 2)), down, np.zeros((40, 2, 4)), pose=pose)
    there = pose.moved(found.step)
    assert there.x_mm == pytest.approx(0, abs=1e-6)
    assert there.across == pytest.approx(0, abs=1e-6)
    assert there.y_mm == pytest.approx(0.5, abs=0.05)
    across_sd, down_sd = np.sqrt(np.mean(found.sd_mm(np.arange(40), np.zeros((40, 2, 4))) ** 2, axis=0))
    assert across_sd > 1.0  # a shift's whole prior, and the warp's
    assert down_sd < 0.01


@pytest.mark.parametrize(("sd_mm", "off"), [(0.02, True), (0.2, False)])
def test_a_page_lies_off_its_place_only_for_sure(sd_mm: float, off: bool) -> None:
    found = register_module.Registration(
        placement=Placement(shift_mm=(2.0, 0.0)),
        located=True,
        planes_mm=np.zeros((4, 2)),
        plane_parts=np.zeros((2, 4)),
        shift_sd_mm=(sd_mm, 0.02),
        skew_sd_deg=0.01,
    )
    assert found.off_place == off


@pytest.mark.parametrize("seed", range(221, 229))
def test_a_page_of_nearly_no_ink_lies_where_its_edges_say(page: Page, press: Press, seed: int) -> None:
    """Four edges of the sheet tell shift and turn; what they leave open stays as good prints are."""
    bare = painted(page, lambda cmyk: cmyk.fill(0))
    truth = draw_placement(Amounts.stated().page, bare, np.random.default_rng(seed))
    found = register(landmarks_of(bare, press), scan_of(bare, press, truth, seed))
    off = error_pixels(found, truth, bare, press)
    assert found.located
    assert np.sqrt(np.mean(off**2)) < 0.5  # a good print's warp, of which edges tell little
    assert np.abs(found.placement.stretch_percent).max() < 3 * Prior().stretch_percent


@pytest.mark.parametrize(
    "truth",
    [
        Placement(skew_deg=0.5, stretch_percent=(0.0, 1.0)),
        pytest.param(
            Placement(shift_mm=(2.5, -1.0), skew_deg=-0.5, stretch_percent=(0.3, -1.0)),
            marks=pytest.mark.xfail(
                reason="found, but 0.86 pixels off at a corner; the cause is not known", strict=True
            ),
        ),
        Placement(skew_deg=3.0),
    ],
)
def test_a_sheet_as_feeders_lay_it_is_found_by_the_wide_search(
    page: Page, press: Press, landmarks: Landmarks, truth: Placement, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So small a page is often found by the usual search, which therefore finds nothing here."""
    nothing = [search.Candidate(pose=Pose(), agreeing=0.0, tiles=0)]
    monkeypatch.setattr(register_module, "candidates", lambda *_args, **_how: nothing)
    found = register(landmarks, scan_of(page, press, truth, seed=411))
    assert found.located, found.reason
    # Tiles are rendered upright: at 3 degrees their corners lie a pixel off.
    assert np.abs(error_pixels(found, truth, page, press)).max() < (0.5 if abs(truth.skew_deg) < 1 else 1.0)


def test_print_that_lies_nowhere_is_unplaced_but_a_sheet_without_print_is_judged(
    page: Page, press: Press, landmarks: Landmarks
) -> None:
    """What is missing must stay a misprint: only print that has to lie somewhere makes a page unplaced."""
    blank = painted(page, lambda cmyk: cmyk.fill(0))
    assert not register(landmarks, scan_of(blank, press, IN_PLACE)).unplaced

    def half(cmyk: NDArray[np.uint8]) -> None:
        cmyk[len(cmyk) // 2 :] = 0

    assert not register(landmarks, scan_of(painted(page, half), press, IN_PLACE)).unplaced
    turned = replace(page, cmyk=np.ascontiguousarray(page.cmyk[::-1, ::-1]))
    assert register(landmarks, scan_of(turned, press, IN_PLACE)).foreign


@pytest.mark.parametrize(
    ("change", "unplaced"),
    [
        ({}, True),
        ({"located": True, "reason": ""}, False),
        ({"foreign": True}, False),
        ({"reason": register_module.TOO_LITTLE}, False),
        ({"reason": register_module.IN_PARTS}, False),
        ({"print_seen": 0.2}, False),
    ],
)
def test_only_print_without_a_place_is_unplaced(change: dict[str, object], unplaced: bool) -> None:
    none = np.zeros((4, 2))
    where = register_module.Registration(
        placement=IN_PLACE, located=False, reason="in no one place", planes_mm=none, plane_parts=none.T
    )
    assert replace(where, **change).unplaced is unplaced

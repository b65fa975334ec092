"""Maps of block means drawn by hand, one for each thing that a misprint can look like."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from prooflight.detectors.paper.finding import FLAGGED, MOST_REGIONS, UNKNOWN, BlockGrid, Findings, findings

ROWS, COLUMNS = 120, 90
BLOCK_MM = 0.8


def noise(sensors: int = 1) -> np.ndarray:
    return np.random.default_rng(1).standard_normal((sensors, ROWS, COLUMNS)).astype(np.float32)


def no_ink() -> np.ndarray:
    return np.zeros((ROWS, COLUMNS, 4), np.float32)


def found(
    z: np.ndarray,
    ink: np.ndarray | None = None,
    tiles: np.ndarray | None = None,
    *,
    block_mm: float = BLOCK_MM,
) -> Findings:
    return findings(
        BlockGrid(
            z=z,
            tiles=np.ones((ROWS // 8, COLUMNS // 8)) if tiles is None else tiles,
            blocks_per_tile=8,
            ink=lambda: no_ink() if ink is None else ink,
            left_mm=0.1,
            top_mm=0.2,
            width_mm=block_mm,
            height_mm=block_mm,
        )
    )


@pytest.mark.parametrize(
    "place",
    [
        (0, 0),
        (3, 7),
        pytest.param(
            (14, 10),
        ),
    ],
)
def test_what_no_block_shows_lies_in_the_tile_with_the_most_evidence(place: tuple[int, int]) -> None:
    tiles = np.random.default_rng(1).chisquare(31, (ROWS // 8, COLUMNS // 8))
    tiles[place] = 200
    result = found(noise(), tiles=tiles)
    assert result.kind == UNKNOWN
    (region,) = result.regions
    assert region.kind == UNKNOWN
    assert region.y_mm == pytest.approx(0.2 + place[0] * 8 * BLOCK_MM)
    assert region.x_mm == pytest.approx(0.1 + place[1] * 8 * BLOCK_MM)
    # the last tile of a row takes what is left over: blocks 80 to 89 here
    columns = COLUMNS - place[1] * 8 if place[1] == COLUMNS // 8 - 1 else 8
    assert region.width_mm == pytest.approx(columns * BLOCK_MM)
    assert region.height_mm == pytest.approx(8 * BLOCK_MM)


def test_a_tile_whose_means_are_all_0_has_its_place() -> None:
    """The evidence of a tile is its histogram, which may be off where no mean is."""
    tiles = np.ones((ROWS // 8, COLUMNS // 8))
    tiles[3, 7] = 200
    (region,) = found(np.zeros((1, ROWS, COLUMNS), np.float32), tiles=tiles).regions
    assert (region.x_mm, region.y_mm) == pytest.approx((0.1 + 7 * 8 * BLOCK_MM, 0.2 + 3 * 8 * BLOCK_MM))
    assert (region.width_mm, region.height_mm) == pytest.approx((8 * BLOCK_MM, 8 * BLOCK_MM))
    assert region.score == 0


def test_a_missing_block_is_boxed_in_millimetres() -> None:
    z = noise()
    z[0, 30:50, 10:25] += 40  # lighter
    result = found(z)
    assert result.kind == "missing-content"
    (region,) = result.regions
    assert region.kind == "missing-content"
    assert region.x_mm == pytest.approx(0.1 + 10 * BLOCK_MM)
    assert region.y_mm == pytest.approx(0.2 + 30 * BLOCK_MM)
    assert region.width_mm == pytest.approx(15 * BLOCK_MM)
    assert region.height_mm == pytest.approx(20 * BLOCK_MM)
    assert region.score == pytest.approx(np.abs(z).max(), abs=0.06)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("height", [ROWS, 40])
def test_a_narrow_long_line_is_a_streak_lighter_or_darker(sign: int, height: int) -> None:
    z = noise()
    z[0, :height, 60:62] += 20 * sign
    result = found(z)
    assert result.kind == "streak"
    (region,) = result.regions
    assert region.x_mm == pytest.approx(0.1 + 60 * BLOCK_MM)
    assert region.width_mm == pytest.approx(2 * BLOCK_MM)
    assert region.height_mm == pytest.approx(height * BLOCK_MM)


@pytest.mark.parametrize("ink_lost", range(4))
def test_lighter_just_where_one_ink_was_to_be_is_that_plane_missing(ink_lost: int) -> None:
    rng = np.random.default_rng(2)
    ink = no_ink()
    for plane in range(4):  # every ink stands in other places
        for _ in range(12):
            row, column = rng.integers(0, ROWS - 12), rng.integers(0, COLUMNS - 12)
            ink[row : row + 10, column : column + 10, plane] = 0.5
    z = noise()
    z[0][ink[:, :, ink_lost] > 0] += 30
    result = found(z, ink)
    assert result.kind == "missing-plane"
    (region,) = result.regions  # one cause, one box
    inked = np.argwhere(ink[:, :, ink_lost] > 0)
    top, left = inked.min(axis=0)
    bottom, right = inked.max(axis=0) + 1
    assert region.y_mm == pytest.approx(0.2 + top * BLOCK_MM, abs=0.01)
    assert region.x_mm == pytest.approx(0.1 + left * BLOCK_MM, abs=0.01)
    assert region.height_mm == pytest.approx((bottom - top) * BLOCK_MM, abs=0.01)
    assert region.width_mm == pytest.approx((right - left) * BLOCK_MM, abs=0.01)


def test_lighter_here_and_darker_there_is_another_page() -> None:
    z = noise()
    rng = np.random.default_rng(3)
    z[0] += np.where(rng.random((ROWS, COLUMNS)) < 0.5, 25, -25) * (rng.random((ROWS, COLUMNS)) < 0.6)
    result = found(z)
    assert result.kind == "wrong-page"
    (region,) = result.regions
    assert region.width_mm == pytest.approx(COLUMNS * BLOCK_MM, abs=2 * BLOCK_MM)
    assert region.height_mm == pytest.approx(ROWS * BLOCK_MM, abs=2 * BLOCK_MM)


def test_two_places_far_apart_are_two_regions_the_more_telling_first() -> None:
    z = noise()
    z[0, 5:15, 5:15] += 12
    z[0, 80:110, 50:80] += 60
    result = found(z)
    assert len(result.regions) == 2
    assert result.regions[0].y_mm == pytest.approx(0.2 + 80 * BLOCK_MM)
    assert result.regions[1].y_mm == pytest.approx(0.2 + 5 * BLOCK_MM)
    assert result.regions[0].score > result.regions[1].score


def test_places_near_each_other_are_one_region() -> None:
    z = noise()
    z[0, 20:30, 20:30] += 30
    z[0, 20:30, 34:44] += 30  # four blocks between them
    (region,) = found(z).regions
    assert region.width_mm == pytest.approx(24 * BLOCK_MM)


def test_regions_touching_the_border_stay_inside_the_page() -> None:
    z = noise()
    z[0, :6, :9] += 30
    (region,) = found(z).regions
    assert region.x_mm == pytest.approx(0.1)
    assert region.y_mm == pytest.approx(0.2)
    assert region.width_mm == pytest.approx(9 * BLOCK_MM)
    assert region.height_mm == pytest.approx(6 * BLOCK_MM)


def test_there_are_never_more_regions_than_a_person_reads() -> None:
    z = noise()
    z[0, 4::20, 4::20] += 30
    assert (np.abs(z) > FLAGGED).sum() > MOST_REGIONS
    result = found(z)
    assert len(result.regions) == MOST_REGIONS
    assert result.kind == result.regions[0].kind


def test_the_sensor_that_sees_more_decides() -> None:
    z = noise(sensors=2)
    z[1, 30:50, 10:25] += 40
    (region,) = found(z).regions
    assert region.height_mm == pytest.approx(20 * BLOCK_MM)


def test_the_map_is_not_changed() -> None:
    z = noise()
    z[0, 30:50, 10:25] += 40
    kept = z.copy()
    found(z)
    np.testing.assert_array_equal(z, kept)


# --- limits: maps without noise, in blocks of half a millimetre ---

HALF_MM = 0.5


def drawn(place: tuple[slice, slice], value: float = 30.0) -> np.ndarray:
    z = np.zeros((1, ROWS, COLUMNS), np.float32)
    z[0][place] = value
    return z


def test_a_good_page_has_a_flagged_block_in_ten_thousand() -> None:
    """Blocks of 8 pixels of 0.106 mm on A4, two-sided."""
    blocks = 210 * 297 / (8 * 0.106) ** 2
    assert 0.5e-4 < 2 * stats.norm.sf(FLAGGED) * blocks < 2e-4
    everywhere = (slice(None), slice(None))
    assert found(drawn(everywhere, 6.0)).kind == UNKNOWN
    assert found(drawn(everywhere, -6.01)).kind == "wrong-page"


@pytest.mark.parametrize(("columns", "rows", "streak"), [(10, 41, True), (10, 40, False), (11, 100, False)])
def test_a_streak_is_at_most_5_mm_wide_and_more_than_four_times_as_long(
    columns: int, rows: int, streak: bool
) -> None:
    result = found(drawn((slice(0, rows), slice(20, 20 + columns))), block_mm=HALF_MM)
    assert (result.kind == "streak") is streak


@pytest.mark.parametrize(("darker", "kind"), [(20, "missing-content"), (21, "wrong-page")])
def test_one_block_in_fifty_may_be_darker_where_content_is_missing(darker: int, kind: str) -> None:
    z = drawn((slice(30, 50), slice(20, 70)))  # 1000 blocks
    z[0, 40, 20 : 20 + darker] = -30
    assert found(z, block_mm=HALF_MM).kind == kind


@pytest.mark.parametrize(("seen", "kind"), [(700, "missing-content"), (701, "missing-plane")])
def test_a_plane_is_missing_where_more_than_seven_tenths_of_it_are(seen: int, kind: str) -> None:
    ink = no_ink()
    ink[30:50, 20:70, 1] = 0.5  # 1000 blocks
    z = drawn((slice(30, 50), slice(20, 70)))
    z[0, 31:37, 20:70] = 0
    z[0, 31, 20 : 20 + seen - 700] = 30
    assert found(z, ink, block_mm=HALF_MM).kind == kind


@pytest.mark.parametrize(("elsewhere", "kind"), [(120, "missing-content"), (119, "missing-plane")])
def test_a_plane_is_missing_where_little_is_lighter_without_it(elsewhere: int, kind: str) -> None:
    ink = no_ink()
    z = drawn((slice(30, 50), slice(20, 70)))  # 1000 blocks
    ink[30:50, 20:70, 2] = 0.5
    ink[31:33, 20:70, 2] = ink[33, 20 : 20 + elsewhere - 100, 2] = 0
    assert found(z, ink, block_mm=HALF_MM).kind == kind


@pytest.mark.parametrize(("area", "kind"), [(0.01, "missing-content"), (0.02, "missing-plane")])
def test_a_block_holds_an_ink_from_a_hundredth_on(area: float, kind: str) -> None:
    ink = no_ink()
    ink[30:50, 20:70, 0] = area
    assert found(drawn((slice(30, 50), slice(20, 70))), ink, block_mm=HALF_MM).kind == kind


@pytest.mark.parametrize(("blocks_between", "regions"), [(6, 1), (7, 2)])
def test_places_less_than_seven_blocks_apart_are_one(blocks_between: int, regions: int) -> None:
    z = drawn((slice(20, 40), slice(10, 30)))
    z[0, 20:40, 30 + blocks_between : 50] = 30
    assert len(found(z, block_mm=HALF_MM).regions) == regions

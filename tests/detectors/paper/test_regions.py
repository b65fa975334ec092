"""Maps of block means drawn by hand, one for each thing that a misprint can look like."""

from __future__ import annotations

import numpy as np
import pytest

from prooflight.detectors.paper.regions import FLAGGED, MOST_REGIONS, UNKNOWN, BlockGrid, Findings, findings

ROWS, COLUMNS = 120, 90
BLOCK_MM = 0.8


def noise(sensors: int = 1) -> np.ndarray:
    return np.random.default_rng(1).standard_normal((sensors, ROWS, COLUMNS)).astype(np.float32)


def no_ink() -> np.ndarray:
    return np.zeros((ROWS, COLUMNS, 4), np.float32)


def found(z: np.ndarray, ink: np.ndarray | None = None, tiles: np.ndarray | None = None) -> Findings:
    return findings(
        BlockGrid(
            z=z,
            tiles=np.ones((ROWS // 8, COLUMNS // 8)) if tiles is None else tiles,
            blocks_per_tile=8,
            ink=lambda: no_ink() if ink is None else ink,
            left_mm=0.1,
            top_mm=0.2,
            width_mm=BLOCK_MM,
            height_mm=BLOCK_MM,
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

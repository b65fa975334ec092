"""Scans against a golden one: placing, tolerance at edges, levels, regions. Seeds fixed."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.detectors.golden.detector import LEAST_VOLUME, marks
from prooflight.detectors.golden.differences import Tolerance, compare, in_contrasts, level_difference
from prooflight.detectors.golden.place import GoldenPlace, place, residual_pixels

LINES, PIXELS = 320, 384
SOFT = 0.8


def board(seed: int = 1) -> np.ndarray:
    """Tracks and rings, 0 dark and 1 light."""
    rng = np.random.default_rng(seed)
    sheet = np.full((LINES, PIXELS), 1.0, np.float32)
    for _ in range(40):
        x, y = (int(rng.integers(0, extent)) for extent in (PIXELS, LINES))
        width, height = (int(rng.integers(8, 90)), 9) if rng.random() < 0.5 else (9, int(rng.integers(8, 90)))
        cv2.rectangle(sheet, (x, y), (x + width, y + height), 0.0, -1)
    for at in range(6):
        cv2.circle(sheet, (40 + 50 * at, 40 + 50 * at), 14, 0.3, 3)
    return sheet


def seen(
    sheet: np.ndarray, *, matrix: np.ndarray | None = None, noise: float = 0.0, seed: int = 2
) -> np.ndarray:
    """A scan (1, lines, pixels) of a sheet that lies as ``matrix`` (2, 3) has it."""
    if matrix is not None:
        sheet = cv2.warpAffine(sheet, matrix, (PIXELS, LINES), flags=cv2.INTER_CUBIC, borderValue=1.0)
    soft = cv2.GaussianBlur(sheet, (0, 0), SOFT)
    return (soft + noise * np.random.default_rng(seed).standard_normal(sheet.shape)).astype(np.float32)[None]


def shifted(x: float, y: float, *, turn_deg: float = 0.0) -> np.ndarray:
    matrix = cv2.getRotationMatrix2D((PIXELS / 2, LINES / 2), turn_deg, 1.0)
    matrix[:, 2] += (x, y)
    return matrix


# --- where it lies ---


@pytest.mark.parametrize(("x", "y"), [(0.4, -0.3), (-11.2, 9.9)])
def test_a_shift_is_found_to_a_tenth_of_a_pixel(x: float, y: float) -> None:
    golden, scan = seen(board()), seen(board(), matrix=shifted(x, y))
    found = place(golden[0], scan[0])
    assert found.located
    inner = found.nodes[
        :, 2:-2, 2:-2
    ]  # the page's border, which moves in or out, has tiles with half an edge
    assert np.abs(inner[0] - x).max() < 0.1
    assert np.abs(inner[1] - y).max() < 0.1


@pytest.mark.parametrize(("x", "y"), [(0.3, 0.3), (-0.2, 0.2)])
def test_the_residual_is_how_far_print_lies_off_the_place_that_is_followed(x: float, y: float) -> None:
    golden, scan = seen(board())[0], seen(board(), matrix=shifted(x, y))[0]
    flat = GoldenPlace(nodes=np.zeros((2, 10, 12), np.float32), tile_pixels=32, likeness=1.0)
    # One linear step at edges as sharp as a pixel reads some 25 % too much, and never less.
    assert abs(x) < residual_pixels(golden, scan, flat) < 1.3 * abs(x)
    assert residual_pixels(golden, scan, place(golden, scan)) < 0.03


def test_a_turned_page_is_followed() -> None:
    golden, scan = seen(board()), seen(board(), matrix=shifted(3.0, 2.0, turn_deg=0.3))
    where = place(golden[0], scan[0])
    moved = where.moved(golden[0])
    known = np.isfinite(moved)
    # 0.3 degrees move the ends by 1 pixel; cubic interpolation of edges blurred by 0.8 pixels errs by 0.01
    assert np.abs(moved - scan[0])[known].mean() < 0.005
    assert known[20:-20, 20:-20].all()


def test_another_page_is_not_found() -> None:
    assert not place(seen(board(1))[0], seen(board(9))[0]).located


def test_bare_paper_has_no_place() -> None:
    assert not place(np.ones((LINES, PIXELS), np.float32), seen(board())[0]).located


def test_in_place_moves_nothing() -> None:
    sheet = board()
    inner = (slice(4, -4), slice(4, -4))
    np.testing.assert_array_equal(GoldenPlace.same(sheet.shape).moved(sheet)[inner], sheet[inner])


# --- what differs ---


@pytest.mark.parametrize("noise", [0.0, 0.03])
def test_a_good_scan_has_no_regions(noise: float) -> None:
    golden = seen(board(), noise=noise, seed=3)
    scan = seen(board(), matrix=shifted(2.3, -1.6), noise=noise, seed=4)
    assert marks(compare(golden, scan)) == ()


def test_widths_may_vary_within_the_tolerance() -> None:
    wider = cv2.erode(board(), np.ones((3, 3), np.uint8))  # dark grows by a pixel on every side
    assert marks(compare(seen(board()), seen(wider))) == ()
    assert marks(compare(seen(board()), seen(wider), tolerance=Tolerance(edge_pixels=0.0))) != ()


def with_defect(sheet: np.ndarray, box: tuple[int, int, int, int], value: float) -> np.ndarray:
    left, top, right, bottom = box
    changed = sheet.copy()
    changed[top:bottom, left:right] = value
    return changed


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (3.4, -2.7)])
def test_a_speck_is_found_where_it_lies(x: float, y: float) -> None:
    sheet = np.ones((LINES, PIXELS), np.float32)
    sheet[:, :160] = board()[:, :160]
    scan = seen(with_defect(sheet, (300, 200, 306, 205), 0.0), matrix=shifted(x, y), noise=0.01)
    (mark,) = marks(compare(seen(sheet, noise=0.01, seed=7), scan))
    assert not mark.lighter
    assert mark.left == pytest.approx(300 + x, abs=2)
    assert mark.top == pytest.approx(200 + y, abs=2)
    assert mark.right == pytest.approx(306 + x, abs=2)
    assert mark.bottom == pytest.approx(205 + y, abs=2)
    assert (
        LEAST_VOLUME <= mark.volume <= 30 * 1.2
    )  # blur spreads 30 pixels; the halo below 0.4 does not count


def test_a_thin_line_that_is_missing_is_seen() -> None:
    # Two pixels wide: all of it lies within the golden's range of lightness, but not within the scan's.
    sheet = board()
    line = with_defect(np.ones_like(sheet), (330, 60, 332, 140), 0.0)
    golden, scan = seen(np.minimum(sheet, line)), seen(np.where(line < 1, 1.0, sheet).astype(np.float32))
    found = marks(compare(golden, scan))
    assert any(mark.lighter and mark.left >= 325 and mark.right <= 337 for mark in found)


def test_what_is_missing_is_not_joined_with_what_is_too_much() -> None:
    sheet = np.ones((LINES, PIXELS), np.float32)
    sheet[100:200, 100:200] = 0
    scan = with_defect(with_defect(sheet, (150, 192, 158, 198), 1.0), (150, 203, 158, 209), 0.0)
    found = marks(compare(seen(sheet), seen(scan)))
    assert sorted(mark.lighter for mark in found) == [False, True]


def test_a_faint_large_difference_is_found() -> None:
    sheet = board()
    scan = sheet.copy()
    scan[200:280, 250:350] -= 0.15
    found = marks(compare(seen(sheet, noise=0.02, seed=5), seen(scan, noise=0.02, seed=6)))
    assert found
    assert not found[0].lighter
    assert found[0].left > 230
    assert found[0].top > 180


def test_the_strongest_channel_speaks() -> None:
    golden = np.concatenate([seen(board())] * 3)
    scan = golden.copy()
    scan[1, 200:208, 300:308] += -0.9
    assert len(marks(compare(golden, scan))) == len(marks(compare(golden[1:2], scan[1:2]))) == 1


@given(gain=st.floats(0.01, 500), offset=st.floats(-1000, 1000))
def test_units_do_not_matter(gain: float, offset: float) -> None:
    rng = np.random.default_rng(0)
    image = rng.random((1, 40, 40))
    (plain,), (scaled,) = in_contrasts(image), in_contrasts(offset + gain * image + 1000)
    # a channel's contrast is at least a tenth of its lightest, so that only brighter sheets may differ
    if gain > 0.2 * (offset + 1000 + gain):
        np.testing.assert_allclose(plain, scaled, atol=1e-3)
    assert np.isfinite(scaled).all()


# --- levels ---


def test_lamp_and_tone_are_evened_out() -> None:
    sheet = board()
    across = np.linspace(-1, 1, PIXELS, dtype=np.float32)
    scan = sheet + 0.02 * across + 0.015 * (1 - sheet)
    even = sheet + level_difference(sheet, scan.astype(np.float32), np.zeros_like(sheet))
    assert np.abs(even - scan).mean() < 0.004  # of 0.013 before


def test_no_more_than_a_good_print_does_is_evened_out() -> None:
    sheet = board()
    correction = level_difference(sheet, sheet - np.float32(0.3), np.zeros_like(sheet))
    assert np.abs(correction).max() <= 0.05


# --- out of shape ---


def drawn_in(sheet: np.ndarray, across: np.ndarray, along: np.ndarray) -> np.ndarray:
    """A scan (1, lines, pixels) that shows each place of ``sheet`` so far too far right and down. [pixels]"""
    y, x = np.mgrid[:LINES, :PIXELS].astype(np.float32)
    moved = cv2.remap(
        sheet,
        (x - across).astype(np.float32),
        (y - along).astype(np.float32),
        cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return cv2.GaussianBlur(moved, (0, 0), SOFT)[None]


def tracks(pitch: int = 24) -> np.ndarray:
    """Rings at a pitch all over: edges all ways in every tile."""
    sheet = np.ones((LINES, PIXELS), np.float32)
    for y in range(0, LINES, pitch):
        for x in range(0, PIXELS, pitch):
            cv2.circle(sheet, (x + (y // pitch) % 3, y), 7, 0.0, 3)
    return sheet


@pytest.mark.parametrize("stretch", [0.003, -0.01])
def test_a_stretch_is_found_to_a_tenth_of_a_pixel(stretch: float) -> None:
    y, x = np.mgrid[:LINES, :PIXELS].astype(np.float32)
    across, along = stretch * (x - PIXELS / 2), -stretch * (y - LINES / 2)
    where = place(seen(tracks())[0], drawn_in(tracks(), across, along)[0])
    centres = slice(16, None, 32)
    wanted = np.stack([across[centres, centres], along[centres, centres]])
    # Places of the golden that come to lie at these places: the field is looked up where the scan shows them.
    assert np.abs(where.nodes - wanted)[:, 1:-1, 1:-1].max() < 0.1
    np.testing.assert_allclose(np.diag(where.slopes), [stretch, -stretch], atol=4e-4)


def test_a_smooth_warp_is_followed() -> None:
    y, x = np.mgrid[:LINES, :PIXELS].astype(np.float32)
    across, along = 3 * np.sin(x / 60) * np.cos(y / 60), 3 * np.cos(x / 60 + 1)
    golden, scan = seen(board()), drawn_in(board(), across, along)
    assert marks(compare(golden, scan)) == ()


def test_a_part_that_is_set_off_is_followed() -> None:
    y, x = np.mgrid[:LINES, :PIXELS].astype(np.float32)
    golden, scan = seen(board()), drawn_in(board(), 3.0 * (y > 150), 0 * x)
    found = compare(golden, scan)
    assert marks(found) == ()
    loose = found.place.loose_pixels((LINES, PIXELS))
    assert loose[150].max() >= 1
    assert loose[-1].max() == 0  # only about the line


@pytest.mark.parametrize(("pitch", "shift"), [(12, 8), (16, 14), (24, 17)])
def test_an_array_of_pads_is_not_mistaken_by_a_pitch(pitch: int, shift: int) -> None:
    rng = np.random.default_rng(5)
    sheet = np.ones((LINES + 80, PIXELS + 80), np.float32)
    for y in range(0, LINES + 80, pitch):
        for x in range(0, PIXELS + 80, pitch):
            cv2.circle(sheet, (x, y), pitch // 3, 0.0, -1)
    for _ in range(5):  # what tells one pad from the next
        x, y = (int(rng.integers(60, extent)) for extent in (PIXELS, LINES))
        cv2.rectangle(sheet, (x, y), (x + int(rng.integers(10, 50)), y + int(rng.integers(10, 50))), 1.0, -1)
    golden, scan = (
        np.ascontiguousarray(sheet[40 - off : 40 - off + LINES, 40 - off : 40 - off + PIXELS])
        for off in (0, shift)
    )
    where = place(seen(golden)[0], seen(scan)[0])
    assert np.abs(where.nodes - shift)[:, 2:-2, 2:-2].max() < 0.3
    assert marks(compare(seen(golden), seen(scan))) == ()


def test_light_that_differs_moves_nothing() -> None:
    golden = seen(board())
    assert np.abs(place(golden[0], golden[0] - np.float32(0.1)).nodes).max() < 0.1


def test_edges_off_their_places_do_not_fit_and_missing_ones_are_a_misprint() -> None:
    golden = seen(board())
    off = GoldenPlace(nodes=np.full((2, 1, 1), 3.5, np.float32), tile_pixels=PIXELS, likeness=1.0)
    misplaced = compare(golden, golden, where=off)
    assert misplaced.misfit > 0.8
    assert not misplaced.fits
    bitten = np.ones((LINES, PIXELS), np.float32)
    bitten[100:200, 100:] = 0.0
    large = bitten.copy()
    large[100:107, 150:280] = 1.0  # a mouse bite as wide as an edge may be off its place
    defect = compare(seen(bitten), seen(large))
    assert defect.fits
    assert len(marks(defect)) == 1
    empty = board()
    empty[:, 100:260] = 1.0
    missing = compare(golden, seen(empty))
    assert missing.fits
    assert marks(missing) != ()

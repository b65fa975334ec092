"""Sheets against one golden or several: the strip along the edge, turned scans, thin streaks. Seeds fixed."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from prooflight.detectors.golden.detector import GoldenSheet, marks
from prooflight.detectors.golden.differences import GoldenPlace, Tolerance, compare, mean_and_spread
from prooflight.detectors.golden.place import place
from prooflight.detectors.verdict import Verdict
from prooflight.errors import ScanError
from prooflight.scans.scan import Scan

LINES, PIXELS = 480, 400
PITCH_MM = 0.3
"""A sheet of 120 x 144 mm, whose strip along the edge takes 13 pixels."""
STREAK = Tolerance(streak=(3, 48, 0.1))
BLOT = Tolerance(edge_pixels=2.0, blot=9)
"""Two edges displaced outwards by the tolerance change the mean of its window by 4 / 9."""


def drawn(seed: int = 1) -> np.ndarray:
    """Dark bars and rings on paper (1, lines, pixels), as an 8-bit scanner shows them."""
    rng = np.random.default_rng(seed)
    page = np.full((LINES, PIXELS), 240, np.float32)
    for _ in range(30):
        x, y = int(rng.integers(30, PIXELS - 110)), int(rng.integers(30, LINES - 60))
        cv2.rectangle(page, (x, y), (x + int(rng.integers(8, 70)), y + 9), 20, -1)
    for at in range(4):
        cv2.circle(page, (60 + 70 * at, 90 + 90 * at), 16, 60, 4)
    return cv2.GaussianBlur(page, (0, 0), 0.8)[None]


def noisy(page: np.ndarray, seed: int) -> np.ndarray:
    return (page + 1.5 * np.random.default_rng(seed).standard_normal(page.shape)).astype(np.float32)


def judged(golden: np.ndarray, scan: np.ndarray, **how: object) -> Verdict:
    sheet = GoldenSheet(page="p", golden="golden", light=golden, pitch_mm=(PITCH_MM, PITCH_MM), **how)  # type: ignore[arg-type]
    return sheet.inspect(Scan(dn=scan)).verdict


def with_spot(page: np.ndarray, x: int, y: int, side: int = 8) -> np.ndarray:
    changed = page.copy()
    changed[0, y : y + side, x : x + side] = 30
    return changed


@pytest.mark.parametrize(("x", "judges"), [(PIXELS - 11, False), (PIXELS - 22, True)])
def test_what_lies_along_the_edge_of_the_sheet_is_not_judged(x: int, judges: bool) -> None:
    golden = drawn()
    shadow = golden.copy()
    shadow[0, 100:300, x : x + 3] = 120
    assert judged(golden, shadow).verdict == ("misprint" if judges else "good")
    assert judged(golden, shadow, edge_strip_mm=0.0).verdict == "misprint"


def test_a_part_of_a_sheet_has_no_strip() -> None:
    golden = drawn()
    shadow = golden.copy()
    shadow[0, 100:300, PIXELS - 11 : PIXELS - 8] = 120
    small = GoldenSheet(page="p", golden="golden", light=golden, pitch_mm=(0.02, 0.02))
    assert small.inspect(Scan(dn=shadow)).verdict.verdict == "misprint"


def test_a_turned_scan_is_compared_turned_and_its_places_are_the_pages() -> None:
    golden = drawn()
    good = judged(golden, golden[:, ::-1, ::-1])
    assert (good.verdict, good.regions) == ("good", ())
    assert "turned by 180 degrees" in good.reason
    first = judged(golden, with_spot(golden, 330, 200))
    turned = judged(golden, with_spot(golden, 330, 200)[:, ::-1, ::-1])
    assert turned.verdict == first.verdict == "misprint"
    assert turned.regions == first.regions
    assert first.regions[0].x_mm == pytest.approx(330 * PITCH_MM, abs=1.0)


@pytest.mark.parametrize("turned", [False, True])
def test_another_side_is_another_page_either_way_round(turned: bool) -> None:
    other = drawn(9)
    found = judged(drawn(), other[:, ::-1, ::-1] if turned else other)
    assert (found.verdict, found.kind) == ("misprint", "wrong-page")
    assert "does not show" in found.reason


def test_a_stamp_on_a_page_with_little_print_is_a_place_that_differs() -> None:
    page = np.full((LINES, PIXELS), 240, np.float32)
    for x in range(60, 180, 24):
        cv2.rectangle(page, (x, 90), (x + 12, 102), 20, -1)
    golden, stamped = (cv2.GaussianBlur(page, (0, 0), 0.8)[None] for _ in range(2))
    squares = np.random.default_rng(5).integers(0, 2, (10, 10)).astype(np.float32)
    stamped[0, 240:400, 180:340] = 20 + 220 * cv2.resize(squares, (160, 160), interpolation=cv2.INTER_NEAREST)
    verdict = judged(golden, stamped)
    assert (verdict.verdict, verdict.reason[:7]) == ("misprint", "1 place")
    region = verdict.regions[0]
    assert (region.x_mm, region.y_mm) == pytest.approx((180 * PITCH_MM, 240 * PITCH_MM), abs=2.0)


def test_a_scan_with_opposite_edges_alone_is_not_located() -> None:
    golden = np.full((LINES, PIXELS), 1.0, np.float32)
    golden[:, 200:] = 0.1
    assert not place(golden, 1.1 - golden).located


@pytest.mark.parametrize("along", [True, False])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_streak_of_three_pixels_at_a_quarter_is_found(*, along: bool, sign: int) -> None:
    golden = noisy(np.full((1, LINES, PIXELS), 150, np.float32), 3)
    golden[0, 40:60, 40:360] = 20
    golden[0, 400:420, 40:300] = 240
    scan = noisy(np.full((1, LINES, PIXELS), 150, np.float32), 4)
    scan[0, 40:60, 40:360] = 20
    scan[0, 400:420, 40:300] = 240
    assert marks(compare(golden, scan, tolerance=STREAK)) == ()
    place = (0, slice(120, 320), slice(200, 203)) if along else (0, slice(200, 203), slice(120, 320))
    scan[place] += sign * 0.25 * 220
    found = marks(compare(golden, scan, tolerance=STREAK))
    assert found
    assert found[0].lighter == (sign > 0)
    assert marks(compare(golden, scan)) == ()


def test_a_spot_is_no_streak() -> None:
    golden = drawn()
    scan = with_spot(golden, 330, 200)
    assert marks(compare(golden, scan, tolerance=STREAK)) == marks(compare(golden, scan))


def strokes(width: int = 5) -> np.ndarray:
    """Horizontal strokes of a width around the same centres, (1, lines, pixels)."""
    page = np.full((1, LINES, PIXELS), 240, np.float32)
    for y in range(60, 420, 20):
        page[0, y - width // 2 : y - width // 2 + width, 40:360] = 20
    return page


def bent_by_two_pixels() -> GoldenPlace:
    """Return the place of strokes in a field that bends along them, where edges may lie off by two pixels more."""
    nodes = np.zeros((2, 15, 13), np.float32)
    nodes[0, 6, 6] = 1.2
    return GoldenPlace(nodes=nodes, tile_pixels=32, likeness=1.0)


@pytest.mark.parametrize("lighter", [True, False])
def test_a_void_in_a_thin_stroke_and_a_blot_beside_it_are_found(*, lighter: bool) -> None:
    golden, scan = noisy(strokes(), 5), noisy(strokes(), 6)
    top = 198 if lighter else 208  # in the stroke of lines 198 to 202, or between it and the next
    scan[0, top : top + 5, 200:208] = 240 if lighter else 20
    where = bent_by_two_pixels()
    (mark,) = marks(compare(golden, scan, tolerance=BLOT, where=where))
    assert mark.lighter == lighter
    assert abs(mark.left - 200) <= 2
    assert abs(mark.top - top) <= 2
    if lighter:  # all of it is near an edge
        assert marks(compare(golden, scan, where=where)) == ()


@pytest.mark.parametrize("width", [3, 7])
def test_strokes_that_are_thinner_or_thicker_are_no_blots(width: int) -> None:
    assert marks(compare(noisy(strokes(), 5), noisy(strokes(width), 6), tolerance=BLOT)) == ()


FINE = Tolerance(edge_pixels=1.2, blot=5)


@pytest.mark.parametrize(("width", "bent"), [(2, False), (3, False), (3, True)])
def test_a_void_in_a_stroke_that_is_thinner_than_the_void_is_found(width: int, *, bent: bool) -> None:
    golden, scan = noisy(strokes(width), 5), noisy(strokes(width), 6)
    scan[0, 197:203, 200:206] = 240  # the stroke about line 200, over 0.5 mm of a scan of 300 dpi
    where = bent_by_two_pixels() if bent else GoldenPlace.same(golden.shape)
    (mark,) = marks(compare(golden, scan, tolerance=FINE, where=where))
    assert mark.lighter
    assert (abs(mark.left - 200), abs(mark.right - 206)) <= (2, 2)
    assert mark.top <= 200 < mark.bottom


def test_a_displaced_stroke_a_short_break_and_a_speck_of_the_golden_are_no_voids() -> None:
    golden = noisy(strokes(3), 5)
    golden[0, 30:32, 30:33] = 20
    displaced, broken = noisy(np.roll(strokes(3), 1, axis=1), 6), noisy(strokes(3), 7)
    broken[0, 197:203, 200:202] = 240
    same = GoldenPlace.same(golden.shape)
    for scan in (displaced, broken):
        assert marks(compare(golden, scan, tolerance=FINE, where=same)) == ()


def test_ignored_places_move_with_the_golden_and_alarm_nobody() -> None:
    golden = drawn()
    ignored = np.zeros((LINES, PIXELS), np.bool_)
    ignored[190:220, 320:350] = True
    moved = cv2.warpAffine(
        with_spot(golden, 330, 200)[0], np.array([[1.0, 0, 4], [0, 1, 3]]), (PIXELS, LINES), borderValue=240.0
    )[None]
    assert judged(golden, moved).verdict == "misprint"
    assert judged(golden, moved, ignored=ignored).verdict == "good"
    elsewhere = with_spot(golden, 330, 300)
    assert judged(golden, elsewhere, ignored=ignored).verdict == "misprint"


# --- several goldens ---


def test_one_golden_is_itself_and_has_no_spread() -> None:
    light, spread = mean_and_spread([drawn()], ["a"])
    assert spread is None
    np.testing.assert_array_equal(light, drawn())


def test_mean_and_spread_are_those_of_the_registered_scans() -> None:
    first = drawn()
    shift = np.array([[1.0, 0, 3], [0, 1, -2]])
    second = cv2.warpAffine(noisy(first, 1)[0], shift, (PIXELS, LINES), borderValue=240.0)[None]
    turned = np.ascontiguousarray(noisy(first, 2)[:, ::-1, ::-1])
    light, spread = mean_and_spread([noisy(first, 3), second, turned], ["a", "b", "c"])
    assert spread is not None
    inner = (0, slice(20, -20), slice(20, -20))
    assert np.abs(light - first)[inner].mean() < 1.5
    # of three scans with noise of 1.5 DN, resampled ones with a little less; a further one deviates sqrt(4 / 3) as far
    assert 0.8 < spread[inner].mean() < 1.5 * np.sqrt(4 / 3)


def test_where_goldens_differ_a_scan_may_differ_and_elsewhere_not() -> None:
    goldens = [noisy(drawn(), 1), noisy(with_spot(drawn(), 330, 200), 2)]
    light, spread = mean_and_spread(goldens, ["a", "b"])
    for scan in (drawn(), with_spot(drawn(), 330, 200)):
        assert judged(light, noisy(scan, 5), spread=spread).verdict == "good"
    assert judged(light, with_spot(drawn(), 330, 300), spread=spread).verdict == "misprint"


def test_a_golden_of_another_page_or_size_is_named() -> None:
    with pytest.raises(ScanError, match=r"b\.png: does not show the page that a\.png shows; leave it out"):
        mean_and_spread([drawn(), drawn(9)], ["a.png", "b.png"])
    with pytest.raises(ScanError, match=r"b\.png: has 1 x 400 x 400 channels.* but a\.png has 1 x 480 x 400"):
        mean_and_spread([drawn(), drawn()[:, :400]], ["a.png", "b.png"])

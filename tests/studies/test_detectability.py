"""What would be caught, in closed form: against hand-made sums, and on one real page of a tiny press."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.commissioning.learn import Pages, learn_tolerance
from prooflight.comparing.local_evidence import LINE_MODES, MODES, SEGMENTS, Scatter, Sums
from prooflight.deciding.calibrated import CalibratedDetector
from prooflight.deciding.said import Said
from prooflight.errors import RequestError
from prooflight.pages.files import write_tiff
from prooflight.pages.job import JobSource
from prooflight.studies.detectability import SURE, GoodPage, Reach, _spots, _streaks
from prooflight.studies.detectability_study import (
    run_detectability_study,
    spotted,
    streaked,
    thickened,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.pages.raster import Page
    from prooflight.press import Press

SIZES = (2, 4, 8, 16, 32, 64)
TILE_PIXELS = 25
NAMES = [f"box/{mode}/{size}" for mode in ("add-K+", "light-") for size in SIZES] + ["streak/add-K/2/full"]


def good_page(*, noise: float = 1.0) -> GoodPage:
    """A detector that alarms when any statistic is far above what good pages give, on statistics of 1 to 2."""
    rng = np.random.default_rng(1)
    values = (1 + rng.random((200, len(NAMES)))).astype(np.float32)
    scatter = Scatter.white()
    scatter.boxes[..., :2] = noise**2
    scatter.streaks[..., :2] = noise**2
    pages = Pages(
        values=values,
        portraits=rng.standard_normal((200, 3)),
        design=np.arange(200),
        bad=np.zeros(200, bool),
    )
    tolerance = learn_tolerance(pages, names=NAMES, scatter=scatter, rng=rng, ranked=False)
    simulated = np.sort(tolerance.score(values[:100], pages.portraits[:100]))
    ours = CalibratedDetector.calibrated(
        tolerance, simulated=simulated, false_alarm_rate=0.01, misprint_rate=0.01
    )
    said = [Said(name=name, value=1.5) for name in NAMES]
    return GoodPage(ours=ours, said=said, portrait=np.zeros(3))


def sums(power: float, *, rows: int = 80, columns: int = 60) -> Sums:
    """Of a page on which black tells alike everywhere, and nothing moves all light."""
    tiles = np.zeros((4, len(MODES) + 1, rows, columns), np.float32)
    tiles[1, MODES.index("add-K")] = power
    tiles[1, -1] = TILE_PIXELS
    lines = np.zeros((4, LINE_MODES, SEGMENTS, 300), np.float32)
    lines[1, MODES.index("add-K")] = power
    cover = np.zeros((4, rows, columns), np.float32)
    given = {"tiles": tiles, "columns": lines, "cover": cover}
    given |= {"tile_mm": 0.5, "pixel_mm": 0.1, "left_mm": -2.0, "top_mm": -2.0}
    return Sums(**{field.name: given.get(field.name, lines) for field in fields(Sums)})


def test_the_alarm_lies_where_the_score_crosses_the_threshold() -> None:
    good = good_page()
    raised = good.raised("box", "add-K+", "8")
    at = good.alarms_at(raised)
    assert 2 < at < 1e4

    def score(t: float) -> float:
        changed = {one.name: one.value for one in good.said} | raised(t)
        values = np.array([[changed[name] for name in NAMES]])
        return float(good.ours.tolerance.score(values, good.portrait[None])[0])

    assert score(1.02 * at) > good.ours.threshold >= score(0.97 * at)


def test_a_spot_is_as_large_as_its_information_asks() -> None:
    good = good_page()
    weak = sums(TILE_PIXELS * 0.01)  # 0.1 sigma a pixel for whole ink, far from being cut off
    found = _spots(good, weak)[40, 30]
    # T = A D / sqrt(D) over the box of n tiles: a share f of it is wanted for T, the smallest over all sizes
    area = [
        (good.alarms_at(good.raised("box", "add-K+", str(size))) + SURE)
        / np.sqrt(size**2 * 0.25)
        * (size * 0.5) ** 2
        for size in SIZES
    ]
    possible = [a for a, size in zip(area, SIZES, strict=True) if a <= np.pi / 4 * (size * 0.5) ** 2]
    assert found == pytest.approx(2 * np.sqrt(min(possible) / np.pi), rel=0.02)


def test_what_is_cut_off_at_ten_sigma_gains_nothing_by_more_contrast() -> None:
    good = good_page()
    strong, stronger = (_spots(good, sums(TILE_PIXELS * p**2))[40, 30] for p in (50.0, 500.0))
    assert strong == pytest.approx(stronger, rel=1e-3)


def test_a_streak_is_as_faint_as_its_columns_tell() -> None:
    good = good_page()
    name = ("streak", "add-K", "2", "full")
    found = _streaks(good, sums(400.0))[150]
    wanted = good.alarms_at(good.raised(*name)) + SURE
    assert found == pytest.approx(100 * wanted / np.sqrt(5 * SEGMENTS * 400.0), rel=0.02)  # 0.5 mm: 5 columns
    assert _streaks(good_page(noise=2.0), sums(400.0))[150] == pytest.approx(2 * found, rel=0.02)


def small_reach(**changes: object) -> Reach:
    shape = (88, 72)
    made = Reach(
        spot_mm=np.full(shape, 2.0),
        streak_percent=np.full(360, 10.0),
        density_percent=np.full(shape, 10.0),
        inks_percent={"M": 20.0},
        tile_mm=0.5,
        pixel_mm=0.1,
        left_mm=0.0,
        top_mm=0.0,
    )
    return replace(made, **changes)


def test_defects_are_printed_as_large_as_is_said(make_page: Callable[..., Page]) -> None:
    rng = np.random.default_rng(2)
    blank = make_page(1)
    blank = replace(blank, cmyk=np.zeros_like(blank.cmyk))
    spot, streak = (draw(blank, small_reach(), rng) for draw in (spotted, streaked))
    assert spot is not None
    assert streak is not None
    assert spot.cmyk[..., 3].sum() / 255 * blank.pixel_mm**2 == pytest.approx(np.pi, rel=0.02)
    covered = streak.cmyk[..., 3].sum() / 255 * blank.pixel_mm / blank.cmyk.shape[0]
    assert covered == pytest.approx(0.508 * 0.10, rel=0.08)  # whole raster pixels of 0.053 mm
    full = replace(blank, cmyk=np.full_like(blank.cmyk, 100))
    dense = thickened(full, small_reach(), rng)
    assert dense is not None
    assert abs(float(dense.cmyk[..., 1].mean()) - 100) == pytest.approx(20, abs=0.1)
    nowhere = small_reach(
        spot_mm=np.full((88, 72), np.inf), streak_percent=np.full(360, np.inf), inks_percent={"C": np.inf}
    )
    assert [draw(blank, nowhere, rng) for draw in (spotted, streaked, thickened)] == [None] * 3


def test_the_study_writes_its_page_and_pictures(
    taught_press: Press, press: Press, make_page: Callable[..., Page], tmp_path: Path
) -> None:
    page = make_page(3)
    write_tiff(page, tmp_path / "p0001.tif")
    job = JobSource(path=tmp_path / "p0001.tif", dpi=page.dpi)
    assert taught_press.ours is not None
    # So few designs promise so little that prints of one page may all alarm; the plumbing is seen as well above.
    rarely = replace(taught_press, ours=replace(taught_press.ours, threshold=12.0))
    (found,) = run_detectability_study(job, rarely, tmp_path / "out", trials=1)
    assert set(found.verified) == {"none", "spot", "streak", "density"}
    assert found.verified["none"].of == 1
    text = (tmp_path / "out" / "detectability.md").read_text()
    assert "| p0001 |" in text
    assert (tmp_path / "out" / "detectability-p0001.png").stat().st_size > 10_000
    with pytest.raises(RequestError, match="was not taught our detector"):
        run_detectability_study(job, press, tmp_path / "none")

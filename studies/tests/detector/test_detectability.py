"""What would be caught: strengths against hand-made sums, what it takes by asking, and one page of a tiny press."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import fields, replace
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.cmyk import INK_LETTERS
from prooflight.detectors.matched_filter.entry import model_of
from prooflight.detectors.matched_filter.statistics.local_evidence import (
    LINE_MODES,
    MODES,
    SEGMENTS,
    Scatter,
    Sums,
)
from prooflight.detectors.matched_filter.statistics.statistic import Observed, Statistic
from prooflight.detectors.print_prior import PrintPrior
from prooflight.errors import RequestError
from prooflight.pages.files import write_tiff
from prooflight.pages.job import JobSource
from prooflight.rng import stream
from prooflight_studies.detectability import study
from prooflight_studies.detectability.closed_form import Reach, Strengths
from prooflight_studies.detectability.defects import paled, patched, spotted, streaked
from prooflight_studies.detectability.findings import DEFECTS, job_results
from prooflight_studies.detectability.study import run_detectability_study
from prooflight_studies.harness.page import page_text, plain
from prooflight_studies.harness.psychometric import Psychometric

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

TILE_PIXELS = 25


def scattered(noise: float = 1.0) -> Scatter:
    """Of a press whose good prints scatter by so many sigmas, and by nothing else."""
    scatter = Scatter.white()
    scatter.boxes[..., :2] = noise**2
    scatter.streaks[..., :2] = noise**2
    return scatter


def spot_mm(wanted: float, power: float) -> float:
    """Least diameter in the middle of a page that tells alike everywhere."""
    return float(Reach.of(told(sums(power)), dict.fromkeys(DEFECTS, wanted)).spot_mm[40, 30])


def told(of: Sums, *, noise: float = 1.0) -> Strengths:
    """With an estimate of each ink's gain at a standard deviation of 0.5 of what is assumed."""
    statistics = [Observed(statistic=Statistic("fit", "gain", letter), value=2.0) for letter in INK_LETTERS]
    gain = np.zeros((4, 3))
    gain[:, 0] = PrintPrior().gain
    return Strengths.of(of, SimpleNamespace(gain=gain, prior=PrintPrior()), statistics, scattered(noise))  # type: ignore[arg-type]


def sums(power: float, *, rows: int = 80, columns: int = 60) -> Sums:
    """Of a page on which black tells alike everywhere, and light next to nothing."""
    tiles = np.zeros((4, len(MODES) + 1, rows, columns), np.float32)
    tiles[1, MODES.index("add-K")] = power
    tiles[1, MODES.index("light")] = 1e-6
    tiles[1, -1] = TILE_PIXELS
    lines = np.zeros((4, len(LINE_MODES), SEGMENTS, 300), np.float32)
    lines[1, MODES.index("add-K")] = power
    cover = np.zeros((4, rows, columns), np.float32)
    given = {"tiles": tiles, "columns": lines, "cover": cover, "prior": PrintPrior()}
    given |= {"tile_mm": 0.5, "pixel_mm": 0.1, "left_mm": -2.0, "top_mm": -2.0}
    return Sums(**{field.name: given.get(field.name, lines) for field in fields(Sums)})


def test_a_spot_is_as_large_as_its_information_asks() -> None:
    # 0.1 sigma a pixel for whole ink, far from being cut off: strength 0.1 sqrt(pixels), and a pixel has 0.01 mm^2
    assert spot_mm(12, TILE_PIXELS * 0.01) == pytest.approx(2 * np.sqrt(144.0 / np.pi), rel=1e-3)
    assert spot_mm(60, TILE_PIXELS * 0.01) == np.inf  # 60 mm, no box holds it


def test_what_is_cut_off_at_ten_sigma_gains_nothing_by_more_contrast() -> None:
    strong, stronger = (spot_mm(12, TILE_PIXELS * p**2) for p in (50.0, 500.0))
    assert strong == pytest.approx(stronger, rel=1e-3)
    assert strong == pytest.approx(2 * np.sqrt(1.2**2 * 0.01 / np.pi), rel=1e-3)


def test_a_spot_outgrows_what_hides_it() -> None:
    """In the middle of 4 mm that tell nothing: black already, or edges throughout."""
    for part, value in ((1, 0.0), (3, TILE_PIXELS * 100.0)):
        of = sums(TILE_PIXELS * 100.0)
        of.tiles[part, MODES.index("add-K"), 36:44, 26:34] = value
        reach = Reach.of(told(of), dict.fromkeys(DEFECTS, 30.0))
        assert reach.spot_mm[40, 30] >= 4.0
        assert reach.spot_mm[10, 30] == pytest.approx(2 * np.sqrt(9 * 0.01 / np.pi), rel=1e-3)


def test_a_streak_is_as_faint_as_its_columns_tell() -> None:
    wanted = dict.fromkeys(DEFECTS, 12.0)
    found, noisy = (
        Reach.of(told(sums(400.0), noise=noise), wanted).streak_percent[150] for noise in (1.0, 2.0)
    )
    assert found == pytest.approx(100 * 12 / np.sqrt(5 * SEGMENTS * 400.0), rel=0.02)  # 0.5 mm: 5 columns
    assert noisy == pytest.approx(2 * found, rel=0.02)


def test_an_ink_is_missed_by_as_much_as_good_prints_scatter() -> None:
    reach = Reach.of(told(sums(400.0)), dict.fromkeys(DEFECTS, 4.0))
    # An estimate that surprises by 2 for a gain of one prior's deviation has half of that deviation for its own.
    assert reach.inks_percent["M"] == pytest.approx(100 * 4 * PrintPrior().gain / 0.5)
    assert Reach.of(told(sums(400.0)), dict.fromkeys(DEFECTS, 40.0)).inks_percent["M"] == np.inf


def asked(
    found: Psychometric, page: int, middle: float, prints: int, rng: np.random.Generator
) -> Psychometric:
    """So many prints of a page on which single ones begin to alarm at ``middle``, give or take 30 %."""
    for _ in range(prints):
        strength = found.next(page, rng)
        caught = bool(np.log(strength) + 0.3 * rng.standard_normal() > np.log(middle))
        found = found.seen(page, strength, caught=caught)
    return found


def test_what_it_takes_is_found_by_asking() -> None:
    """Seed 5: 200 prints know the middle to about spread / sqrt(100) = 3 %, and 99 % to twice that; 15 % is allowed."""
    found = asked(Psychometric.unknown(0.01), 1, 20.0, 200, np.random.default_rng(5))
    assert found.prints == 200
    assert found.strength(1, 0.5) == pytest.approx(20, rel=0.15)
    assert found.strength(1, 0.99) == pytest.approx(20 * np.exp(2.33 * 0.3), rel=0.15)


def test_every_page_has_its_own_strength_and_lends_it_to_the_others() -> None:
    """Seed 6: 40 prints of a page know its middle to about 7 %; 25 % is allowed."""
    rng = np.random.default_rng(6)
    middles = {1: 6.0, 2: 9.0, 3: 30.0, 4: 12.0}
    found = Psychometric.unknown(0.01)
    for page, middle in middles.items():
        found = asked(found, page, middle, 40, rng)
    for page, middle in middles.items():
        assert found.strength(page, 0.5) == pytest.approx(middle, rel=0.25)
    assert 6.0 < found.strength(5, 0.5) < 30.0
    assert found.strength(5, 0.99) > 2 * found.strength(2, 0.99)  # nobody asked about page 5
    alone = asked(Psychometric.unknown(0.01), 5, 12.0, 4, np.random.default_rng(7))
    helped = asked(found, 5, 12.0, 4, np.random.default_rng(7))
    assert helped.strength(5, 0.99) < alone.strength(5, 0.99)


def test_what_is_never_caught_is_out_of_reach() -> None:
    found = Psychometric.unknown(0.01)
    for _ in range(30):
        found = found.seen(1, 1000.0, caught=False)
    assert found.strength(1, 0.99) == np.inf
    assert found.next(1, np.random.default_rng(1)) == 1000.0


def small_reach(**changes: object) -> Reach:
    shape = (88, 72)
    made = Reach(
        spot_mm=np.full(shape, 2.0),
        streak_percent=np.full(360, 10.0),
        patch_percent=np.full(shape, 10.0),
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
    pale, patch = (draw(full, small_reach(), rng) for draw in (paled, patched))
    assert pale is not None
    assert patch is not None
    assert float(pale.cmyk[..., 1].mean()) == pytest.approx(80, abs=0.1)
    less = 100.0 - patch.cmyk
    assert less.sum(axis=(0, 1)) * blank.pixel_mm**2 / 10 == pytest.approx(np.full(4, 16.0**2), rel=0.02)
    nowhere = small_reach(
        spot_mm=np.full((88, 72), np.inf),
        streak_percent=np.full(360, np.inf),
        patch_percent=np.full((88, 72), np.nan),
        inks_percent={"C": np.inf},
    )
    assert [draw(blank, nowhere, rng) for draw in (spotted, streaked, patched, paled)] == [None] * 4


def test_the_study_writes_its_page_and_pictures(
    trained_press: Press,
    press: Press,
    make_page: Callable[..., Page],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    page = make_page(3)
    write_tiff(page, tmp_path / "p0001.tif")
    job = JobSource(path=tmp_path / "p0001.tif", dpi=page.dpi)
    assert "matched_filter" in trained_press.detectors
    # So few designs promise so little that prints of one page may all alarm; the plumbing is seen as well above.
    rarely = trained_press.with_detector("matched_filter", replace(model_of(trained_press), threshold=12.0))
    steps, days = [""], defaultdict(set)

    def noted(seed: int, purpose: str, *indices: int) -> np.random.Generator:
        if purpose == "detectability-session":
            days["to learn" in steps[-1] or not steps[-1]].add(indices)
        return stream(seed, purpose, *indices)

    monkeypatch.setattr(study, "stream", noted)
    reach = run_detectability_study(
        job, rarely, tmp_path / "out", learning=2, trials=1, progress=steps.append
    )
    monkeypatch.undo()
    # A good print and two more taught; one of each defect was judged, on a day of its own.
    assert (len(days[True]), len(days[False])) == (3, 1)
    assert not days[True] & days[False]
    (found,) = reach.pages
    assert set(found.verified) == {"none", *DEFECTS}
    assert found.verified["none"].of == 1
    text = (tmp_path / "out" / "detectability.md").read_text()
    assert "| p0001 |" in text
    assert (tmp_path / "out" / "detectability-p0001.png").stat().st_size > 10_000
    with pytest.raises(RequestError, match="was not taught 'matched_filter'"):
        run_detectability_study(job, press, tmp_path / "none")
    always = trained_press.with_detector(
        "matched_filter", replace(model_of(trained_press), threshold=-np.inf)
    )
    with pytest.raises(RequestError, match="p0001: 4 good prints of it alarm"):
        run_detectability_study(job, always, tmp_path / "out", learning=2, trials=1)
    assert (tmp_path / "out" / "detectability.md").read_text() == text
    found_besides = job_results(
        replace(reach, alarming=["p0002"]), rarely, model_of(rarely), trials=1, seed=1
    )
    besides = page_text({"study": "detectability", **plain(found_besides)})
    assert "Not foretold: p0002" in besides

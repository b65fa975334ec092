"""A press taught by simulated prints; tiny, so that only the plumbing is seen: what it catches is a study's matter."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from prooflight.commissioning.training import train
from prooflight.commissioning.training.learn import shift_and_scale
from prooflight.commissioning.training.simulated_days import (
    DESIGNS_A_DAY,
    FOLLOWS,
    LEAST_TIMES,
    PressDay,
    ScatterWork,
    StatisticsWork,
    UnitWork,
    amount_named,
    fitted,
    good_prior,
    good_residual_variance,
)
from prooflight.commissioning.training.train import FEWEST, Plan
from prooflight.detectors.matched_filter.calibrated import FLOOR_SHARE_OF_RATE
from prooflight.detectors.matched_filter.entry import model_of
from prooflight.detectors.matched_filter.fit.modes import PAGE_FEATURES
from prooflight.detectors.matched_filter.fit.nuisance import ResidualVariance
from prooflight.detectors.matched_filter.glyphs.scoring import GLYPH_SHARE
from prooflight.detectors.matched_filter.shipped import shipped_ranking
from prooflight.detectors.matched_filter.statistics.local_evidence import SCATTER_SHAPES
from prooflight.detectors.paper.bayes import window_statistics
from prooflight.detectors.paper.detector import page_evidence
from prooflight.detectors.print_prior import PrintPrior
from prooflight.errors import RequestError
from prooflight.press.artefact import Press
from prooflight.rng import stream
from prooflight.simulation.worlds import Amounts

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from prooflight.pages.raster import Page

SAME = {"lamp_length": 1.0, "speck_share": 1.0, "speck_mm2": 1.0}
"""Amounts of the prior that describe something, not how much it varies."""


@pytest.mark.parametrize(("designs", "pilot"), [(FEWEST, 6), (64, 8), (136, 17), (1000, 40)])
def test_an_eighth_of_the_designs_teaches_scatter_and_no_other_does(designs: int, pilot: int) -> None:
    plan = Plan.of(designs)
    assert [*plan.pilot, *plan.calibrate] == list(range(designs))
    assert len(plan.pilot) == pilot


def test_too_few_designs_are_refused() -> None:
    with pytest.raises(RequestError, match=f"give {FEWEST} or more"):
        Plan.of(FEWEST - 1)


def test_a_taught_press_comes_back_from_its_file(trained_press: Press, tmp_path: Path) -> None:
    path = tmp_path / "taught.press"
    assert trained_press.save(path) == trained_press.digest
    again = Press.load(path)
    assert again.digest == trained_press.digest
    assert "matched_filter" in again.detectors
    assert "matched_filter" in trained_press.detectors
    assert model_of(again).guarantee == model_of(trained_press).guarantee
    assert model_of(again).threshold == model_of(trained_press).threshold
    assert "bayes" not in again.detectors
    assert model_of(again).guarantee.simulated == len(Plan.of(24).calibrate)
    assert model_of(again).guarantee.rate == 0.1
    np.testing.assert_array_equal(model_of(again).pages.values, model_of(trained_press).pages.values)


def test_a_press_is_the_shipped_ranking_made_fit_by_its_own_good_pages(trained_press: Press) -> None:
    matched_filter, shipped = model_of(trained_press), shipped_ranking()
    assert matched_filter is not None
    reference = shipped.references.by(matched_filter.scores.own.worst.size)
    assert matched_filter.scores.reference.worst.tolist() == reference.worst.tolist()
    assert matched_filter.references.worst.tolist() == shipped.references.worst.tolist()
    assert matched_filter.guarantee.reference == reference.worst.size
    for name, array in matched_filter.model.arrays().items():
        same = np.array_equal(array, shipped.model.arrays()[name])
        assert same == (name not in ("shift", "scale") and not name.startswith("scatter."))
    plain = replace(matched_filter.model, shift=shipped.model.shift, scale=shipped.model.scale)
    found = plain.deviations(matched_filter.pages.values, matched_filter.pages.page_features)
    shift, scale = shift_and_scale(found)
    np.testing.assert_allclose(matched_filter.model.shift, shift)
    np.testing.assert_allclose(matched_filter.model.scale, scale)
    of_ranking = (1 - GLYPH_SHARE - FLOOR_SHARE_OF_RATE) * 0.1
    assert matched_filter.threshold == pytest.approx(
        reference.threshold(of_ranking / matched_filter.scores.ratio)[0]
    )


def test_what_ours_catches_is_what_the_shipped_misprints_say(trained_press: Press) -> None:
    matched_filter, shipped = model_of(trained_press), shipped_ranking()
    assert matched_filter is not None
    share = (shipped.misprints > matched_filter.threshold).mean()
    assert f"caught {share:.0%} of {shipped.misprints.size:,} simulated misprints" in matched_filter.trials


def test_only_the_papers_network_is_taught_by_misprints(
    monkeypatch: pytest.MonkeyPatch, press: Press
) -> None:
    """On days that are made up: seed 3. Ours is made fit by the good ones of them."""
    monkeypatch.setattr(train, "in_order", _made_up_days)
    made = {
        paper: train.trained(press, _One(None), designs=48, seed=1, paper=paper)  # type: ignore[arg-type]
        for paper in (False, True)
    }
    for paper, found in made.items():
        assert "matched_filter" in found.detectors
        assert model_of(found).scores.own.worst.size == 42
        assert ("bayes" in found.detectors) == paper
        found.check()
    assert "matched_filter" in made[False].detectors
    assert "matched_filter" in made[True].detectors
    assert (
        made[True].detectors["matched_filter"].threshold == made[False].detectors["matched_filter"].threshold
    )
    assert made[True].detectors["matched_filter"].guarantee.rate == train.DEFAULT_RATE == 0.01
    taught = made[True].detectors["bayes"]
    assert taught is not None
    assert taught.network.types == ("correct", "global", "local")
    assert taught.unit.tolist() == [3.5]  # the pilot's, 1 to 6


def test_a_press_of_either_world_is_calibrated_in_each_as_a_press_of_one(
    monkeypatch: pytest.MonkeyPatch, press: Press
) -> None:
    """On days that are made up: seed 3."""
    monkeypatch.setattr(train, "in_order", _made_up_days)
    either = replace(press, variation={"world": "either"})
    found = train.trained(either, _One(None), designs=48, seed=1)  # type: ignore[arg-type]
    detector = model_of(found)
    assert (len(detector.pages.values), detector.own.worst.size) == (84, 84)
    assert detector.deciding is not None
    assert detector.guarantee.simulated == detector.deciding.worst.size == detector.scores.own.worst.size
    assert abs(detector.deciding.worst.size - 42) <= DESIGNS_A_DAY / 2
    assert set(detector.deciding.worst) <= set(detector.own.worst)
    found.check()


def _made_up_days(
    work: ScatterWork | StatisticsWork | UnitWork,
    days: Sequence[tuple[int, ...]],
    *,
    processes: int | None = None,
    fewest: int,
    pool: object = None,
) -> Iterator[dict[str, Any]]:
    """Good pages are the same whether misprints are asked for or not."""
    count = len(shipped_ranking().model.statistics)
    for designs in days:
        if isinstance(work, ScatterWork):
            yield {
                name: np.full((len(designs), *shape, 1, 3), np.nan) for name, shape in SCATTER_SHAPES.items()
            }
            continue
        if isinstance(work, UnitWork):
            yield {"unit": np.array([[1.0 + design] for design in designs])}
            continue
        wrong = ("streak", "density")[designs[0] // DESIGNS_A_DAY % 2]
        kinds = np.array(["", wrong] if work.misprints else [""], "U16")
        design = np.repeat(designs, kinds.size)
        rng = np.random.default_rng([3, designs[0]])
        values = np.repeat(rng.exponential(size=(len(designs), count)), kinds.size, axis=0)
        kind = np.tile(kinds, len(designs))
        values[kind != ""] *= 5
        found = {
            "design": design,
            "kind": kind,
            "values": values.astype(np.float32),
            "portrait": np.repeat(rng.standard_normal((len(designs), PAGE_FEATURES)), kinds.size, axis=0),
            "another": np.zeros(design.size, bool),
            "glyphs": np.full(design.size, -20.0),
            "names": np.array(["name"] * count),
        }
        if work.unit is not None:
            found["windows"] = rng.standard_normal((design.size, 3))
        yield found


@pytest.mark.parametrize(
    ("variation", "times"),
    [
        ({}, {}),
        ({"all_times": 1.5}, dict.fromkeys(asdict(PrintPrior()), 1.5) | SAME),
        # 3 and 1.5 % of a session and a print instead of 1.2 and 1.5 %.
        ({"ink": {"gain_session_percent": 3.0}}, {"gain": np.hypot(3.0, 1.5) / np.hypot(1.2, 1.5)}),
        ({"all_times": 2.0, "register": {"plane_um": 48.0, "plane_clip_um": 57.0}}, None),
        ({"paper": {"white_percent": 0.0}}, {"common": LEAST_TIMES}),
        ({"paper": {"specks_per_page": 0.0}}, {"speck_share": 0.0}),
        ({"all_times": 0.0}, {}),
    ],
    ids=["as others", "looser", "one amount", "own register", "never", "no specks", "exact"],
)
def test_what_good_prints_are_taken_to_do_follows_the_press(
    press: Press, variation: dict[str, Any], times: dict[str, float] | None
) -> None:
    prior, world = good_prior(replace(press, variation=variation)), PrintPrior()
    if times is None:
        assert (prior.gain, prior.plane_mm, prior.most_plane_mm) == (2 * world.gain, world.plane_mm, 0.057)
        return
    assert asdict(prior) == pytest.approx(
        {name: times.get(name, 1.0) * value for name, value in asdict(world).items()}
    )
    assert (prior == world) == (not times)


def test_an_office_class_press_does_what_the_press_world_does() -> None:
    """No default is a silent copy: each is the amounts of worlds.toml that it follows, times a margin that is named."""
    # white: a table's shape shows at paper too. place: paper and lamp. place_near: about the smooth level.
    margins = {"white": 1.163, "place": 1.5, "place_near": 0.5, "turn_deg": 2.0, "stretch_percent": 2.0}
    units = {"mm": 1000.0, "deg": 1.0, "percent": 1.0, "um": 1.0}
    unit = {name: units.get(name.rpartition("_")[2], 100.0) for name in FOLLOWS}
    world = Amounts.stated()
    for name, of in FOLLOWS.items():
        amount = np.hypot.reduce([amount_named(one, world) for one in of] + [0.0]) / unit[name]
        assert getattr(PrintPrior(), name) == pytest.approx(margins.get(name, 1.0) * amount, rel=0.01), name
    assert {*FOLLOWS, *SAME} == set(asdict(PrintPrior()))


def test_what_good_prints_are_taken_to_scatter_by_follows_the_press(press: Press) -> None:
    """Variances by the square of an amount, shares of the light by the amount."""
    world = ResidualVariance()
    assert good_residual_variance(press) == world
    twice = good_residual_variance(replace(press, variation={"all_times": 2.0}))
    assert twice == ResidualVariance(
        edge=4 * world.edge, contrast=4 * world.contrast, share=2 * world.share, dark=2 * world.dark
    )
    coarse = good_residual_variance(replace(press, variation={"ink": {"halftone_contrast": 0.06}}))
    assert coarse == replace(world, contrast=4 * world.contrast)
    assert good_residual_variance(replace(press, variation={"all_times": 0.0})).exact


def test_a_press_keeps_what_its_prints_were_taken_to_do(trained_press: Press, tmp_path: Path) -> None:
    matched_filter = model_of(trained_press)
    assert matched_filter is not None
    prior = PrintPrior(gain=0.05, most_plane_mm=0.2)
    own = trained_press.with_detector(
        "matched_filter", replace(matched_filter, model=replace(matched_filter.model, prior=prior))
    )
    own.save(tmp_path / "own.press")
    again = Press.load(tmp_path / "own.press").detectors["matched_filter"]
    assert again is not None
    assert again.model.prior == prior
    assert "prior" not in matched_filter.model.facts()  # so that artefacts of before keep their digests


def test_the_papers_unit_is_how_wide_its_window_means_scatter_on_good_prints(
    press: Press, page: Page
) -> None:
    """Equation 4: half of them lie below 0.675 units. The share of one print is counted in steps of one window."""
    pages, designs = _One(page), (0, 1, 2)
    units = UnitWork(press=press, pages=pages, seed=1)(designs)["unit"]  # type: ignore[arg-type]
    assert units.shape == (3, len(press.sensors))
    day = PressDay.of(press, pages, seed=1, first=0)  # type: ignore[arg-type]
    for index, unit in zip(designs, units, strict=True):
        scan = day.scan(day.day.good(page), stream(1, "training-print", index))
        means = page_evidence(page, scan, press.press_context()).block_z
        share = window_statistics(means, unit=unit)[:, 2]
        np.testing.assert_allclose(share, 0.5, atol=0.002 + 1 / means[0].size)
        assert (unit > 1.5).all()  # a press does more than its camera's noise


def test_a_design_wider_than_the_field_is_cut_to_it(press: Press, make_page: Callable[..., Page]) -> None:
    wide = fitted(make_page(1, width_mm=100, height_mm=120), press.geometry)
    assert press.geometry.field_mm - 0.1 < wide.width_mm <= press.geometry.field_mm
    assert wide.height_mm < 1.5 * wide.width_mm
    small = make_page(1)
    assert fitted(small, press.geometry) is small


def test_days_differ_and_a_day_repeats(press: Press, page: Page) -> None:
    scans = []
    for first, seed in ((0, 1), (0, 1), (4, 1)):
        day = PressDay.of(press, _One(page), seed=1, first=first)
        scans.append(day.scan(day.day.good(page), np.random.default_rng(seed)))
    np.testing.assert_array_equal(scans[0], scans[1])
    assert (scans[0] != scans[2]).mean() > 0.5


class _One:
    def __init__(self, page: Page) -> None:
        self._page = page

    def page(self, index: int) -> Page:
        return self._page

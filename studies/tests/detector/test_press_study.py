"""The press study's judging on rows that are drawn: parts are kept apart, and the page says what was found."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
from prooflight.simulation.misprints.kinds import KINDS
from prooflight_studies.harness.operating import Scored
from prooflight_studies.harness.page import page_text, plain
from prooflight_studies.press.findings import FIRST
from prooflight_studies.press.judging import (
    ALPHAS,
    MATCHED_FILTER,
    PARTS,
    RateCheck,
    alarms_by_others,
    check_rates,
    judged,
)
from prooflight_studies.press.results import near, press_results
from prooflight_studies.press.scans import PLACES, Scene
from prooflight_studies.press.study import PressFindings, PressPlan

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight_studies.harness.result_cache import Rows
    from prooflight_studies.press.judging import Verdicts

NAMES = [
    "box/add-C+/8",
    "flat/void+/4",
    "line/void/1/full",
    "echo/C/0",
    "wave/light/one",
    "fit/gain-C",
    "place/skew",
]
DESIGNS = 150


def drawn_rows(seed: int) -> Rows:
    """A good print and a misprint of each design; a misprint raises one number, which also says where it is."""
    rng = np.random.default_rng(seed)
    design = np.repeat(np.arange(DESIGNS), 2)
    bad = np.arange(design.size) % 2 == 1
    kind = np.where(bad, np.array(KINDS)[design % len(KINDS)], "").astype("U16")
    severity = np.where(bad, rng.random(design.size), 0.0)
    values = np.exp(0.3 * rng.standard_normal((design.size, len(NAMES))))
    raised = design % len(NAMES)
    values[bad, raised[bad]] *= 1 + 20 * severity[bad]
    boxes = np.broadcast_to(np.array([10, 10, 4, 4], np.float32), (*values.shape, 4)).copy()
    boxes[:, -2:] = np.nan
    places = np.full((design.size, PLACES, 4), np.nan, np.float32)
    places[bad, 0] = 10, 10, 4, 4
    return {
        "design": design,
        "day": design // 10 * 10,
        "kind": kind,
        "severity": severity,
        "values": values.astype(np.float32),
        "boxes": boxes,
        "portrait": rng.standard_normal((design.size, 3)),
        "another": kind == "wrong-page",
        "places": places,
        "sigma_error": rng.uniform(0.7, 1.4, (design.size, 2)),
        "unmade_kind": np.array([], "U16"),
        "names": np.array(NAMES * 2),
    }


@pytest.fixture(scope="module")
def rows() -> Rows:
    return drawn_rows(1)


@pytest.fixture(scope="module")
def verdicts(rows: Rows) -> Verdicts:
    return judged(rows, Scatter.white(), seed=1, trees=30, ablations=False)


def test_misprints_are_caught_and_good_pages_pass(verdicts: Verdicts) -> None:
    matched_filter = verdicts.methods[MATCHED_FILTER]
    assert matched_filter.area > 0.85
    assert matched_filter.alarms[1][matched_filter.scored.bad].mean() > 0.6
    assert matched_filter.alarms[1][~matched_filter.scored.bad].mean() < 0.3
    assert matched_filter.alarms.shape == (len(ALPHAS), 2 * DESIGNS)


def test_every_page_keeps_its_press_day(rows: Rows, verdicts: Verdicts) -> None:
    """Ten designs a day: intervals come of 15 days, not of 150 designs."""
    for one in verdicts.methods.values():
        assert np.array_equal(one.scored.day, rows["day"])
    assert len(np.unique(rows["day"])) == 15


def test_a_wrong_page_is_certain(rows: Rows, verdicts: Verdicts) -> None:
    assert verdicts.methods[MATCHED_FILTER].nominal_alarms[rows["another"]].all()
    assert (verdicts.kinds[rows["another"]] == "wrong-page").all()


def test_no_day_judges_itself(rows: Rows) -> None:
    """What a part's own pages are changes nothing of the detector that judges them, nor of its thresholds."""
    part = np.unique(rows["day"], return_inverse=True)[1] % PARTS
    altered = {name: column.copy() for name, column in rows.items()}
    altered["values"][part == 2] *= 3
    before, after = (
        judged(each, Scatter.white(), seed=1, trees=8, ablations=False).detectors[2]
        for each in (rows, altered)
    )
    assert before.threshold == after.threshold
    assert np.array_equal(before.baseline, after.baseline)


def test_a_promise_is_kept_by_designs_that_do_nothing_else(verdicts: Verdicts) -> None:
    """Seed 2: 1 % promised by 150 designs is at most 5 of 150 good pages (Poisson 0.9955 at a mean of 1.5)."""
    further = {name: column for name, column in drawn_rows(2).items() if name != "names"}
    good = {name: column[further["kind"] == ""] for name, column in further.items() if name != "unmade_kind"}
    third = {name: column for name, column in drawn_rows(3).items() if name not in ("names", "unmade_kind")}
    trial = {name: column[third["kind"] == ""] for name, column in third.items()}
    (often, seldom), tried = check_rates(verdicts, good, trial, calibration={0.1: 100, 0.01: DESIGNS})
    matched_filter = verdicts.methods[MATCHED_FILTER]
    assert tried[0].alarms.shape == tried[1].alarms.shape == (DESIGNS,)
    assert (tried[1].alarms <= tried[0].alarms).all()
    assert tried[1].alarms.sum() <= 5
    assert often.designs == 100
    assert (seldom.alarms <= often.alarms).all()
    assert seldom.alarms[~matched_filter.scored.bad].sum() <= 5
    assert seldom.alarms[matched_filter.scored.bad].mean() > 0.4


def test_good_pages_of_other_designs_set_thresholds_and_teach_nothing(rows: Rows, verdicts: Verdicts) -> None:
    further = drawn_rows(3)
    good = {
        name: column[further["kind"] == ""]
        for name, column in further.items()
        if len(column) == len(further["kind"])
    }
    good["design"] = good["design"] + 1000
    more = judged(rows, Scatter.white(), seed=1, good=good, trees=30, ablations=False)
    matched_filter, before = more.methods[MATCHED_FILTER], verdicts.methods[MATCHED_FILTER]
    assert np.array_equal(matched_filter.scored.score, before.scored.score)
    assert np.array_equal(matched_filter.part, before.part)
    assert not np.array_equal(matched_filter.nominal_alarms, before.nominal_alarms)
    assert more.detectors[0].good_designs == verdicts.detectors[0].good_designs + DESIGNS


def test_a_page_meets_the_threshold_of_the_other_pages() -> None:
    """Of n designs that promise 1 in n to each other, only the furthest out alarms; its misprint meets the same."""
    score = np.array([0.3, 0.9, 0.1, 0.5, 0.95, 0.85])
    bad = np.array([False, False, False, False, True, True])
    scored = Scored(score=score, bad=bad, design=np.array([0, 1, 2, 3, 0, 1]), day=np.zeros(6, np.int64))
    assert alarms_by_others(scored, 0.25).tolist() == [False, True, False, False, True, True]
    with pytest.raises(ValueError, match="cannot promise"):
        alarms_by_others(scored, 0.2)


def test_places_are_right_within_five_millimetres() -> None:
    places = np.full((3, PLACES, 4), np.nan, np.float32)
    places[:, 0] = 100, 100, 10, 2
    places[:, 1] = 10, 10, 1, 1
    boxes = np.array([[108, 104, 4, 4], [120, 100, 4, 4], [8, 8, 2, 2]], np.float32)
    assert near(boxes, places).tolist() == [True, False, True]
    assert not near(np.full((1, 4), np.nan, np.float32), places[:1]).any()


def page_of(found: PressFindings) -> str:
    return page_text({"study": "press", **plain(press_results(found))})


def test_the_page_says_it_all(rows: Rows, verdicts: Verdicts) -> None:
    alarms = np.array([False] * 40 + [True])
    found = PressFindings(
        plan=PressPlan(seed=1, designs=DESIGNS),
        pitch_mm=0.254,
        fringes=False,
        main=rows,
        verdicts=verdicts,
        kept=[RateCheck(rate=0.001, designs=5000, alarms=verdicts.methods[MATCHED_FILTER].nominal_alarms)],
        tried=[RateCheck(rate=0.001, designs=5000, alarms=np.zeros(123, bool))],
        looser={"variations 1.5 times those assumed": alarms},
        ideal=verdicts,
        real=verdicts.methods[MATCHED_FILTER],
    )
    text = page_of(found)
    assert "nan" not in text
    for word in (
        *KINDS,
        *verdicts.methods,
        "2.44%",
        "| 123 | 0 | 0.00% (< 2.41%)",
        "Real pages",
        "ideal world",
    ):
        assert word in text
    follows = replace(found, fringes=True)
    assert ("forest of families alone" in text) == ("forest of families alone" in verdicts.methods)
    assert (found.page, follows.page) == ("press-without-fringes.md", "press.md")
    assert "[inspection] fringes = false" in text
    assert "[inspection] fringes" not in page_of(follows)


def test_kinds_take_turns_and_no_two_scenes_share_a_day(tmp_path: Path) -> None:
    scene = Scene(press=tmp_path, pages=None, seed=1, number=1, misprints=1)  # type: ignore[arg-type]
    kinds = [scene.kind(index, 1) for index in range(144)]
    assert {kind: kinds.count(kind) for kind in KINDS} == dict.fromkeys(KINDS, 12)
    assert len({scene.kind(index, 1) for index in range(0, 144, 12)}) == len(KINDS)
    assert scene.kind(5, 0) == ""
    plan = PressPlan(seed=1)
    assert [day.designs[0] for day in plan.days(30, 25)] == [30, 40, 50]
    assert plan.days(30, 25)[-1].designs == (50, 51, 52, 53, 54)


@pytest.mark.parametrize("plan", [PressPlan(seed=1), PressPlan.quick(1)])
def test_no_design_is_in_two_scenes(plan: PressPlan) -> None:
    designs = [design for scene in FIRST for day in plan.days_of(scene) for design in day.designs]
    assert len(designs) == len(set(designs)) == sum(plan.count(scene) for scene in FIRST)


def test_a_scene_that_reaches_into_the_next_is_refused() -> None:
    with pytest.raises(ValueError, match="designs: there are 1500 designs, not 1501"):
        PressPlan(seed=1, designs=1501)

"""The ranking study on lessons that are made up: no press day judges itself, and what is shipped can be read."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.commissioning.training.adapting import adapted
from prooflight.detectors.matched_filter.calibrated import WRONG_PAGE
from prooflight.detectors.matched_filter.shipped import ShippedRanking
from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
from prooflight.rng import stream
from prooflight_studies.ranking import study
from prooflight_studies.ranking.study import Lesson, RankingPlan

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight_studies.harness.result_cache import Rows

NAMES = ["box/void+/8", "streak/void/1/full", "ghost/C/0", "place/skew", "place/lost"]
KINDS = "streak", "ghost-smear", "wrong-page"
TREES = 8


def made_up(designs: int, seed: int, *, first_day: int, times: float = 1.0) -> Rows:
    """Four designs a day, of each a good print and a misprint that raises the statistic of its kind.

    The first look is at those of the first two kinds, and at no ghosts.
    """
    rng = np.random.default_rng(seed)
    design = np.repeat(np.arange(designs), 2)
    bad = np.arange(design.size) % 2 == 1
    kind = np.where(bad, np.array(KINDS)[design % 3], "").astype("U16")
    values = times * np.exp(0.2 * rng.standard_normal((design.size, len(NAMES))))
    for place, one in enumerate(KINDS):
        values[kind == one, place] *= 6
    return {
        "design": design,
        "day": first_day + design // 4,
        "kind": kind,
        "severity": np.where(bad, 0.5, 0.0),
        "values": values.astype(np.float32),
        "portrait": rng.standard_normal((design.size, 3)),
        "another": kind == "wrong-page",
        "floor_mm2": np.where(kind == "spots-voids", 0.5, 0.0),
        "names": np.array(NAMES * 2),
    }


@pytest.fixture
def lessons(monkeypatch: pytest.MonkeyPatch) -> list[Lesson]:
    """Of two presses, the second of which is three times as far out in everything."""
    found = [
        Lesson(name="two", scatter=Scatter.white(), rows=(made_up(120, 1, first_day=0),)),
        Lesson(name="one", scatter=Scatter.white(), rows=(made_up(80, 2, first_day=100_000, times=3.0),)),
    ]
    monkeypatch.setattr(study, "lessons", lambda *_args, **_more: found)
    monkeypatch.setattr(study, "TREES", TREES)
    monkeypatch.setattr(study, "LEFT_OUT_TREES", TREES)
    return found


def test_what_is_shipped_is_what_was_judged(lessons: list[Lesson], tmp_path: Path) -> None:
    ship = tmp_path / "ranking.safetensors"
    found = study.run_ranking_study(
        tmp_path, cache=tmp_path, plan=RankingPlan.quick(), ship=ship, processes=1
    )
    shipped = ShippedRanking.load(ship)
    assert (found["good"], found["misprints"]) == (200, 200)
    assert shipped.references.worst.shape == (len(study.SIZES), 200)  # a design of either press by itself
    assert shipped.misprints.size == 200
    assert shipped.model.kinds == tuple(sorted(KINDS))
    assert not shipped.model.shift.any()
    certain = next(one for one in found["kinds"] if one["kind"] == "wrong-page")
    assert certain["caught"] == certain["untaught"] == 1
    assert (shipped.misprints >= WRONG_PAGE).sum() == certain["count"]
    assert found["rates"][0]["caught"] > 0.8
    assert [one["caught"] for one in found["rates"]] == sorted(one["caught"] for one in found["rates"])
    text = (tmp_path / "ranking.md").read_text()
    assert "nan" not in text
    assert all(f"| {kind} |" in text for kind in KINDS)


def test_each_row_is_judged_once_by_other_press_days(lessons: list[Lesson]) -> None:
    training = study.TrainingRows.of(lessons)
    work = study.FoldWork(training=training, seed=5)
    folds = [work((index, "")) for index in range(study.FOLDS)]
    assert sorted(np.concatenate([one.rows for one in folds]).tolist()) == list(range(400))
    days = [set(training.day[one.rows]) for one in folds]
    assert not any(days[a] & days[b] for a in range(4) for b in range(a))
    mine = training.fold == 2
    values = training.pages.values.copy()
    values[np.flatnonzero(mine)[:-1]] *= (
        7  # what others of the fold say changes nothing of the last one's score
    )
    other = study.FoldWork(training=replace(training, pages=replace(training.pages, values=values)), seed=5)(
        (2, "")
    )
    assert (other.score[:, -1] == folds[2].score[:, -1]).all()
    assert not np.array_equal(other.score, folds[2].score)


def test_each_press_is_made_fit_by_its_own_good_pages_of_the_other_days(lessons: list[Lesson]) -> None:
    training = study.TrainingRows.of(lessons)
    pages, mine = training.pages, training.fold == 1
    found = study.FoldWork(training=training, seed=5)((1, ""))
    model = training.model(~mine, stream(5, "ranking-fold", 1), TREES)
    for press in (0, 1):
        here = pages.press == press
        fit = adapted(model, pages.rows(here & ~mine & ~pages.bad))
        judged = pages.rows(here & mine)
        plain = ~training.another[here & mine]
        asked = fit.score(judged.values, judged.page_features)[plain]
        # 320 are more than there are: all of them made it fit, whose order says nothing
        assert found.score[-1, here[found.rows]][plain] == pytest.approx(asked)
        assert found.score[0, here[found.rows]][plain] != pytest.approx(asked)


def test_a_kind_that_is_left_out_teaches_nothing_and_alone_is_judged(lessons: list[Lesson]) -> None:
    training = study.TrainingRows.of(lessons)
    found = study.FoldWork(training=training, seed=5)((0, "streak"))
    assert set(training.pages.kind[found.rows]) == {"", "streak"}
    assert "streak" not in set(found.kind)

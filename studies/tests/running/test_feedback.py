"""The study of feedback on a pool that is known: the sample keeps the promise, alarms alone do not."""

from __future__ import annotations

import numpy as np
import pytest

from prooflight.rng import stream
from prooflight_studies.feedback.pool import TARGET_RATE, Pool, PoolPlan
from prooflight_studies.feedback.study import GOAL_FACTOR, LABELLED, _results, history
from prooflight_studies.harness.page import page_text, plain

DAYS, A_DAY = 60, 100


@pytest.fixture(scope="module")
def pool() -> Pool:
    """Good scores are standard normal, a tenth of them alarms; misprints lie 3 further out."""
    rng = np.random.default_rng(2)
    good, wrong = rng.standard_normal(DAYS * A_DAY), rng.standard_normal(DAYS * 5) + 3
    return Pool(
        score=np.concatenate([good, wrong]),
        day=np.concatenate([np.repeat(np.arange(DAYS), A_DAY), np.repeat(np.arange(DAYS), 5)]),
        kind=np.array([""] * good.size + ["density"] * wrong.size),
        severity=np.zeros(good.size + wrong.size),
        threshold=1.28,
        guarantee="one in 100",
        minutes=1.0,
    )


def test_the_sample_keeps_the_promise_and_alarms_alone_break_it(pool: Pool) -> None:
    """12 histories of seed 2: the mean's standard error is 0.1 of the promise, so a factor of 1.5 is far."""
    lived = [history(pool, stream(2, "feedback-weeks", number)) for number in range(12)]
    found = _results(pool, lived, plan=PoolPlan.quick(2), quick=True)
    assert found.goal.told == LABELLED[-1]
    assert 1 / GOAL_FACTOR < found.goal.realised / TARGET_RATE < GOAL_FACTOR
    before, naive = found.rows[0], found.alone
    assert before.realised == pytest.approx(0.1, abs=0.01)
    assert naive.realised < TARGET_RATE / 3
    assert naive.caught < found.goal.caught - 0.2
    assert found.refused_below == 99
    assert found.missed_covered >= 0.75
    text = page_text({"study": "feedback", **plain(found)})
    assert "met" in text
    assert "99 sampled good sheets" in text

"""Real good pages set the threshold anew; no scan counts twice."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.commissioning.training.real_pages import FEWEST_REAL, new_scans, recalibrated
from prooflight.errors import RequestError

if TYPE_CHECKING:
    from prooflight.press.artefact import Press


def pages(count: int, *, seed: int = 1, first: int = 0) -> tuple[dict[str, float], dict[str, str]]:
    rng = np.random.default_rng(seed)
    names = [f"p{first + number:04d}" for number in range(count)]
    return {name: float(rng.exponential(2.0)) for name in names}, {name: f"{name}{seed}" for name in names}


def test_enough_real_pages_promise_by_themselves(trained_press: Press) -> None:
    scores, digests = pages(120)
    learned = recalibrated(trained_press, scores, digests, false_alarm_rate=0.01)
    assert learned.ours is not None
    assert learned.ours.promise.conformal
    assert (learned.ours.promise.real, learned.ours.promise.simulated) == (120, 0)
    # ceil(121 x 0.99) = 120th smallest of 120: the greatest
    assert learned.ours.threshold == max(scores.values())
    assert learned.digest != trained_press.digest


def test_pages_add_up_over_runs_and_none_counts_twice(trained_press: Press) -> None:
    scores, digests = pages(30)
    first = recalibrated(trained_press, scores, digests, false_alarm_rate=0.1)
    assert new_scans(first, digests) == {}
    more_scores, more = pages(30, seed=2)
    again = new_scans(first, more | {"p0000": digests["p0000"], "copy": more["p0001"]})
    assert "p0000" not in again
    assert "copy" not in again
    assert len(again) == 29
    second = recalibrated(first, more_scores, again, false_alarm_rate=0.1)
    assert second.ours is not None
    assert second.ours.promise.real == 59


def test_too_few_real_pages_are_refused(trained_press: Press, press: Press) -> None:
    scores, digests = pages(FEWEST_REAL - 1)
    with pytest.raises(RequestError, match=f"give {FEWEST_REAL} or more"):
        recalibrated(trained_press, scores, digests, false_alarm_rate=0.1)
    with pytest.raises(RequestError, match="was not taught our detector"):
        recalibrated(press, *pages(30), false_alarm_rate=0.1)

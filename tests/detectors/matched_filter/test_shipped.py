"""The ranking that comes with the program: that it is whole, of this version, and what it says of good pages."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.detectors.matched_filter.analysis import analyse
from prooflight.detectors.matched_filter.design import prepare_page
from prooflight.detectors.matched_filter.model import DetectorModel
from prooflight.detectors.matched_filter.shipped import ShippedRanking, shipped_ranking
from prooflight.detectors.matched_filter.statistics.families import all_statistics
from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
from prooflight.detectors.matched_filter.statistics.statistic import keys_of
from prooflight.prediction.predict import predict
from prooflight.simulation.misprints.kinds import KINDS
from prooflight.simulation.scans import ideal_scan

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press


def test_it_is_sound_and_tells_every_kind() -> None:
    shipped = shipped_ranking()
    DetectorModel.check(shipped.model.arrays(), shipped.model.facts() | {"threshold": None})
    assert set(shipped.model.kinds) == set(KINDS)
    assert not shipped.model.shift.any()
    assert (shipped.model.scale == 1).all()
    for scores in (*shipped.references.worst, shipped.misprints):
        assert np.isfinite(scores).all()
        assert (np.diff(scores) >= 0).all()


def test_its_good_pages_promise_one_false_alarm_in_a_hundred_by_count_and_it_catches_misprints() -> None:
    shipped = shipped_ranking()
    threshold, by_count = shipped.references.by(100).threshold(0.01)
    assert by_count
    assert shipped.caught(threshold) > 0.5
    assert shipped.caught(-np.inf) == 1
    assert shipped.caught(float(shipped.misprints[-1])) == 0


def test_it_comes_back_from_its_file(tmp_path: Path) -> None:
    shipped = shipped_ranking()
    few = replace(shipped, misprints=np.array([1.0, 2.0, 3.0, 5.0]))
    assert few.caught(2.0) == 0.5
    few.save(tmp_path / "ranking.safetensors")
    again = ShippedRanking.load(tmp_path / "ranking.safetensors")
    assert again.misprints.tolist() == [1, 2, 3, 5]
    assert again.references.worst.tolist() == few.references.worst.tolist()
    assert again.model.facts() == few.model.facts() | {"threshold": np.inf}
    for name, array in few.model.arrays().items():
        np.testing.assert_array_equal(again.model.arrays()[name], array)


def test_it_looks_at_what_this_version_looks_at(trained_names: list[str]) -> None:
    assert [one.key for one in shipped_ranking().model.statistics] == trained_names


@pytest.fixture(scope="module")
def trained_names(press: Press, page: Page) -> list[str]:
    """Keys of the statistics of a scan."""
    expected = predict(page, sensors=press.sensors, geometry=press.geometry, threads=1)
    known = prepare_page(page, expected, sensors=press.sensors, geometry=press.geometry)
    analysis = analyse(known, ideal_scan(expected, press, np.random.default_rng(2)))
    return keys_of(
        all_statistics(analysis.sums, analysis.marks, analysis.fit, analysis.registration, Scatter.white())
    )

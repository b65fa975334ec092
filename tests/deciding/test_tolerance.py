"""From a scan to what it says, and an artefact's way there and back; learning: ``commissioning/test_learn.py``."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.commissioning.learn import Pages, learn_tolerance
from prooflight.comparing.local_evidence import Scatter
from prooflight.deciding.families import all_said
from prooflight.deciding.said import stated
from prooflight.deciding.taught import TolerancePress, compressed, families_of
from prooflight.deciding.tolerance import look, prepare_page
from prooflight.predicting.predict import predict
from prooflight.simulating.misprints import KINDS
from prooflight.simulating.scans import ideal_scan

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.press import Press

NAMES = ["box/add-C+/8", "box/add-C-/8", "flat/void+/4", "streak/void/1/full", "ghost/C/0", "place/skew"]


@pytest.fixture(scope="module")
def taught() -> TolerancePress:
    rng = np.random.default_rng(1)
    values = np.exp(0.3 * rng.standard_normal((400, len(NAMES)))).astype(np.float32)
    bad = np.arange(400) % 2 == 1
    kind = np.where(bad, np.array(KINDS)[np.arange(400) // 2 % 3], "")
    for place, one in enumerate(KINDS[:3]):
        values[kind == one, place] *= 8
    pages = Pages(
        values=values, portraits=rng.standard_normal((400, 3)), design=np.arange(400) // 2, bad=bad, kind=kind
    )
    return learn_tolerance(pages, names=NAMES, scatter=Scatter.white(), rng=rng, trees=60)


def test_a_mark_is_what_a_scan_says_most(press: Press, page: Page) -> None:
    expected = predict(page, sensors=press.sensors, geometry=press.geometry, threads=1)
    known = prepare_page(page, expected, sensors=press.sensors, geometry=press.geometry)
    cmyk = page.cmyk.copy()
    rows, columns = cmyk.shape[:2]
    spot = (slice(rows // 2, rows // 2 + 24), slice(columns // 2, columns // 2 + 24))
    cmyk[spot] = 255 - cmyk[spot]
    said = []
    for printed in (page, replace(page, cmyk=cmyk)):
        seen = predict(printed, sensors=press.sensors, geometry=press.geometry, threads=1)
        scan = ideal_scan(seen, press, np.random.default_rng(2))
        looked = look(known, scan, sensors=press.sensors, geometry=press.geometry)
        said.append(all_said(looked.sums, looked.fit, looked.found, Scatter.white()))
    good, bad = (compressed(stated(one)) for one in said)
    assert [one.name for one in said[0]] == [one.name for one in said[1]]
    assert np.isfinite(good).all()
    assert (bad - good).max() > 1.0


def test_kinds_are_told_apart(taught: TolerancePress) -> None:
    values = np.ones((3, len(NAMES)), np.float32)
    values[np.arange(3), np.arange(3)] = 9
    assert taught.kinds_of(values, np.zeros((3, 3))) == list(KINDS[:3])


def test_more_evidence_scores_higher(taught: TolerancePress) -> None:
    values = np.ones((2, len(NAMES)), np.float32)
    values[1, 0] = 9
    good, bad = taught.score(values, np.zeros((2, 3)))
    assert bad > good + 2


def test_kinds_and_scores_come_back_from_arrays_and_facts(taught: TolerancePress) -> None:
    again = TolerancePress.from_parts(taught.arrays(), taught.facts())
    rng = np.random.default_rng(3)
    values, portraits = rng.exponential(2, (50, len(NAMES))), rng.standard_normal((50, 3))
    assert np.array_equal(again.score(values, portraits), taught.score(values, portraits))
    assert again.kinds_of(values, portraits) == taught.kinds_of(values, portraits)


def test_families_join_sizes_and_keep_signs_apart() -> None:
    assert families_of(["flat/void+/4", "flat/void+/8", "flat/void-/4", "swap/CM", "swap/CK"]) == [
        "flat/void+", "flat/void+", "flat/void-", "swap", "swap",
    ]  # fmt: skip

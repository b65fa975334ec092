"""Corrections are offered where they are sure, and the roll map says where on the web everything is."""

from __future__ import annotations

import csv
import io
from xml.etree import ElementTree

import pytest
from packages.line.tests.causes.rows import GEOMETRY, region, row

from prooflight.detectors.verdict import Verdict
from prooflight_line.causes.corrections import corrections_of
from prooflight_line.causes.roll_map import as_csv, as_xml, picture, roll_map
from prooflight_line.journal.records import PageRecord, RunFacts, RunRow


def density(values: list[float]) -> list[PageRecord]:
    return [row(sheet, nuisance={"gain-black": value}) for sheet, value in enumerate(values)]


def test_a_sure_deviation_is_offered_damped() -> None:
    (offer,) = corrections_of(density([0.05, 0.07] * 6), damping=0.25)
    assert offer.deviation == pytest.approx(0.06)
    assert offer.offset == pytest.approx(-0.015)
    assert (offer.sheets, offer.last_sheet) == (12, 11)


def test_an_unsure_deviation_is_not() -> None:
    (offer,) = corrections_of(density([0.3, -0.28] * 6))
    assert offer.offset == 0


def test_sheets_before_the_last_correction_do_not_count() -> None:
    records = density([0.4] * 10 + [0.05, 0.07] * 5)
    (offer,) = corrections_of(records, since_sheet=10)
    assert offer.deviation == pytest.approx(0.06)
    assert corrections_of(records, since_sheet=15) == []


@pytest.mark.parametrize("damping", [0.0, 1.5, float("nan")])
def test_a_damping_that_is_none_is_refused(damping: float) -> None:
    with pytest.raises(ValueError, match="damping"):
        corrections_of(density([0.1] * 9), damping=damping)


@pytest.fixture
def records() -> list[PageRecord]:
    unseen = Verdict(page="p0003", verdict="not-inspected", reason="late")
    missing = row(4, faults=("missing",))
    return [
        row(1),
        row(2, region(50, 80), region(90, 200, width=4), shift=(0.3, 1.0)),
        PageRecord(sheet=3, job_page=3, verdict=unseen, late=True, first_line=9300, time_s=1.0),
        missing,
    ]


def test_the_web_begins_with_the_first_sheet(records: list[PageRecord]) -> None:
    first, second, unseen = roll_map(records, GEOMETRY)
    assert (first.from_m, first.to_m) == (pytest.approx(0.310 + 0.0825), pytest.approx(0.310 + 0.0835))
    assert (second.left_mm, second.right_mm, second.kind) == (88.0, 92.0, "spots-voids")
    assert (unseen.from_m, unseen.to_m) == (pytest.approx(0.62), pytest.approx(0.93))
    assert unseen.reason == "late"
    assert roll_map([], GEOMETRY) == []


def test_both_files_say_the_same(records: list[PageRecord]) -> None:
    stretches = roll_map(records, GEOMETRY)
    rows = list(csv.DictReader(io.StringIO(as_csv(stretches))))
    facts = RunFacts(
        job="a & <b>\x01", job_digest="", press="p", press_digest="", detector="d", source="s", started_s=0.0
    )
    run = RunRow(
        id=7,
        facts=facts,
        end=None,
        state="running",
        pages=3,
        misprints=1,
        not_inspected=1,
        late=1,
        faulty=0,
        dropped_pages=0,
        dropped_evidence=0,
        promise_suspended_from=None,
    )
    root = ElementTree.fromstring(as_xml(stretches, run))
    assert root.attrib == {"run": "7", "job": "a & <b> ", "press": "p"}
    cells = [dict(one.attrib) for one in root]
    assert [{k: one[k] for k in ("sheet", "kind")} for one in cells] == [
        {k: one[k] for k in ("sheet", "kind")} for one in rows
    ]
    assert [float(one["from_m"]) for one in cells] == [float(one["from_m"]) for one in rows]


def test_it_is_drawn(records: list[PageRecord]) -> None:
    axes = picture(roll_map(records, GEOMETRY), title="Run 7").axes[0]
    points = axes.collections[0].get_offsets()
    assert len(points) == 2
    assert points[0][1] == pytest.approx(50)

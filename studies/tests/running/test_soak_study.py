from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from prooflight.detectors.verdict import Verdict
from prooflight.simulation.drum import DrumFault, turns
from prooflight_line.journal.records import PageRecord
from prooflight_studies.harness.page import page_text, plain
from prooflight_studies.soak.study import Passed, compared, drawn_faults, soak_results, truth

if TYPE_CHECKING:
    from prooflight_studies.soak.study import SoakFigures

SHEETS = 40
FAULTS = {
    5: DrumFault(kind="repeated"),
    12: DrumFault(kind="missing"),
    20: DrumFault(kind="out-of-order"),
    28: DrumFault(kind="slip", amount=5.0),
}


def row(sheet: int, job_page: int | None, *faults: str) -> PageRecord:
    return PageRecord(
        sheet=sheet,
        job_page=job_page,
        verdict=Verdict(page="p", verdict="not-inspected"),
        late=False,
        first_line=0,
        time_s=0.0,
        faults=faults,
    )


def journal(**changes: tuple[int | None, tuple[str, ...]]) -> tuple[list[PageRecord], list[int | None]]:
    """What a faultless pager writes of ``FAULTS``; changes: other words about sheets, ``s7=(page, faults)``."""
    rows, digests = list[PageRecord](), list[int | None]()
    said = {6: ("repeated",), 13: ("missing",), 20: ("missing",), 21: ("out-of-order",), 28: ("slip",)}
    for place, sheet in enumerate(truth(turns(SHEETS, FAULTS), FAULTS)):
        page, faults = changes.get(f"s{place}", (sheet.page, said.get(place, ())))
        rows.append(row(len(rows), page, *faults))
        digests.append(0 if page is None else 100 + page)
        if place == 15:
            rows.append(row(len(rows), 12, "missing"))
            digests.append(None)
    return rows, digests


def figures(rows: list[PageRecord], digests: list[int | None]) -> SoakFigures:
    usual = {page: 100 + page for page in range(SHEETS)}
    return compared(rows, digests, truth(turns(SHEETS, FAULTS), FAULTS), FAULTS, usual, cpu_s=1.0)


def test_the_truth_says_which_sheets_a_fault_concerns() -> None:
    sheets = truth(turns(SHEETS, FAULTS), FAULTS)
    assert len(sheets) == SHEETS  # one twice, one not at all
    assert {place: sheet.fault for place, sheet in enumerate(sheets) if sheet.fault is not None} == {
        6: 0,
        13: 1,
        20: 2,
        21: 2,
        28: 3,
    }
    assert [sheets[place].page for place in (5, 6, 7, 13, 20, 21)] == [5, 5, 6, 13, 21, 20]


def test_whoever_says_it_all_has_named_all() -> None:
    found = figures(*journal())
    assert {kind: row for kind, row in found.kinds.items() if row["drawn"]} == {
        kind: {"drawn": 1, "named": 1, "in_step": 1}
        for kind in ("repeated", "missing", "out-of-order", "slip")
    }
    assert (found.false_faults, found.wrong_pages, found.unlike, found.notes) == (0, 0, 0, ())
    assert (found.missing_said, found.missing_true, found.missing_in_truth) == (1, 1, 1)
    assert found.sheets == found.seen == SHEETS


@pytest.mark.parametrize(
    ("changes", "counts"),
    [
        ({"s28": (28, ())}, {"named": 3}),
        ({"s11": (10, ("slip",))}, {"false_faults": 1, "in_step": 4}),
        ({"s34": (35, ())}, {"wrong_pages": 1, "unlike": 0}),
        ({"s30": (31, ())}, {"wrong_pages": 1, "in_step": 3}),
        ({"s35": (None, ("unknown",))}, {"wrong_pages": 1, "false_faults": 1}),
    ],
)
def test_what_is_said_wrongly_is_counted(changes: dict[str, Any], counts: dict[str, int]) -> None:
    found = figures(*journal(**changes))
    total = {name: sum(row[name] for row in found.kinds.values()) for name in ("named", "in_step")}
    told = total | {name: getattr(found, name) for name in ("false_faults", "wrong_pages", "unlike")}
    assert {name: told[name] for name in counts} == counts
    assert found.notes


def test_a_sheet_cut_out_otherwise_is_counted() -> None:
    rows, digests = journal()
    digests[10] = 7
    assert figures(rows, digests).unlike == 1


def test_faults_lie_apart_and_every_so_many_sheets() -> None:
    faults = drawn_faults(20_000, every=12, spacing=6, rng=np.random.default_rng(1))
    places = np.array(list(faults))
    assert np.diff(places).min() >= 6
    assert 20_000 / places.size == pytest.approx(12, rel=0.05)  # 1,700 faults: standard error 0.13
    kinds = [fault.kind for fault in faults.values()]
    assert {kinds.count(kind) for kind in set(kinds)} <= set(range(110, 230))
    assert len(truth(turns(20_000, faults), faults)) == 20_000 + kinds.count("repeated") - kinds.count(
        "missing"
    )


def test_the_page_says_what_was_found() -> None:
    found = figures(*journal(s28=(28, ())))
    size = {"designs": 30, "templates": 2, "forms": 5}
    text = page_text({"study": "soak", **plain(soak_results(found, size, seed=1))})
    assert "3 of 4 faults are reported" in text
    assert "| slip | 2.5 to 15 mm | 1 | 0 | 1 |" in text
    assert "a job of 40 different pages" in text


def test_a_sheet_is_as_it_passed() -> None:
    assert truth(turns(2, {}), {}) == [Passed(page=0, fault=None), Passed(page=1, fault=None)]

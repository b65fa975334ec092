"""The study of content: its sheets hold what they say, and its counts are those of its rows."""

from __future__ import annotations

import numpy as np
import pytest
import zxingcpp

from prooflight.rng import stream
from prooflight_studies.content.numbers import POINTS, WRONGS, text_results, text_sheet, with_wrong_digit
from prooflight_studies.content.study import DAMAGES, Cost, Damage, Row, _results, code_sheet, damaged
from prooflight_studies.harness.page import page_text, plain

DPI = 482.0


def test_every_code_of_a_sheet_reads_from_its_raster() -> None:
    page, placed = code_sheet(1, dpi=DPI, rng=stream(3, "content-sheet", 1))
    assert len(placed) >= 8
    for code in placed:
        quiet = 30
        cut = page.cmyk[
            code.rows.start - quiet : code.rows.stop + quiet,
            code.columns.start - quiet : code.columns.stop + quiet,
            3,
        ]
        read = zxingcpp.read_barcodes(np.ascontiguousarray(255 - cut))
        assert len(read) == 1
        assert code.text in read[0].text  # retail codes add a check digit


def test_damage_changes_its_code_alone_and_each_kind_comes() -> None:
    rng = stream(3, "content-sheet", 2)
    page, placed = code_sheet(2, dpi=DPI, rng=rng)
    spoilt, damages = damaged(page, placed, rng=rng)
    assert {damage.kind for damage in damages} == set(DAMAGES)
    outside = np.ones(page.cmyk.shape[:2], bool)
    for code in placed:
        outside[code.rows, code.columns] = False
        assert (spoilt.cmyk[code.rows, code.columns] != page.cmyk[code.rows, code.columns]).any()
    assert np.array_equal(spoilt.cmyk[outside], page.cmyk[outside])


def row(**changes: object) -> Row:
    usual = {
        "pitch_mm": 0.105,
        "symbology": "QR Code",
        "module_mm": 0.4,
        "found": True,
        "asked": True,
        "damage": None,
        "right": True,
        "grade": 4.0,
    }
    return Row(**(usual | changes))  # type: ignore[arg-type]


def test_the_page_counts_what_was_read() -> None:
    void = Damage(kind="void", severity=0.5)
    rows = [
        *(row() for _ in range(3)),
        row(right=False, grade=0.0),
        row(asked=False, right=False),
        row(damage=void, right=False, grade=0.0),
        row(damage=void, grade=1.0),
        row(damage=void, asked=False, right=False),
    ]
    found = _results(rows, [Cost(finding_ms=60, reading_ms=4, codes=2)], seed=1, sheets=1)
    (total, _) = found.totals
    assert (total["printed"], total["asked"], total["read"]) == (5, 4, 3)
    of_void = next(one for one in found.damaged if one["damage"] == "void" and one["pitch_mm"] == 0.105)
    assert (of_void["printed"], of_void["unread"], of_void["warned"]) == (2, 1, 1)
    assert found.reading_ms_a_code == pytest.approx(2)
    with pytest.raises(ZeroDivisionError):  # nothing was printed at the other pitch
        page_text({"study": "content", "text": None, **plain(found)})


@pytest.mark.parametrize("wrong", WRONGS)
@pytest.mark.parametrize("points", POINTS)
def test_one_digit_of_one_number_is_wrong_and_nothing_else(points: int, wrong: str) -> None:
    rng = stream(3, "content-text", 1, points)
    sheet = text_sheet(points, rng=rng)
    changed = with_wrong_digit(sheet, wrong, rng=rng)
    pairs = [
        (a.text, b.text) for a, b in zip(sheet.numbers, changed.numbers, strict=True) if a.text != b.text
    ]
    (was, now), *others = pairs
    assert not others
    differ = [at for at in range(len(was)) if was[at] != now[at]]
    assert len(was) == len(now)
    assert len(differ) == (2 if wrong == "swapped" else 1)
    assert (sorted(was) == sorted(now)) == (wrong == "swapped")
    assert now[differ[0]].isdigit() == (wrong != "dropped")
    apart = sheet.raster(1, dpi=200.0).cmyk != changed.raster(1, dpi=200.0).cmyk
    rows, columns, _ = np.nonzero(apart)
    size_px = points / 72 * 200
    assert 0 < np.ptp(rows) <= size_px
    assert np.ptp(columns) <= 2 * size_px


def test_counts_of_numbers_are_those_of_their_rows() -> None:
    rows = {
        "points": np.array([6, 6, 6, 8]),
        "wrong": np.array([-1, 0, 0, 1]),
        "before": np.array([False, False, True, False]),
        "after": np.array([False, True, True, False]),
        "near": np.array([False, True, False, False]),
        "named": np.array([False, True, False, False]),
        "s": np.array([-20.0, 100.0, 3.0, 5.0]),
    }
    found = text_results([(0.254, rows)], seed=1, sheets=1)
    (swapped,) = [one for one in found.caught if (one["points"], one["wrong"]) == (6, "swapped")]
    assert (swapped["printed"], swapped["before"], swapped["after"], swapped["near"]) == (2, 1, 2, 1)
    assert found.good == [{"pitch_mm": 0.254, "printed": 1, "before": 0, "after": 0, "named": 0}]
    assert found.margins[0]["greatest_good"] == -20

"""Codes looked for only as they run, on a page or alone: what all ways find, where they find it."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest
import zxingcpp

from prooflight.inspection.codes import symbols as library
from prooflight.inspection.codes.symbols import Symbol, symbols, symbols_of_page, tried

TEXTS = {"Code 128": "PRF-12", "EAN-13": "4006381333931", "ITF": "12345678", "Code 39": "PRF12"}


def drawn(symbology: str, quarter_turns: int) -> np.ndarray:
    """Bars three pixels wide in a quiet zone, turned."""
    code = zxingcpp.create_barcode(TEXTS[symbology], zxingcpp.barcode_format_from_str(symbology))
    bars = np.array(code.to_image(scale=1, add_hrt=False, add_quiet_zones=False))[:1]
    picture = np.pad(np.repeat(np.repeat(bars, 60, axis=0), 3, axis=1), 40, constant_values=255)
    return np.ascontiguousarray(np.rot90(picture, quarter_turns), np.uint8)


@pytest.mark.parametrize("quarter_turns", range(4))
@pytest.mark.parametrize("symbology", TEXTS)
def test_a_code_is_found_as_it_runs_where_all_ways_find_it(
    symbology: str, quarter_turns: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    picture = drawn(symbology, quarter_turns)
    (wanted,) = symbols(picture, symbology)
    assert wanted.along_lines == (quarter_turns % 2 == 0)

    def never(*_: object) -> list[Symbol]:
        raise AssertionError("the first way was enough")

    monkeypatch.setattr(library, "symbols", never)
    (found,) = islice(tried(picture, symbology, along_lines=wanted.along_lines), 1)
    assert found.text == TEXTS[symbology]
    assert np.array(found.corners) == pytest.approx(np.array(wanted.corners), abs=1.0)


def test_a_code_that_does_not_run_as_it_should_is_found_all_the_same() -> None:
    picture = drawn("Code 128", 1)
    assert [one.text for one in islice(tried(picture, "Code 128", along_lines=True), 1)] == ["PRF-12"]


@pytest.mark.parametrize("quarter_turns", range(4))
@pytest.mark.parametrize("symbology", ["Code 128", "EAN-13", "PDF417", "Data Matrix", "QR Code", "Aztec"])
def test_a_page_s_code_is_found_once_whichever_way_it_runs(symbology: str, quarter_turns: int) -> None:
    text = TEXTS.get(symbology, "PRF-12")
    code = zxingcpp.create_barcode(text, zxingcpp.barcode_format_from_str(symbology))
    printed = np.kron(np.array(code.to_image(scale=1, add_hrt=False)), np.ones((4, 4), np.uint8))
    picture = np.full((700, 800), 255, np.uint8)
    turned = np.rot90(printed, quarter_turns)
    picture[100 : 100 + turned.shape[0], 50 : 50 + turned.shape[1]] = turned
    (found,), (wanted,) = symbols_of_page(picture), symbols(picture, symbology)
    assert (found.text, found.symbology) == (text, symbology)
    assert np.array(found.corners) == pytest.approx(np.array(wanted.corners), abs=2.0)  # half a module

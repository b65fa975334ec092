"""A defect in words: closed cases in both languages, and nothing that the verdict does not state."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.detectors.verdict import Ink, Region, Verdict
from prooflight.reporting.defect_phrases import KINDS, TEXTS
from prooflight.reporting.defect_text import SheetSpan, describe, shown_kind

if TYPE_CHECKING:
    from prooflight.reporting.defect_phrases import Code

A4 = (210.0, 297.0)


def region(x: float, y: float, width: float, height: float, kind: str = "streak", **more: Any) -> Region:
    return Region(x_mm=x, y_mm=y, width_mm=width, height_mm=height, score=221.4, kind=kind, **more)


def misprint(*regions: Region, **more: Any) -> Verdict:
    kind = more.pop("kind", regions[0].kind if regions else None)
    return Verdict(page="p0001", verdict="misprint", kind=kind, regions=regions, **more)


def span(count: int, first: int, last: int, shown: int | None = None) -> SheetSpan:
    return SheetSpan(count=count, first=first, last=last, shown=last if shown is None else shown)


LEFT = region(0.3, 0.0, 3.0, 297.0, ink="M", darker_percent=14.2, above_good_sd=9.1)
FULL = misprint(LEFT)
SPOT = misprint(region(52.4, 12.0, 3.2, 4.1, "spots-voids", darker_percent=-31.0), score=7.04, threshold=2.0)


@pytest.mark.parametrize(
    ("verdict", "sheets", "language", "sentence"),
    [
        (FULL, span(13, 48, 60), "en",
         "Magenta 14 % too dark in a streak 3 mm wide along the left edge, on this and the last 12 sheets; "
         "seen 9 sigma above what 99 of 100 good sheets show"),
        (FULL, span(13, 48, 60), "de",
         "Magenta 14 % zu dunkel in einem Streifen von 3 mm Breite am linken Rand, auf diesem und den letzten 12 "
         "Bogen; 9 Sigma über dem, was 99 von 100 guten Bogen zeigen"),
        (SPOT, None, "en",
         "31 % too light in an area of 3.2 × 4.1 mm, 54 mm from the left edge, 14 mm from the lead edge; "
         "score 7.0, alarm above 2.0"),
        (SPOT, None, "de",
         "31 % zu hell auf einer Fläche von 3,2 × 4,1 mm, 54 mm vom linken Rand, 14 mm von der Vorderkante; "
         "Prüfwert 7,0, Alarm über 2,0"),
    ],
)  # fmt: skip
def test_whole_sentences(verdict: Verdict, sheets: SheetSpan | None, language: Code, sentence: str) -> None:
    assert describe(verdict, size_mm=A4, sheets=sheets, language=language).sentence == sentence


@pytest.mark.parametrize(
    ("box", "where"),
    [
        ((82.0, 0.0, 1.62, 297.0), "in a streak 1.6 mm wide, 83 mm from the left edge"),
        ((206.5, 0.0, 2.0, 297.0), "in a streak 2 mm wide along the right edge"),
        ((60.0, 20.0, 3.4, 75.0), "in a streak 3.4 mm wide, 62 mm from the left edge, between 20 and 95 mm from the "
         "lead edge"),
        ((0.0, 285.0, 210.0, 12.0), "in a band 12 mm high at the tail edge"),
        ((0.0, 0.0, 210.0, 5.0), "in a band 5 mm high at the lead edge"),
        ((30.0, 100.0, 60.0, 4.0), "in a band 4 mm high, 102 mm from the lead edge, between 30 and 90 mm from the left "
         "edge"),
        ((0.0, 0.0, 4.0, 4.0), "strongest in an area of 4 × 4 mm along the left edge, at the lead edge"),
        ((1.0, 1.0, 208.0, 290.0), "on the whole page"),
    ],
)  # fmt: skip
def test_places(box: tuple[float, float, float, float], where: str) -> None:
    assert describe(misprint(region(*box)), size_mm=A4).where == where


def test_without_the_page_s_size_no_right_and_no_tail_edge_is_named() -> None:
    assert describe(misprint(region(206.5, 0.0, 2.0, 297.0))).where.endswith("208 mm from the left edge")
    assert describe(misprint(region(0.0, 285.0, 210.0, 12.0))).where.endswith("291 mm from the lead edge")


@pytest.mark.parametrize(
    ("kind", "box", "shown"),
    [
        ("spots-voids", (82.0, 0.0, 3.4, 297.0), "streak"),
        ("spots-voids", (10.0, 50.0, 120.0, 3.0), "banding"),
        ("streak", (82.0, 20.0, 3.0, 4.0), "streak"),  # its strongest part
        ("streak", (0.0, 20.0, 210.0, 4.0), "banding"),
        ("streak", (82.0, 0.0, 1.0, 297.0), "streak"),
        ("spots-voids", (82.0, 20.0, 0.2, 6.0), "spots-voids"),  # a hair has any direction
        ("ghost-smear", (82.0, 0.0, 3.4, 297.0), "ghost-smear"),
        ("unknown", (82.0, 0.0, 3.4, 297.0), "deviation"),
    ],
)
def test_a_kind_that_names_a_shape_fits_it(
    kind: str, box: tuple[float, float, float, float], shown: str
) -> None:
    assert shown_kind(kind, region(*box), A4) == shown
    assert describe(misprint(region(*box), kind=kind), size_mm=A4).title == KINDS["en"][shown]


@pytest.mark.parametrize(
    ("sheets", "text"),
    [
        (span(1, 60, 60), "on this sheet"),
        (span(2, 59, 60), "on this and the last sheet"),
        (span(25, 12, 60), "on 25 of the last 49 sheets"),
        (span(25, 12, 60, shown=20), "on 25 sheets from 12 to 60"),
    ],
)
def test_sheets(sheets: SheetSpan, text: str) -> None:
    assert describe(FULL, sheets=sheets).sheets == text


@pytest.mark.parametrize(
    ("more", "what"),
    [
        ({"ink": "K", "darker_percent": -97.0}, "black missing"),
        ({"ink": "K", "darker_percent": -40.4}, "black 40 % too light"),
        ({"darker_percent": -640.0}, "much too light"),
        ({"darker_percent": 0.4}, "less than 1 % too dark"),
        ({"darker_percent": math.nan}, ""),
        ({"ink": "C"}, "cyan"),
        ({}, ""),
    ],
)
def test_amounts(more: dict[str, Any], what: str) -> None:
    assert describe(misprint(region(82.0, 0.0, 1.0, 297.0, **more)), size_mm=A4).what == what


def test_a_kind_that_an_amount_does_not_explain_is_named_with_it() -> None:
    ghost = misprint(region(20.0, 30.0, 20.0, 30.0, "ghost-smear", darker_percent=3.0))
    assert describe(ghost).brief.startswith("Ghost image or smear: 3 % too dark in an area")
    assert describe(ghost).place.startswith("3 % too dark in an area")
    swapped = misprint(region(0.0, 0.0, *A4, "swapped-planes"))
    assert describe(swapped, size_mm=A4).brief == "Inks exchanged on the whole page"
    assert describe(misprint(kind="unknown")).brief == KINDS["en"]["unknown"]
    unmeasured = misprint(region(82.0, 0.0, 1.0, 297.0))
    assert describe(unmeasured, size_mm=A4).brief.startswith(
        "Streak in print direction: in a streak 1 mm wide"
    )


def test_register_states_the_way_of_the_worst_ink_and_names_it_only_where_it_is_known() -> None:
    inks = {letter: Ink(gain_percent=0.0, dot_gain_percent=0.0, register_mm=(0.02, 0.0)) for letter in "CM"}
    inks["M"] = replace(inks["M"], register_mm=(-0.3, 0.4))
    off = misprint(region(0.0, 0.0, *A4, "plane-register", ink="M"), inks=inks)
    assert describe(off, size_mm=A4).what == (
        "magenta 0.50 mm out of register (0.30 mm to the left, 0.40 mm towards the tail)"
    )
    unnamed = replace(off, regions=(region(0.0, 0.0, *A4, "plane-register"),))
    assert describe(unnamed, size_mm=A4, language="de").place.startswith("Eine Farbe: Passerfehler 0,50 mm")


def test_no_register_is_stated_that_all_inks_have() -> None:
    """A plane that is far off may take the page's place with it, so that every other ink seems to be off."""
    inks = {
        letter: Ink(gain_percent=0.0, dot_gain_percent=0.0, register_mm=(0.0, down))
        for letter, down in zip("CMYK", (0.37, 0.41, 0.45, 0.43), strict=True)
    }
    off = misprint(region(106.0, 164.0, 0.8, 0.8, "plane-register"), inks=inks)
    assert describe(off, size_mm=A4).brief == "Ink out of register"


def test_of_what_changes_the_whole_print_no_place_is_named_unless_it_is_the_whole_page() -> None:
    dark = region(10.0, 20.0, 0.8, 0.8, "density", ink="K", darker_percent=15.0)
    assert describe(misprint(dark), size_mm=A4).brief == "Black 15 % too dark"
    bands = region(10.0, 20.0, 1.7, 1.7, "banding")
    assert describe(misprint(bands, dark), size_mm=A4).brief == "Bands across the page"
    assert describe(
        misprint(replace(dark, x_mm=0.0, y_mm=0.0, width_mm=210.0, height_mm=297.0)), size_mm=A4
    ).brief == ("Black 15 % too dark on the whole page")


def test_what_is_only_too_light_is_not_missing() -> None:
    light = region(10.0, 20.0, 8.0, 9.0, "missing-content", ink="C", darker_percent=-27.0)
    assert describe(misprint(light), size_mm=A4).brief.startswith(
        "Cyan 27 % too light in an area of 8 × 9 mm"
    )
    gone = replace(light, ink="", darker_percent=-98.0)
    assert describe(misprint(gone), size_mm=A4).brief.startswith(
        "Part of the page missing in an area of 8 × 9 mm"
    )


def test_an_ink_without_an_amount_follows_its_kind() -> None:
    spot = region(10.0, 20.0, 4.0, 4.0, "spots-voids", ink="M")
    assert describe(misprint(spot), size_mm=A4).brief.startswith(
        "Spots or voids: magenta in an area of 4 × 4 mm"
    )


def test_an_area_that_is_long_is_no_band() -> None:
    ghost = region(20.0, 40.0, 150.0, 20.0, "ghost-smear")
    assert describe(misprint(ghost), size_mm=A4).brief.startswith(
        "Ghost image or smear in an area of 150 × 20 mm"
    )


def test_what_no_amount_says_is_the_detector_s_reason_and_german_has_its_kind() -> None:
    wrong = misprint(region(0.0, 0.0, *A4, "wrong-page"), reason="the page lies +2.3 mm off its place")
    assert describe(wrong, size_mm=A4).place == "The page lies +2.3 mm off its place"
    assert (
        describe(wrong, size_mm=A4, language="de").brief
        == KINDS["de"]["wrong-page"] + " auf der ganzen Seite"
    )
    skipped = Verdict.skipped("p0001", "the scan is missing")
    assert describe(skipped).sentence == "The scan is missing"


def test_a_blank_sheet_is_called_so() -> None:
    blank = misprint(kind="missing-content", reason="it is blank")
    assert describe(blank, sheets=span(1, 60, 60)).sentence == "Blank sheet: on this sheet"
    assert describe(blank, language="de").sentence == "Unbedruckter Bogen"


def test_a_deviation_that_good_sheets_show_as_well_is_stated_by_the_score() -> None:
    weak = misprint(replace(LEFT, above_good_sd=-0.4), score=3.14, threshold=2.0)
    assert describe(weak).certainty == "score 3.1, alarm above 2.0"
    assert describe(misprint(replace(LEFT, above_good_sd=None))).certainty == ""


def test_both_languages_have_all_words_with_the_same_values() -> None:
    assert set(KINDS["en"]) == set(KINDS["de"])
    values = {
        code: {key: set(re.findall(r"{(\w+)}", text)) for key, text in TEXTS[code].items()} for code in TEXTS
    }
    assert values["en"] == values["de"]


@given(
    box=st.tuples(*[st.floats(-5, 300)] * 2, *[st.floats(0, 300)] * 2),
    percent=st.none() | st.floats(allow_nan=True),
    above=st.none() | st.floats(allow_nan=True),
    kind=st.sampled_from([*KINDS["en"], None, "of-a-package"]),
    language=st.sampled_from(["en", "de"]),
)
def test_every_region_has_a_sentence_without_raw_numbers(
    box: tuple[float, float, float, float], percent: float, above: float, kind: str | None, language: Code
) -> None:
    one = region(*box, darker_percent=percent, above_good_sd=above)
    text = describe(misprint(one, kind=kind), size_mm=A4, language=language)
    assert text.title
    assert text.detail[:1] == text.detail[:1].upper()
    assert not re.search(r"nan|inf\b|None|221\.4|\.\d{3}|{", text.sentence)

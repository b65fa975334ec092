"""Stored reasons in a reader's language: of this version, of earlier ones, and of none."""

from __future__ import annotations

import pytest

from prooflight.reporting.sentences import reason, reasons

LOST = "lines 7 to 1,900 were lost: parts of block 3 did not arrive"


@pytest.mark.parametrize(
    ("text", "english", "german"),
    [
        ("the page is missing", "the page is missing", "die Seite fehlt"),
        ("a misprint", "the sheet is a misprint", "der Bogen ist ein Fehldruck"),
        (
            "front: a misprint; it lies in the good tray",
            "front: the sheet is a misprint; the sheet is in the good tray",
            "Vorderseite: der Bogen ist ein Fehldruck; der Bogen liegt in der Gutablage",
        ),
        (
            f"lines lost: {LOST}; lines lost: about 90 lines from 4 on were lost: the camera was away for 3.1 s",
            f"{LOST}; about 90 lines from 4 on were lost: the camera was disconnected for 3.1 s",
            "Zeilen 7 bis 1\u202f900 gingen verloren: Teile von Block 3 kamen nicht an; "
            "etwa 90 Zeilen ab 4 gingen verloren: die Kamera war 3,1 s lang getrennt",
        ),
        ("the tray is full of tea", "the tray is full of tea", "the tray is full of tea"),
        ("", "", ""),
    ],
)
def test_a_reason_is_shown_in_both_languages_in_its_present_form(
    text: str, english: str, german: str
) -> None:
    assert (reason(text, "en"), reason(text, "de")) == (english, german)
    assert reason(english, "de") == german, "the present form has the same translation"


def test_every_row_has_the_same_values_in_all_its_forms_and_is_found_by_itself() -> None:
    table = reasons()
    for row in table.rows:
        english = row.texts["en"]
        names = {name for pattern in row.patterns for name in pattern.groupindex}
        values = {name: "7" if name[0] == "n" else "a spot" for name in names}
        shown = english.format(**values)
        assert table.of(shown, "en") == shown, english
        for pattern in row.patterns:
            assert set(pattern.groupindex) == names, english
        row.texts["de"].format(**values)


def test_only_a_sentence_that_is_known_throughout_is_contained() -> None:
    known = reasons().contains
    assert known("spot in cyan around x = 60 mm, y = 80 mm (3 x 3 mm)")
    assert not known("tea in cyan")
    assert not known("good; tea")

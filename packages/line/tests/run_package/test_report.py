"""The report of a run in PDF says what the journal says, in both languages, in the same bytes each time."""

from __future__ import annotations

import io
import string
from pathlib import Path

import pytest
from packages.line.tests.run_package.conftest import Packed

from prooflight_line.journal.journal import Journal
from prooflight_line.run_package.report import write_report
from prooflight_line.run_package.report_facts import report_facts
from prooflight_line.run_package.report_texts import TEXTS


def report_of(journal: Path, language: str) -> bytes:
    file = io.BytesIO()
    with Journal.open(str(journal), read_only=True) as opened:
        write_report(file, opened, opened.run(1), language=language)  # type: ignore[arg-type]
    return file.getvalue()


@pytest.mark.parametrize(
    ("language", "stated"),
    [
        (
            "en",
            (
                "Run report · Run 1",
                "Misprints",
                "in 1 incident",
                "misprint, Jörg",
                "too many sheets were waiting for inspection",
                "Page 1 of",
                "a font is missing",
            ),
        ),
        (
            "de",
            (
                "Laufbericht · Lauf 1",
                "Fehldrucke",
                "in 1 Ereignis",
                "Fehldruck, Jörg",
                "zu viele Bogen warteten auf die Prüfung",
                "Seite 1 von",
                "Unterschrift",
            ),
        ),
    ],
)
def test_a_report_states_the_run(journal_of_run: Path, language: str, stated: tuple[str, ...]) -> None:
    pymupdf = pytest.importorskip("pymupdf", reason="reads PDFs, an extra")
    content = report_of(journal_of_run, language)
    with pymupdf.open(stream=content) as document:
        text = "\n".join(page.get_text() for page in document)
        sizes = {(round(page.rect.width), round(page.rect.height)) for page in document}
        assert sum(len(page.get_images()) for page in document) == 1
    assert sizes == {(595, 842)}
    for one in (
        "\\u5de5 Ω <job> & Söhne.pdf",
        "seen on paper",
        "a remark",
        *stated,
    ):
        assert one in text.replace("\n", " ") or one in text, one
    assert report_of(journal_of_run, language) == content


def test_the_facts_are_those_of_the_journal(packed: Packed) -> None:
    with Journal.open(str(packed.journal), read_only=True) as journal:
        facts = report_facts(journal, journal.run(1))
    assert [one.sheet for one in facts.incidents] == [1]
    assert [label.by for label in facts.incidents[0].of_sheets] == ["Jörg"]
    assert [one.kind for one in facts.others] == ["not-inspected"]
    assert [sum(part[at] for part in facts.timeline) for at in range(3)] == [1, 1, 0]
    assert sum(facts.kinds.values()) == 1
    assert (facts.to_reprint, facts.gate, facts.gate_trouble) == (2, None, "")


def test_both_languages_have_the_same_texts_with_the_same_values() -> None:
    def fields(text: str) -> set[str | None]:
        return {field for _, field, _, _ in string.Formatter().parse(text)} - {None}

    assert TEXTS["en"].keys() == TEXTS["de"].keys()
    for key, text in TEXTS["en"].items():
        assert fields(text) == fields(TEXTS["de"][key]), key

"""Messages of the console in German: errors for people, and subjects of the audit trail."""

from __future__ import annotations

import pytest

from prooflight.errors import JobError, RequestError
from prooflight.reporting.sentences import Sentences
from prooflight_console.pages.language import language
from prooflight_console.problems import TITLES, TITLES_OF_KINDS


@pytest.mark.parametrize(
    ("text", "german"),
    [
        ("run 3 has no incident 7", "Lauf 3 hat kein Ereignis 7"),
        (
            "this requires the role operator; your role is viewer",
            "dafür ist die Rolle Bediener erforderlich; Ihre Rolle ist Betrachter",
        ),
        (
            str(RequestError("costs", "they are already in use", remedy="give other costs")),
            "diese Kosten sind schon in Verwendung; geben Sie andere an",
        ),
        (
            str(
                JobError(
                    "page 1",
                    "is 841.0 x 1189.0 mm",
                    remedy="this press sees 328.4 mm across; build a press with more pixels",
                )
            ),
            "Seite 1 ist 841,0 x 1189,0 mm groß, zu breit für diese Maschine; sie erfasst 328,4 mm in der Breite",
        ),
        ("cost: Input should be greater than 0.5", "cost: geben Sie mehr als 0,5 an"),
        (
            "30 pages learned (15 designs, 2 copies of each): by themselves they support no rate below one in 31 "
            "copies of these designs, and one in 16 pages of new designs",
            "30 Seiten gelernt (15 Entwürfe, je 2 Kopien): für sich allein belegen sie keine Rate unter einer von 31 "
            "Kopien dieser Entwürfe und einer von 16 Seiten neuer Entwürfe",
        ),
        ("run 1, incident 4", "Lauf 1, Ereignis 4"),
        ("menu-lunch.pdf", "menu-lunch.pdf"),
        ("a misprint", "der Bogen ist ein Fehldruck"),
    ],
)
def test_a_message_is_shown_in_german(text: str, german: str) -> None:
    assert language("de").sentence(text) == german


@pytest.mark.parametrize("text", [*TITLES.values(), *TITLES_OF_KINDS.values()])
def test_a_title_of_a_problem_has_a_german_form(text: str) -> None:
    assert language("de").sentence(text) != text


def test_every_message_has_the_same_values_in_both_languages() -> None:
    for row in Sentences.read("prooflight_console.pages", "languages/messages.json").rows:
        (names, *others) = (set(pattern.groupindex) for pattern in row.patterns)
        assert all(one == names for one in others), row.texts["en"]
        row.texts["de"].format(**dict.fromkeys(names, "7"))

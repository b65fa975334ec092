"""Before the first sheet the page Now states what it waits for, and for how long."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from packages.console.tests.consoles import served, write_run

from prooflight_console.accounts.roles import Role
from prooflight_line.journal.start import Start, StartFile

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("language", ["en", "de"])
def test_a_start_is_shown_with_its_stage_and_the_time_left(tmp_path: Path, language: str) -> None:
    console = served(tmp_path, run=False)
    start_file = StartFile(journal=console.journal)
    start_file.write(
        Start(stage="press", done=30, total=120, left_s=200.0, part="learning scatter, 5 designs")
    )
    client = console.client(Role.VIEWER)
    client.headers["Accept-Language"] = language
    shown = client.get("/").text
    words = {
        "en": ("The press is being built.", "30 of 120", "About 4 min left.", " (5 designs)"),
        "de": (
            "Die Maschine wird aufgebaut.",
            "30 von 120",
            "Noch etwa 4 min.",
            "Die Streuung der Drucke wird gelernt (5 Entwürfe)",
        ),
    }
    for word in words[language]:
        assert word in shown, word
    assert 'max="120" value="30"' in shown
    facts = client.get("/api/v1/now").json()
    assert (facts["state"], facts["start"]["stage"], facts["start"]["left_s"]) == ("waiting", "press", 200.0)
    console.close()


def test_an_earlier_run_is_not_shown_as_the_one_that_starts(tmp_path: Path) -> None:
    console = served(tmp_path, run=False)
    write_run(console.journal)
    StartFile(journal=console.journal).write(Start(stage="job"))
    assert console.client(Role.VIEWER).get("/api/v1/now").json()["state"] == "waiting"
    console.close()
    StartFile(journal=console.journal).clear()
    console = served(tmp_path, run=False)
    assert console.client(Role.VIEWER).get("/api/v1/now").json()["start"] is None
    console.close()

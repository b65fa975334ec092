"""``demo --zones`` is of the sample job in the press world, and its zones lie on the letter."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from prooflight.cli import run
from prooflight.cli.jobs.demo_zones import zones_of_letter

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("more", [["--job", "mine.pdf"], ["--world", "ideal"]])
def test_zones_of_another_job_or_world_are_refused_in_one_line(
    more: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["demo", "--zones", "--out", str(tmp_path / "out"), *more]) == 2
    told = capsys.readouterr().err
    assert "demo --zones: zones are shown on the sample job, in the press world; leave --job" in told
    assert len(told.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_the_letter_has_a_careful_address_and_an_ignored_stamp() -> None:
    zones = zones_of_letter(2, [(210.0, 297.0)] * 3)
    assert {
        number: [(one.name, one.kind) for one in of_page] for number, of_page in zones.of_pages.items()
    } == {2: [("address", "careful"), ("stamp", "ignore")]}

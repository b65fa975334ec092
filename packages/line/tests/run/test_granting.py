"""A proposed tolerance becomes a zone of its job, and goes again."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from prooflight.cli import run
from prooflight.errors import RequestError
from prooflight.pages.files import write_tiff
from prooflight.pages.zones.zones_file import JobZones, ZoneEntry
from prooflight_line.cli.runs import feedback
from prooflight_line.run import tolerances
from prooflight_line.run.tolerances import Proposal, granted, with_zone

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.pages.raster import Page

SIZES = [(100.0, 140.0)] * 3
PROPOSED = Proposal(
    kind="streak",
    box_mm=(30.2, 40.0, 2.0, 60.0),
    where="at x = 31 mm",
    pages=("p0001", "p0003", "p0003-2"),
    runs=(1,),
    sheets=6,
    up_to_score=9.0,
    misprints_lost=1,
    misprints_kept=2,
    untold=0,
)


def test_a_zone_lies_about_its_place_on_its_pages() -> None:
    entry = granted(PROPOSED, SIZES)
    assert (entry.kind, entry.pages, entry.rectangle_mm) == ("ignore", "1,3", (29.2, 39.0, 4.0, 62.0))
    at_edge = granted(replace(PROPOSED, box_mm=(0.2, 100.0, 2.0, 60.0)), SIZES)
    assert at_edge.rectangle_mm == (0.0, 99.0, 3.2, 41.0)
    assert set(JobZones.create([entry], SIZES).of_pages) == {1, 3}


@pytest.mark.parametrize("pages", [("p0004",), ("s0001-front",), ("p0000",)])
def test_pages_of_another_job_are_refused(pages: tuple[str, ...]) -> None:
    with pytest.raises(RequestError, match="is not a page of this job"):
        granted(replace(PROPOSED, pages=pages), SIZES)


def test_it_is_granted_once_and_leaves_the_others_as_they_were() -> None:
    face = ZoneEntry(name="face", kind="careful", rectangle_mm=(1.0, 1.0, 9.0, 9.0))
    entry, known = granted(PROPOSED, SIZES), JobZones.create([face], SIZES)
    both = JobZones.create(with_zone(known, entry), SIZES)
    with pytest.raises(RequestError, match="granted already"):
        with_zone(both, entry)
    assert both.without(entry.name) == (face,)
    assert JobZones.create(both.without(entry.name), SIZES).zones_digest == known.zones_digest
    with pytest.raises(RequestError, match="'face'"):
        known.without("faces")


def test_as_a_user_calls_it(
    make_page: Callable[..., Page],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The journal's proposals are stated; the file is not in force before its price was saved."""
    job, zones = tmp_path / "p0001.tif", tmp_path / "job.zones.json"
    write_tiff(make_page(2, number=1), job)
    found = replace(PROPOSED, box_mm=(10.0, 10.0, 2.0, 5.0), pages=("p0001",))

    class Nothing:
        path = tmp_path

        def __enter__(self) -> Any:
            return self

        def __exit__(self, *_: object) -> None: ...

        def runs(self, **_: Any) -> list[Any]:
            return []

    monkeypatch.setattr(feedback, "reading", lambda _: Nothing())
    monkeypatch.setattr(tolerances, "proposals", lambda *_: [found])
    grant = ["run", "tolerances", "--grant", "1", "--zones", str(zones), "--job", str(job)]
    assert run([*grant, "--json"]) == 0
    name = json.loads(capsys.readouterr().out)["granted"]["name"]
    assert "price" not in json.loads(zones.read_text())
    assert run(grant) == 2
    assert "granted already" in capsys.readouterr().err
    assert run(["run", "tolerances", "--grant", "2", *grant[4:]]) == 2
    assert "there is 1 proposal" in capsys.readouterr().err
    assert run(["run", "tolerances", "--grant", "1"]) == 2
    assert run(["zones", "drop", str(zones), str(job), name]) == 0
    assert not zones.exists()

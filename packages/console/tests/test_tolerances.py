"""Tolerances for programs: proposed by false alarms of the job's own runs, each with the zone that grants it."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from packages.console.tests.test_zones import ended, job_of
from packages.console.tests.zone_prices import priced_by, quick
from packages.line.tests.journal.sample_rows import facts, good, misprint

from prooflight.detectors.verdict import Region
from prooflight.files.content import content_digest
from prooflight_console.accounts.roles import Role
from prooflight_line.journal.journal import Journal

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from packages.console.tests.consoles import Served

    from prooflight.press.artefact import Press

AT = "/api/v1/jobs/1/tolerances"
PLACE_MM = [54.0, 54.0, 3.0, 3.0]
EVERY = 6
"""Sheets from one misprint to the next: each is an incident of its own place."""


def alarms(journal: Path, *, job_digest: str) -> int:
    """A run whose six misprints lie at one place of its page."""
    with Journal.open(str(journal)) as opened:
        run = opened.begin_run(facts(job_digest=job_digest))
        for sheet in range(6 * EVERY):
            page = misprint(sheet) if sheet % EVERY == 0 else good(sheet)
            verdict = replace(page.verdict, page="p0001")
            if sheet % EVERY == 0:
                x, y, width, height = PLACE_MM
                place = Region(
                    x_mm=x, y_mm=y, width_mm=width, height_mm=height, score=9.0, kind="spots-voids"
                )
                verdict = replace(verdict, regions=(place,))
            opened.record(run, replace(page, verdict=verdict))
        opened.commit()
        return run


@pytest.fixture
def desk(tmp_path: Path, trained_press: Press) -> Iterator[Served]:
    """A console on a run of that job and one of another, whose alarms an operator called false."""
    job, artefact = job_of(tmp_path), tmp_path / "my.press"
    trained_press.save(artefact)
    console = priced_by(tmp_path, quick, jobs=(job,), presses=(artefact,), run=False)
    with closing(console):
        operator = console.client(Role.OPERATOR)
        for run, digest in enumerate((content_digest(job), "another"), start=1):
            assert alarms(console.journal, job_digest=digest) == run
            for sheet in range(0, 6 * EVERY, EVERY):
                said = operator.post(
                    f"/api/v1/runs/{run}/sheets/{sheet}/labels", json={"label": "false-alarm"}
                )
                assert said.status_code == 201
        yield console


def test_false_alarms_of_the_jobs_own_runs_propose_a_zone_that_can_be_saved(desk: Served) -> None:
    engineer = desk.client(Role.ENGINEER)
    (one,) = desk.client(Role.VIEWER).get(AT).json()["items"]
    assert (one["runs"], one["sheets"], one["pages"], one["box_mm"]) == ([1], 6, ["p0001"], PLACE_MM)
    assert one["zone"]["rectangle_mm"] == [53.0, 53.0, 5.0, 5.0]
    assert (one["granted"], one["trouble"]) == (False, "")
    assert engineer.get("/api/v1/jobs/2/tolerances").status_code == 404

    body = {"zones": [one["zone"]]}
    asked = engineer.post("/api/v1/jobs/1/zones/prices", json=body)
    assert asked.status_code == 202, asked.text
    assert ended(engineer, asked.json())["state"] == "done"
    tag = {"If-Match": engineer.get("/api/v1/jobs/1/zones").headers["ETag"]}
    saved = engineer.put("/api/v1/jobs/1/zones", json=body, headers=tag)
    assert (saved.status_code, saved.json()["in_force"], saved.json()["zones"]) == (200, True, [one["zone"]])
    assert engineer.get(AT).json()["items"][0]["granted"]

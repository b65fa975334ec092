"""Tolerances for programs: proposed by false alarms, granted with a price of exactly that, taken back, audited."""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from packages.console.tests.test_zones import ended, job_of, zones
from packages.console.tests.zone_prices import priced_by, quick
from packages.line.tests.journal.sample_rows import facts, good, misprint

from prooflight.detectors.verdict import Region
from prooflight.files.content import content_digest
from prooflight_console.accounts.roles import Role, Scope
from prooflight_line.journal.journal import Journal

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from packages.console.tests.consoles import Served
    from starlette.testclient import TestClient

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
                said = operator.post(f"/api/v1/runs/{run}/sheets/{sheet}/words", json={"word": "false-alarm"})
                assert said.status_code == 201
        yield console


def state(client: TestClient) -> tuple[dict[str, Any], dict[str, str]]:
    """What is told, and the header by which it is changed."""
    answer = client.get(AT)
    assert answer.status_code == 200, answer.text
    return answer.json(), {"If-Match": answer.headers["ETag"]}


def priced(client: TestClient, **change: str) -> dict[str, Any]:
    asked = client.post(f"{AT}/prices", json=change)
    assert asked.status_code == 202, asked.text
    price = ended(client, asked.json())
    assert price["state"] == "done", price["why"]
    return price


def test_false_alarms_of_the_jobs_own_runs_propose(desk: Served) -> None:
    told, _ = state(desk.client(Role.VIEWER))
    (one,) = told["proposed"]
    assert (one["runs"], one["sheets"], one["pages"], one["box_mm"]) == ([1], 6, ["p0001"], PLACE_MM)
    assert one["zone"]["rectangle_mm"] == [53.0, 53.0, 5.0, 5.0]
    assert (one["granted"], one["trouble"], told["granted"], told["in_force"]) == (False, "", [], False)


def test_a_tolerance_is_granted_with_its_price_alone_and_taken_back(desk: Served, tmp_path: Path) -> None:
    file = tmp_path / "letter.zones.json"
    engineer = desk.client(Role.ENGINEER)
    told, tag = state(engineer)
    (one,) = told["proposed"]
    body = {"proposal": one["id"]}
    assert engineer.post(AT, json=body).status_code == 428
    unpriced = engineer.post(AT, json=body, headers=tag)
    assert (unpriced.status_code, unpriced.json()["type"]) == (409, "urn:prooflight:unpriced")
    assert not file.exists()

    price = priced(engineer, grant=one["id"])
    assert [row["name"] for row in price["price"]["zones"]] == [one["zone"]["name"], "rest"]
    saved = engineer.post(AT, json=body, headers=tag)
    assert saved.status_code == 201, saved.text
    assert (saved.json()["in_force"], saved.json()["zones"]) == (True, [one["zone"]])
    told, now = state(engineer)
    assert (told["granted"], told["in_force"], told["proposed"][0]["granted"]) == ([one["zone"]], True, True)
    assert engineer.post(AT, json=body, headers=now).status_code == 409, "granted already"
    assert engineer.delete(f"{AT}/{one['zone']['name']}", headers=tag).status_code == 412

    last = engineer.post(f"{AT}/prices", json={"drop": one["zone"]["name"]})
    assert last.json()["type"] == "urn:prooflight:no-price"
    assert engineer.delete(f"{AT}/{one['zone']['name']}", headers=now).status_code == 200
    assert not file.exists()
    dropped, granted = desk.accounts.audited(limit=2)
    assert [(row.who, row.what, row.target) for row in (granted, dropped)] == [
        ("engineer", "tolerances.grant", file.name),
        ("engineer", "tolerances.drop", file.name),
    ]
    after = json.loads(granted.after or "")
    assert after["tolerance"] == one["zone"]["name"]
    assert any("0 told misprints there would have passed" in line for line in after["proposed"])
    assert json.loads(dropped.after or "")["zones"] == []
    assert desk.accounts.verified().whole
    audit = desk.client(Role.ADMIN).get("/setup/audit", headers={"Accept-Language": "en"}).text
    assert "granted a tolerance" in audit
    assert "revoked a tolerance" in audit


def test_other_zones_stay_and_are_priced_again(desk: Served, tmp_path: Path) -> None:
    zones("face").save(tmp_path / "letter.zones.json")
    engineer = desk.client(Role.ENGINEER)
    told, tag = state(engineer)
    (one,) = told["proposed"]
    assert told["granted"] == [], "a zone that somebody drew is no tolerance"
    assert engineer.delete(f"{AT}/stamp", headers=tag).status_code == 404
    priced(engineer, grant=one["id"])
    saved = engineer.post(AT, json={"proposal": one["id"]}, headers=tag)
    names = [zone["name"] for zone in saved.json()["zones"]]
    assert names == ["face", "stamp", one["zone"]["name"]]
    now = {"If-Match": saved.headers["ETag"]}
    path = f"{AT}/{one['zone']['name']}"
    assert engineer.delete(path, headers=now).json()["type"] == "urn:prooflight:unpriced"
    priced(engineer, drop=one["zone"]["name"])
    left = engineer.delete(path, headers=now)
    assert [zone["name"] for zone in left.json()["zones"]] == ["face", "stamp"]
    assert left.json()["in_force"]


def test_a_file_of_zones_that_cannot_be_read_is_not_written_over(desk: Served, tmp_path: Path) -> None:
    file = tmp_path / "letter.zones.json"
    file.write_text('{"zones": [')
    engineer = desk.client(Role.ENGINEER)
    told, tag = state(engineer)
    answer = engineer.post(AT, json={"proposal": told["proposed"][0]["id"]}, headers=tag)
    assert (answer.status_code, "is not JSON" in answer.text) == (409, True)
    assert file.read_text() == '{"zones": ['


def test_what_is_not_proposed_or_not_said_is_refused(desk: Served) -> None:
    engineer = desk.client(Role.ENGINEER)
    _, tag = state(engineer)
    assert engineer.post(AT, json={"proposal": "0" * 16}, headers=tag).status_code == 404
    assert engineer.post(f"{AT}/prices", json={"grant": "0" * 16}).status_code == 404
    both = engineer.post(f"{AT}/prices", json={"grant": "0" * 16, "drop": "x"})
    assert (both.status_code, "not both" in both.text) == (422, True)
    assert engineer.post(f"{AT}/prices", json={}).status_code == 422
    assert engineer.get("/api/v1/jobs/2/tolerances").status_code == 404


def test_only_engineers_and_tokens_of_that_scope_change_them(desk: Served) -> None:
    viewer, operator, nobody = desk.client(Role.VIEWER), desk.client(Role.OPERATOR), desk.client()
    told, tag = state(viewer)
    body = {"proposal": told["proposed"][0]["id"]}
    for client, code in ((operator, 403), (viewer, 403), (nobody, 401)):
        assert client.post(AT, json=body, headers=tag).status_code == code
        assert client.post(f"{AT}/prices", json={"grant": body["proposal"]}).status_code == code
        assert client.delete(f"{AT}/x", headers=tag).status_code == code
    desk.client(Role.ENGINEER)
    for scope, code in ((Scope.READ, 403), (Scope.ZONES, 202)):
        secret = desk.accounts.new_token("engineer", scope.value, [scope], by="test")[1]
        program = {"Authorization": f"Bearer {secret}"}
        asked = nobody.post(f"{AT}/prices", json={"grant": body["proposal"]}, headers=program)
        assert asked.status_code == code

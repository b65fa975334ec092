"""A run is stopped from the console by those who may, and the request names the run and the person."""

from __future__ import annotations

from typing import TYPE_CHECKING

from packages.console.tests.consoles import served, write_run
from packages.line.tests.journal.sample_rows import facts

from prooflight_console.accounts.roles import Role, Scope
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.labels import run_key
from prooflight_line.journal.run_control import RunControl

if TYPE_CHECKING:
    from pathlib import Path


def test_a_run_that_goes_on_is_stopped_by_those_who_may(tmp_path: Path) -> None:
    console = served(tmp_path, run=False)
    write_run(console.journal)
    control = RunControl(journal=console.journal)
    with Journal.open(str(console.journal)) as journal:  # whoever watches holds it
        key = run_key(journal.run(journal.begin_run(facts(started_s=2_000.0))))
        operator, viewer = console.client(Role.OPERATOR), console.client(Role.VIEWER)
        assert "Stop run 2 now" in operator.get("/").text
        assert "Stop run 2 now" not in viewer.get("/").text
        assert viewer.post("/runs/2/stop").status_code == 403
        program = console.client()
        for scope, status in ((Scope.LABELS, 403), (Scope.JOBS, 202)):
            token = console.accounts.new_token("operator", scope.value, [scope], by="test")[1]
            headers = {"Authorization": f"Bearer {token}"}
            assert program.post("/api/v1/runs/2/stop", headers=headers).status_code == status
        request = control.stop_request(key)
        assert request is not None
        assert request.by == "operator"
        assert operator.post("/runs/last/stop").status_code == 204
        console.clock.now_s += 2
        console.console.live._poll()
        shown = operator.get("/").text
        assert "operator stopped this run." in shown
        assert "Stop run 2 now" not in shown
        assert viewer.get("/api/v1/now").json()["stopping"] == "operator"
    answer = operator.post("/api/v1/runs/1/stop")
    assert (answer.status_code, "has ended already" in answer.json()["detail"]) == (409, True)
    rows = [one for one in console.accounts.audited() if one.what == "run.stop"]
    assert [(one.who, one.target) for one in rows] == [("operator", "run 2@2000, catalogue")] * 2
    console.close()

"""Requests to start and stop runs: each for one run or job, and none that a killed process left counts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from prooflight.errors import RequestError
from prooflight_line.journal.run_control import START, STOP, RunControl, Starter

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def control(tmp_path: Path) -> RunControl:
    return RunControl(journal=tmp_path / "j.sqlite", clock=lambda: 5.0)


def test_a_stop_is_for_one_run_and_ends_with_it(control: RunControl) -> None:
    control.stop("3@1000", by="Ann")
    request = control.stop_request("3@1000")
    assert request is not None
    assert (request.by, request.at_s) == ("Ann", 5.0)
    assert control.stop_request("4@2000") is None
    with control.stoppable():  # as of a run that is resumed: it has the same key
        assert control.stop_request("3@1000") is None
        control.stop("3@1000", by="Ann")
        assert control.stop_request("3@1000") is not None
    assert list(control.journal.parent.iterdir()) == []


def test_a_start_is_taken_once_and_none_counts_from_before(control: RunControl) -> None:
    assert control.starter is None
    control.start("000001-1f0a9c44b3de", by="Ann")
    with control.starting(Starter(folder="/jobs")):
        assert control.start_request() is None, "it was asked for before anything waited"
        control.start("000002-1f0a9c44b3de", by="Ann")
        request = control.start_request()
        assert request is not None
        assert request.of == "000002-1f0a9c44b3de"
        assert control.start_request() is None
        assert control.starter == Starter(folder="/jobs")
        with pytest.raises(RequestError, match="end the other"), control.starting(Starter(folder="/jobs")):
            pass
        failing = Starter(folder="/jobs", job="000002-1f0a9c44b3de")
        with pytest.raises(RequestError), control.trouble_noted(failing):
            raise RequestError("camera", "does not answer", remedy="switch it on")
        assert control.starter is not None
        assert control.starter.trouble == "camera: does not answer; switch it on"
    assert control.starter is None


@pytest.mark.parametrize(
    "content", ["", "{", "[]", "null", '{"of": 1}', '{"of": "3@1000", "by": 7, "at_s": "x"}']
)
def test_a_file_that_is_no_request_asks_for_nothing(control: RunControl, content: str) -> None:
    for suffix in (STOP, START):
        control.journal.with_name(control.journal.name + suffix).write_text(content)
    assert control.stop_request("3@1000") is None
    assert control.start_request() is None

"""The log for programs: one JSON object a line, and lines for people again when the command has ended."""

from __future__ import annotations

import json
import logging

import pytest

from prooflight.cli import event_log, faults, show


def lines(capsys: pytest.CaptureFixture[str]) -> list[dict[str, object]]:
    captured = capsys.readouterr()
    assert captured.out == ""
    return [json.loads(line) for line in captured.err.splitlines()]


def test_what_people_would_read_is_logged_instead(capsys: pytest.CaptureFixture[str]) -> None:
    with faults.logged(["watch"]) as log:
        event_log.begin("json")
        show.people.print("for people")
        show.step("for people")
        faults.report("a disk is full")
        log.warning("design %s was not stored", 3)
        logging.getLogger("another.library").error("it broke")
        try:
            [].index(1)
        except ValueError:
            log.exception("this is a fault")
    report, own, other, fault = lines(capsys)
    assert (report["event"], report["level"], report["text"]) == ("report", "warning", "a disk is full")
    assert (own["event"], own["logger"], own["text"]) == ("log", "prooflight", "design 3 was not stored")
    assert (other["logger"], other["level"]) == ("another.library", "error")
    assert "ValueError: 1 is not in list" in str(fault["exception"])
    faults.report("for people again")
    assert capsys.readouterr().err == "prooflight: for people again\n"


def test_numbers_that_json_has_not_are_texts_and_fields_are_added(capsys: pytest.CaptureFixture[str]) -> None:
    with faults.logged([]):
        event_log.begin("json")
        with event_log.added(request="7"):
            event_log.write("sheet", score=float("nan"), deep={"a": [float("inf")]})
        event_log.write("sheet")
    inside, outside = lines(capsys)
    assert (inside["request"], inside["score"], inside["deep"]) == ("7", "nan", {"a": ["inf"]})
    assert "request" not in outside


def test_nothing_is_written_where_people_read(capsys: pytest.CaptureFixture[str]) -> None:
    with faults.logged([]):
        event_log.begin("text")
        assert not event_log.write("sheet")
    assert lines(capsys) == []

"""The stream of events: what is said when, in what order, and in the JSON of its schema."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path

import jsonschema_rs
import numpy as np
import pytest
from docs.generators.plant import pages
from packages.line.tests.plant.runs import FACTS, GOOD, MISPRINT, STREAK, Heard, outcome, random_outcome

from prooflight.detectors.verdict import Verdict
from prooflight.pages.layout.layout import Layout
from prooflight.pages.layout.plan import SheetPlan
from prooflight_line.plant.events import (
    BODIES,
    KINDS,
    Event,
    EventsLost,
    SheetAtGate,
    StateChanged,
    parsed,
    schema,
)
from prooflight_line.plant.stream import EventStream
from prooflight_line.run.notices import Notice

DOCS = Path(__file__).resolve().parents[4] / "docs" / "reference"
VALID = jsonschema_rs.validator_for(schema())


def stream(*listeners: Heard) -> EventStream:
    return EventStream(listeners, press="rig", run=3, size_mm=(210.0, 297.0), stream="s", clock=lambda: 1e9)


AT_GATE = SheetAtGate(
    sheet=9, page="p0010", disposition="accept", code="too-late", in_time=False, tray="unconfirmed"
)


def whole_run(heard: Heard) -> list[Event]:
    """Good sheets, a streak of 40, a page that did not come, a camera that went away, and the end."""
    told = stream(heard)
    told.started(FACTS)
    told.state("press", "inspecting")
    told.state("press", "inspecting")
    for n in range(10):
        told.observe(outcome(n))
    told.noticed(Notice(kind="camera-away", text="the camera does not answer"))
    told.noticed(Notice(kind="camera-back", text="the camera is back after 3 s"))
    for n in range(10, 50):
        told.observe(outcome(n, MISPRINT))
    told.observe(
        outcome(50, Verdict.skipped("p0051", "it was not detected"), came=False, faults=("missing",))
    )
    told.observe(outcome(51, replace(GOOD, promise_suspended=True), late=True))
    told.ended("finished")
    return heard.all


def test_a_run_from_its_start_to_its_end() -> None:
    events = whole_run(Heard())
    assert [event.number for event in events] == list(range(1, len(events) + 1))
    assert {(event.stream, event.press, event.run, event.time_s) for event in events} == {
        ("s", "rig", 3, 1e9)
    }
    kinds = [event.kind for event in events]
    assert kinds[:2] == ["run-started", "state-changed"]
    assert kinds[12:16] == ["notice", "state-changed"] * 2
    assert kinds[16:20] == ["sheet-judged", "incident-opened", "sheet-judged", "incident-changed"]
    assert kinds[-1] == "run-ended"
    assert kinds.count("sheet-judged") == 52
    # A streak of 40 sheets: it opens, doubles five times (2, 4, 8, 16, 32), ends; two more incidents open and end.
    counts = [kinds.count(f"incident-{what}") for what in ("opened", "changed", "ended")]
    assert counts == [3, 5, 3]
    assert events[-1].body.counts == {
        "good": 11,
        "misprint": 40,
        "not-inspected": 0,
        "late": 1,
        "incidents": 3,
    }
    states = [(event.body.of, event.body.state) for event in events if isinstance(event.body, StateChanged)]
    assert states == [("press", "inspecting"), ("camera", "away"), ("camera", "delivering")]


def test_a_side_says_of_which_sheet_and_set_it_is() -> None:
    """Five pages, two up on both sides: of the second sheet half the front and the back stay blank."""
    layout = Layout.parse("sides=2,n-up=2x1,order=loop:2,pages-a-set=8").of(5)
    heard, plan = Heard(), SheetPlan(layout=layout, sides=4, sheets=4)
    told = EventStream([heard], press="rig", plan=plan, stream="s", clock=lambda: 1e9)
    for n in range(8):
        told.observe(outcome(n))
    told.observe(outcome(8, job_page=None))
    *sides, nowhere = heard.all
    assert nowhere.body.on_sheet is None
    said = [event.body.on_sheet for event in sides]
    assert [(one.sheet, one.side, one.last_side) for one in said] == [
        (0, "front", False), (1, "front", False), (0, "back", True), (2, "front", False),
        (1, "back", True), (3, "front", False), (2, "back", True), (3, "back", True),
    ]  # fmt: skip
    assert [one.pages for one in said] == [(1, 2), (5,), (3, 4), (1, 2), (), (5,), (3, 4), ()]
    assert (said[4].name, said[4].copy, said[4].set) == ("s0002", 1, 0)
    assert (said[7].name, said[7].copy, said[7].set) == ("s0002", 2, 1)
    for event in heard.all:
        VALID.validate(json.loads(event.json()))
        assert parsed(event.json()) == event
        earlier = json.loads(event.json())
        del earlier["body"]["on_sheet"]
        assert parsed(json.dumps(earlier)).body == replace(event.body, on_sheet=None)


def test_a_sheet_names_the_incident_that_it_belongs_to() -> None:
    sheets = [event.body for event in whole_run(Heard()) if event.kind == "sheet-judged"]
    assert [sheet.incident for sheet in sheets] == [None] * 10 + [1] * 40 + [2, 3]
    assert [sheet.sheet for sheet in sheets] == list(range(52))
    streak = sheets[10]
    assert (streak.kind, streak.places[0].box.x_mm, streak.places[0].score) == ("streak", 119.5, 9.0)
    assert (streak.shift_x_mm, streak.inks[0].register_y_mm, streak.latency_ms) == (0.12, -0.02, 12.3)


def test_events_are_of_the_published_schema_and_come_back_the_same() -> None:
    events = whole_run(Heard())
    more = [replace(events[0], body=body) for body in (EventsLost(count=4, first=3, last=6), AT_GATE)]
    assert {event.kind for event in [*events, *more]} == set(KINDS)
    for event in [*events, *more]:
        VALID.validate(json.loads(event.json()))
        assert parsed(event.json()) == event
        assert event.key == f"s-{event.number}"


def test_whatever_a_verdict_holds_is_of_the_schema() -> None:
    heard, rng = Heard(), np.random.default_rng(25)
    told = stream(heard)
    for n in range(200):
        told.observe(random_outcome(n, rng))
    far = replace(STREAK, score=float("inf"))
    nowhere = replace(STREAK, x_mm=float("nan"))
    told.observe(
        outcome(200, replace(MISPRINT, regions=(far, nowhere), score=float("nan"), shift_mm=(np.inf, 0.0)))
    )
    sheet = json.loads(next(event for event in heard.all[::-1] if event.kind == "sheet-judged").json())[
        "body"
    ]
    assert (sheet["score"], sheet["shift_x_mm"], [p["score"] for p in sheet["places"]]) == (
        None,
        None,
        [None],
    )
    for event in heard.all:
        VALID.validate(json.loads(event.json()))


@pytest.mark.parametrize(
    ("name", "value"), [("number", "1"), ("body", {"event": "unheard-of"}), ("run", None)]
)
def test_the_schema_refuses_what_is_no_event(name: str, value: object) -> None:
    raw = json.loads(whole_run(Heard())[0].json())
    VALID.validate(raw)
    raw[name] = value
    assert VALID.is_valid(raw) == (name == "run")


def test_every_field_of_the_schema_is_required_and_explained() -> None:
    for body in BODIES:
        part = schema()["$defs"][body.__name__]
        assert part["required"] == [field.name for field in fields(body)]
        assert part["description"]


@pytest.mark.parametrize("name", sorted(pages()))
def test_the_reference_is_the_code_s(name: str) -> None:
    written = (DOCS / name).read_text(encoding="utf-8")
    assert written == pages()[name], "run `python -m docs.generators.plant`"

"""Queues and threads of outlets: order, bounds, loss that is told, an end in time; and nobody who puts ever waits."""

from __future__ import annotations

import asyncio
import threading
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st
from packages.line.tests.plant.runs import LONGEST_S, Heard, event

from prooflight_line.plant.events import Event, EventsLost
from prooflight_line.plant.outlets.outbox import Outbox, OutletHealth
from prooflight_line.plant.outlets.outlet import Outlets, check

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable


@dataclass
class Taken:
    """An outlet that hands events to a list."""

    name: str = "list"
    heard: Heard = field(default_factory=Heard)
    before: Callable[[Event], Awaitable[None]] | None = None

    async def run(self, outbox: Outbox) -> None:
        outbox.up("a list")
        while (one := await outbox.head()) is not None:
            if self.before is not None:
                await self.before(one)
            self.heard(one)
            outbox.delivered(one)

    async def reach(self) -> str:
        return "a list"


class Held:
    """Holds an outlet back until a test lets it go on."""

    def __init__(self) -> None:
        self.reached, self.go = threading.Event(), threading.Event()

    async def __call__(self, _: Event) -> None:
        self.reached.set()
        await asyncio.get_running_loop().run_in_executor(None, self.go.wait)


def numbers(events: list[Event]) -> list[int]:
    return [one.number for one in events]


def test_events_come_in_order_and_all_of_them_before_the_end() -> None:
    one, other = Taken(), Taken("other")
    with Outlets([one, other], close_s=LONGEST_S) as outlets:
        for n in range(1, 2001):
            outlets.put(event(n))
    assert numbers(one.heard.all) == numbers(other.heard.all) == list(range(1, 2001))
    assert not outlets.given_up
    assert [(health.delivered, health.lost, health.waiting) for health in outlets.health] == [
        (2000, 0, 0)
    ] * 2


def test_an_outlet_that_hangs_holds_nobody_up_and_says_what_it_lost() -> None:
    """What is being delivered stays, the oldest behind it go, and one event in their place says which."""
    held = Held()
    slow, quick = Taken("slow", before=held), Taken("quick")
    with Outlets([slow, quick], room=10, close_s=LONGEST_S) as outlets:
        outlets.put(event(1))
        assert held.reached.wait(LONGEST_S)
        for n in range(2, 101):
            outlets.put(event(n))
            quick.heard.count(n)
        assert slow.heard.all == []
        assert outlets.health[0].lost == 90
        held.go.set()
    assert numbers(quick.heard.all) == list(range(1, 101))
    assert numbers(slow.heard.all) == [1, 91, *range(92, 101)]
    assert slow.heard.all[1].body == EventsLost(count=90, first=2, last=91)


@given(
    st.lists(st.sampled_from(["put", "take", "deliver"]), max_size=80), st.integers(1, 6), st.integers(1, 4)
)
def test_nothing_is_lost_untold(steps: list[str], room: int, at_once: int) -> None:
    """Whatever comes in turn, numbers that arrive or are told as lost go up without a gap."""

    async def told() -> tuple[list[Event], int]:
        outbox, put, arrived = Outbox("x", room=room), 0, list[Event]()
        outbox.attach()
        held: list[Event] = []
        for step in steps:
            if step == "put":
                put += 1
                outbox.put(event(put))
            elif step == "take" and not held and outbox.health.waiting:
                held = await outbox.heads(at_once)
                assert 1 <= len(held) <= at_once
            elif step == "deliver" and held:
                outbox.delivered(held[0])
                arrived.append(held.pop(0))
            assert outbox.health.waiting <= room + at_once + 1
        outbox.close()
        while (one := await outbox.head()) is not None:
            arrived.append(one)
            outbox.delivered(one)
        assert outbox.health.delivered == len(arrived)
        return arrived, outbox.health.lost

    arrived, lost = asyncio.run(told())
    next_number, gone = 1, 0
    for one in arrived:
        first, count = (
            (one.body.first, one.body.count) if isinstance(one.body, EventsLost) else (one.number, 1)
        )
        assert first == next_number
        assert one.number == first + count - 1
        next_number = one.number + 1
        gone += isinstance(one.body, EventsLost) and count
    assert next_number == 1 + steps.count("put")
    assert gone == lost


def test_an_outlet_that_breaks_off_is_started_again_with_the_same_event() -> None:
    tries = Heard()

    async def break_twice(one: Event) -> None:
        tries(one.number)
        if one.number == 2 and tries.all.count(2) < 3:
            raise ConnectionResetError("the broker went away")

    taken, said = Taken(before=break_twice), Heard()
    with Outlets([taken], changed=said, pauses_s=(0.001, 0.002)) as outlets:
        for n in (1, 2, 3):
            outlets.put(event(n))
        taken.heard.count(3)
    assert numbers(taken.heard.all) == [1, 2, 3]
    assert tries.all == [1, 2, 2, 2, 3]
    assert [(one.connected, one.detail) for one in said.all] == [
        (True, "a list"),
        *[(False, "the broker went away"), (True, "a list")] * 2,
    ]


def test_an_event_that_breaks_its_outlet_does_not_keep_the_others() -> None:
    async def broken(one: Event) -> None:
        if one.number == 2 and not isinstance(one.body, EventsLost):
            raise ZeroDivisionError

    taken = Taken(before=broken)
    with Outlets([taken], pauses_s=(0.001, 0.002)) as outlets:
        for n in (1, 2, 3):
            outlets.put(event(n))
        taken.heard.count(3)
    assert numbers(taken.heard.all) == [1, 2, 3]
    assert taken.heard.all[1].body == EventsLost(count=1, first=2, last=2)
    assert outlets.health[0].lost == 1


def test_the_end_comes_in_time_and_what_is_left_is_told() -> None:
    never = threading.Event()

    async def hang(_: Event) -> None:
        never.set()
        await asyncio.Event().wait()

    taken = Taken(before=hang)
    with Outlets([taken], close_s=0.05) as outlets:
        for n in range(1, 8):
            outlets.put(event(n))
        assert never.wait(LONGEST_S)
    assert outlets.given_up == {"list": EventsLost(count=7, first=1, last=7)}
    outlets.put(event(8))
    assert outlets.health == [
        OutletHealth(name="list", connected=True, detail="a list", delivered=0, lost=7, waiting=0)
    ]


def test_checking_says_who_answers_or_what_went_wrong() -> None:
    @dataclass
    class Deaf(Taken):
        error: Exception | None = None

        async def reach(self) -> str:
            if self.error is not None:
                raise self.error
            await asyncio.Event().wait()
            return ""

    assert (check(Taken()).ok, check(Taken()).answer) == (True, "a list")
    refused = check(Deaf(error=ConnectionRefusedError(111, "Connection refused")))
    assert (refused.ok, refused.answer, refused.name) == (False, "Connection refused", "list")
    silent = check(Deaf(), within_s=0.01)
    assert (silent.ok, silent.answer) == (False, "no answer within 0.01 s")


@pytest.mark.parametrize("room", [1, 3])
def test_room_that_is_given_up_at_the_end_counts_what_was_lost_before(room: int) -> None:
    outbox = Outbox("x", room=room)
    for n in range(1, 11):
        outbox.put(event(n))
    assert outbox.abandon() == EventsLost(count=10, first=1, last=10)
    assert outbox.health.lost == 10
    assert outbox.abandon() is None

"""MQTT outlet: a message for each event, and a retained state that late subscribers receive first.

Everything is sent with QoS 1, in order, with up to ``AT_ONCE`` messages under way. After a break, messages
without acknowledgement are sent again: a message may come twice (``stream`` and ``number`` identify it), and
none is lost.
"""

from __future__ import annotations

import asyncio
import re
import ssl
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final

import aiomqtt

from prooflight_line.plant.events import KINDS
from prooflight_line.plant.outlets.outlet import OutletError, error_text
from prooflight_line.plant.state import PlantState

if TYPE_CHECKING:
    from prooflight_line.plant.outlets.outbox import Outbox

AT_ONCE: Final = 64
"""Messages under way. With these, a link with a round trip of 2 s still carries 30 events a second."""
TIMEOUT_S: Final = 10.0
QOS: Final = 1
_CODE: Final = re.compile(r"^\[code:[^]]*\] ")
TOPICS: Final = {
    "run-started": "run",
    "run-ended": "run",
    "sheet-judged": "sheet",
    "sheet-at-gate": "gate",
    "incident-opened": "incident",
    "incident-changed": "incident",
    "incident-ended": "incident",
    "state-changed": "change",
    "notice": "notice",
    "events-lost": "lost",
}
"""Last part of an event's topic, by the kind of the event."""
EACH_SHEET: Final = frozenset({"sheet-judged", "sheet-at-gate"})
"""Kinds after which the retained state is not sent again, because they come with every sheet."""
ONLINE, STATE = "online", "state"
"""Last parts of the retained topics; the first is also the topic of the last will."""


@dataclass(slots=True, kw_only=True)
class Mqtt:
    """Connection to one broker."""

    host: str
    port: int
    topic: str
    client_id: str | None = None
    user: str | None = None
    password: str | None = field(default=None, repr=False)
    tls: ssl.SSLContext | None = None
    keepalive_s: int = 10
    timeout_s: float = TIMEOUT_S
    state: PlantState = field(default=PlantState(), init=False, repr=False)
    """State after the events that have arrived; it outlives a connection."""

    @property
    def name(self) -> str:
        """Name of the outlet, for people."""
        return f"MQTT {self.host}:{self.port}"

    def of(self, part: str) -> str:
        """Return a whole topic."""
        return f"{self.topic}/{part}"

    async def run(self, outbox: Outbox) -> None:
        """Connect and deliver; see ``Outlet``."""
        will = aiomqtt.Will(self.of(ONLINE), payload="false", qos=QOS, retain=True)
        try:
            async with self._client(identifier=self.client_id, will=will) as client:
                await client.publish(self.of(ONLINE), "true", qos=QOS, retain=True)
                ended = False
                while not ended:
                    async with self._witness() as witness:
                        await self._tell_state(client)
                        outbox.up(f"{self.host}:{self.port}, topic {self.topic}")
                        work = self._deliver(client, outbox)
                        ended = await _first_of(work, _broken(client), _broken(witness))
                await client.publish(self.of(ONLINE), "false", qos=QOS, retain=True)
        except aiomqtt.MqttError as error:
            raise OutletError(_CODE.sub("", error_text(error))) from error

    def _witness(self) -> aiomqtt.Client:
        """Return a second link, whose last will sets the retained state to a lost run.

        It is needed because a link has only one will. A will is fixed when a link is made, so this link is
        made again when a run begins.
        """
        lost = replace(self.state, running=False, ending="lost", incidents={})
        will = aiomqtt.Will(self.of(STATE), payload=lost.json(), qos=QOS, retain=True)
        own = None if self.client_id is None else f"{self.client_id}-state"
        return self._client(identifier=own, will=will)

    async def reach(self) -> str:
        """Try to connect to the broker; see ``Outlet``."""
        try:
            async with self._client():
                return f"a broker at {self.host}:{self.port}"
        except aiomqtt.MqttError as error:
            raise OutletError(_CODE.sub("", error_text(error))) from error

    def _client(self, **how: Any) -> aiomqtt.Client:
        return aiomqtt.Client(
            self.host,
            self.port,
            username=self.user,
            password=self.password,
            tls_context=self.tls,
            keepalive=self.keepalive_s,
            timeout=self.timeout_s,
            max_inflight_messages=AT_ONCE,
            **how,
        )

    async def _deliver(self, client: aiomqtt.Client, outbox: Outbox) -> bool:
        """Send until no more events come, which returns True, or until a run has begun."""
        while events := await outbox.heads(AT_ONCE):
            # They begin in this order, so the broker has them in this order.
            sent = [
                asyncio.ensure_future(
                    client.publish(self.of(TOPICS[event.kind]), event.json(), qos=QOS, timeout=self.timeout_s)
                )
                for event in events
            ]
            try:
                for event, one in zip(events, sent, strict=True):
                    await one
                    outbox.delivered(event)
                    self.state = self.state.after(event)
            finally:
                for one in sent:
                    one.cancel()
                await asyncio.gather(*sent, return_exceptions=True)
            if any(event.kind not in EACH_SHEET for event in events):
                await self._tell_state(client)
            if any(event.kind == "run-started" for event in events):
                return False
        return True

    async def _tell_state(self, client: aiomqtt.Client) -> None:
        await client.publish(self.of(STATE), self.state.json(), qos=QOS, retain=True)


async def _broken(client: aiomqtt.Client) -> None:
    """Wait until the connection breaks, which raises an error; nothing is subscribed to."""
    async for _ in client.messages:
        pass


async def _first_of(work: Any, *watches: Any) -> bool:
    """Do the work until it is done, and return its result, or until a watch raises an error."""
    tasks = [asyncio.ensure_future(one) for one in (work, *watches)]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for one in done:
            one.result()
        return tasks[0] in done and bool(tasks[0].result())
    finally:
        for one in tasks:
            one.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def topics(prefix: str = "PREFIX") -> list[tuple[str, str, bool]]:
    """Return the rows of the reference: topic, content, and whether it is retained."""
    kinds: dict[str, list[str]] = {}
    for kind in KINDS:
        kinds.setdefault(TOPICS[kind], []).append(f"`{kind}`")
    return [
        (
            f"{prefix}/{ONLINE}",
            "`true` while Prooflight is connected, else `false`; also the last will",
            True,
        ),
        (
            f"{prefix}/{STATE}",
            "state of press, run and open incidents, as JSON; also a last will, with `running` false and `ending` lost",
            True,
        ),
        *(
            (f"{prefix}/{part}", f"events {', '.join(names)}, as JSON", False)
            for part, names in kinds.items()
        ),
    ]

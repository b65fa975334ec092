"""Webhook outlet: every event is posted to a URL, signed, in order, and repeated until it is accepted.

The signature is HMAC-SHA256 with a shared secret, over the time of sending, a full stop and the body. A
receiver refuses a body that was signed long ago, so that nobody can replay an event, and recognises repeated
events by the idempotency key (``verified`` shows how).
"""

from __future__ import annotations

import hashlib
import hmac
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from prooflight import __version__
from prooflight_line.plant.outlets.outlet import OutletError
from prooflight_line.plant.outlets.posting import REFUSED, answer_text, posting

if TYPE_CHECKING:
    import ssl
    from collections.abc import Callable, Mapping

    from prooflight_line.plant.events import Event
    from prooflight_line.plant.outlets.outbox import Outbox

TIMESTAMP, SIGNATURE, KEY = "Prooflight-Timestamp", "Prooflight-Signature", "Idempotency-Key"
TOLERANCE_S: Final = 300.0
"""Longest time between sending and receiving. assumed: clocks of one plant agree better, a busy network is
faster."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Webhook:
    """Connection to one URL."""

    url: str
    secret: bytes = field(repr=False)
    kinds: frozenset[str] | None = None
    """Kinds of events that are sent; None: all. ``events-lost`` is always sent."""
    tls: ssl.SSLContext | None = None
    timeout_s: float = 10.0
    clock: Callable[[], float] = time.time

    @property
    def name(self) -> str:
        """Name of the outlet, for people; without the part after a question mark, which may be a secret."""
        return f"webhook {self.url.partition('?')[0]}"

    async def run(self, outbox: Outbox) -> None:
        """Post the events; see ``Outlet``."""
        async with posting(tls=self.tls, timeout_s=self.timeout_s) as client:
            while (event := await outbox.head()) is not None:
                if self.kinds is not None and event.kind not in self.kinds | {"events-lost"}:
                    outbox.delivered(event)
                    continue
                body = event.json().encode()
                answer = await client.post(self.url, content=body, headers=self._headers(event, body))
                if answer.status_code in REFUSED:
                    outbox.refused(event)
                    outbox.down(f"event {event.number} was refused: {answer_text(answer)}")
                    continue
                if not answer.is_success:
                    raise OutletError(f"the receiver {answer_text(answer)}")
                outbox.delivered(event)
                outbox.up(self.url.partition("?")[0])

    async def reach(self) -> str:
        """Try the web server without posting anything; see ``Outlet``."""
        async with posting(tls=self.tls, timeout_s=self.timeout_s) as client:
            return f"a web server ({answer_text(await client.head(self.url))} when asked for its headers)"

    def _headers(self, event: Event, body: bytes) -> dict[str, str]:
        timestamp = str(int(self.clock()))
        return {
            "Content-Type": "application/json",
            "User-Agent": f"Prooflight/{__version__}",
            TIMESTAMP: timestamp,
            SIGNATURE: signature(self.secret, timestamp, body),
            KEY: event.key,
        }


def signature(secret: bytes, timestamp: str, body: bytes) -> str:
    """Return the value of the signature header."""
    return "v1=" + hmac.new(secret, timestamp.encode() + b"." + body, hashlib.sha256).hexdigest()


def verified(
    secret: bytes, headers: Mapping[str, str], body: bytes, *, now_s: float, tolerance_s: float = TOLERANCE_S
) -> bool:
    """Return whether a body comes from an owner of the secret and was sent just now, as a receiver must check."""
    sent = headers.get(TIMESTAMP, "")
    if not (sent.isascii() and sent.isdecimal() and abs(now_s - int(sent)) <= tolerance_s):
        return False
    return hmac.compare_digest(headers.get(SIGNATURE, ""), signature(secret, sent, body))

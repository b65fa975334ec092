"""The shipper as a service: it ships as the journal grows, and waits for what is away, be it for a week."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from prooflight import __version__
from prooflight_line.journal.following import follow
from prooflight_line.journal.schema import JournalError
from prooflight_line.records.database import UnreachableError
from prooflight_line.records.shipping import LinkDownError, Shipper

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from threading import Event

    from prooflight_line.journal.following import JournalFollower
    from prooflight_line.records.pictures import ObjectStore
    from prooflight_line.records.shipping import Step

POLL_S: Final = 0.25
"""Time between two looks at the journal."""
SEEN_EVERY_S: Final = 10.0
"""Time after which a press whose journal does not grow is noted as within reach all the same."""
FIRST_WAIT_S: Final = 0.5
LONGEST_WAIT_S: Final = 30.0
"""Time between two tries when the server has been away for long."""


@dataclass(kw_only=True)
class ShippingService:
    """Ships one press's journal until it is stopped.

    announce: called with a line for people when the link goes down, and when it is up again. passed: called after each
    step that shipped something.
    """

    url: str
    press: str
    plant: str
    journal: Path
    pictures: ObjectStore | None
    announce: Callable[[str], None]
    passed: Callable[[Step, Shipper], None] = lambda _step, _shipper: None
    _shipper: Shipper | None = None
    _file: tuple[int, int] | None = None
    _trouble: str | None = field(default=None, init=False)
    _seen_s: float = field(default=-math.inf, init=False)

    def run(self, stop: Event) -> None:
        """Ship until ``stop`` is set. RecordsError: what no waiting would mend.

        A journal that cannot be read, as one that is being created or moved, is waited for as the server is.
        """
        wait_s = FIRST_WAIT_S
        try:
            while not stop.is_set():
                try:
                    more = self.once()
                except (LinkDownError, UnreachableError, JournalError) as error:
                    self._down(error)
                    stop.wait(wait_s)
                    wait_s = min(2 * wait_s, LONGEST_WAIT_S)
                    continue
                wait_s = FIRST_WAIT_S
                if not more:
                    stop.wait(POLL_S)
        finally:
            self.close()

    def once(self) -> bool:
        """Ship one step; return whether there is more. Errors as ``Shipper.step``, JournalError: it cannot be read."""
        shipper = self._opened()
        if shipper is None:
            return False
        step = shipper.step()
        if self._trouble is not None:
            self.announce(f"ships again; {shipper.waiting_rows:,} rows wait")
            self._trouble = None
        if step.sheets or step.labels:
            self.passed(step, shipper)
            self._seen_s = time.monotonic()
        elif time.monotonic() - self._seen_s >= SEEN_EVERY_S:
            shipper.note_reach()
            self._seen_s = time.monotonic()
        return step.more

    def close(self) -> None:
        """Close the journal and the connection."""
        if self._shipper is not None:
            self._shipper.close()
            self._shipper.journal.close()
        self._shipper = None

    def _opened(self) -> Shipper | None:
        """Return the shipper, opened again if the journal was replaced; None: there is no journal yet."""
        try:
            status = self.journal.stat()
        except FileNotFoundError:
            self.close()
            return None
        file = (status.st_dev, status.st_ino)
        if self._shipper is not None and file == self._file:
            return self._shipper
        self.close()
        journal: JournalFollower | None = follow(self.journal, version=__version__)
        if journal is None:
            return None
        try:
            self._shipper = Shipper.open(
                self.url,
                press=self.press,
                plant=self.plant,
                journal=journal,
                pictures=self.pictures,
                announce=self.announce,
            )
        except BaseException:
            journal.close()
            raise
        self._file = file
        return self._shipper

    def _down(self, error: Exception) -> None:
        self.close()
        if self._trouble is None:
            self.announce(
                f"{error}; the journal stores all rows; they are shipped when the connection works again"
            )
        self._trouble = str(error)

"""Bounded queue of data to be written, so that a journal that cannot write takes no memory from the inspection."""

from __future__ import annotations

import threading
from collections import Counter, deque
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from prooflight_line.journal.records import PageRecord, RunEnd, RunFacts

MOST_PAGES: Final = 20_000
"""Greatest number of pages: over an hour at 5 pages a second; about 3 kB each."""
MOST_EVIDENCE_BYTES: Final = 256_000_000
BATCH_PAGES: Final = 256
BATCH_EVIDENCE_BYTES: Final = 16_000_000
"""Evidence written at once: an attempt that fails on a full disk costs little, however much waits."""


@dataclass(slots=True, kw_only=True)
class Batch:
    """The data of one commit."""

    begun: dict[int, RunFacts] = field(default_factory=dict)
    pages: deque[tuple[int, PageRecord]] = field(default_factory=deque)
    ended: dict[int, RunEnd] = field(default_factory=dict)
    dropped_pages: Counter[int] = field(default_factory=Counter)
    """Dropped pages of each run, not yet recorded in the journal."""
    dropped_evidence: Counter[int] = field(default_factory=Counter)

    @property
    def empty(self) -> bool:
        """Whether there is nothing to write."""
        return not (self.begun or self.pages or self.ended or self.dropped_pages or self.dropped_evidence)


class JournalQueue:
    """Queue of runs and pages; at its limits it drops the oldest evidence first, then the oldest pages."""

    def __init__(
        self, *, most_pages: int = MOST_PAGES, most_evidence_bytes: int = MOST_EVIDENCE_BYTES
    ) -> None:
        self._most_pages, self._most_bytes = most_pages, most_evidence_bytes
        self._batch = Batch()
        self._bytes = 0
        self._in_hand = 0  # pages taken and not yet confirmed as written
        self._stripped = 0  # number of pages at the head without evidence
        self._guard = threading.Lock()
        self.dropped_pages = self.dropped_evidence = 0

    @property
    def waiting(self) -> int:
        """Number of pages queued, or taken and not yet written."""
        return len(self._batch.pages) + self._in_hand

    def begin(self, run_id: int, facts: RunFacts) -> None:
        """Add the start of a run."""
        with self._guard:
            self._batch.begun[run_id] = facts

    def end(self, run_id: int, end: RunEnd) -> None:
        """Add the end of a run."""
        with self._guard:
            self._batch.ended[run_id] = end

    def add(self, run_id: int, page: PageRecord) -> None:
        """Add a page."""
        with self._guard:
            self._batch.pages.append((run_id, page))
            self._bytes += _bytes(page)
            self._bound()

    def take(self) -> Batch:
        """Remove and return the next batch, of a limited size; ``written`` or ``put_back`` must follow.

        Runs end with the last of the pages.
        """
        with self._guard:
            rest, taken, size = self._batch, Batch(), 0
            while rest.pages and len(taken.pages) < BATCH_PAGES and size < BATCH_EVIDENCE_BYTES:
                size += _bytes(rest.pages[0][1])
                taken.pages.append(rest.pages.popleft())
            taken.begun, taken.dropped_pages, taken.dropped_evidence = (
                rest.begun,
                rest.dropped_pages,
                rest.dropped_evidence,
            )
            self._batch = Batch(pages=rest.pages, ended=rest.ended)
            if not rest.pages:
                taken.ended, self._batch.ended = rest.ended, {}
            self._bytes -= size
            self._stripped = max(self._stripped - len(taken.pages), 0)
            self._in_hand = len(taken.pages)
            return taken

    def written(self) -> None:
        """Confirm that the batch taken is durable."""
        with self._guard:
            self._in_hand = 0

    def put_back(self, batch: Batch) -> None:
        """Put back a batch that could not be written, before what was added since."""
        with self._guard:
            rest = self._batch
            rest.pages.extendleft(reversed(batch.pages))
            rest.begun = batch.begun | rest.begun
            rest.ended = batch.ended | rest.ended
            rest.dropped_pages += batch.dropped_pages
            rest.dropped_evidence += batch.dropped_evidence
            self._bytes += sum(_bytes(page) for _, page in batch.pages)
            self._in_hand = self._stripped = 0
            self._bound()

    def _bound(self) -> None:
        pages = self._batch.pages
        while self._bytes > self._most_bytes:
            run_id, page = pages[self._stripped]
            if page.evidence is not None:
                self._bytes -= _bytes(page)
                pages[self._stripped] = (run_id, replace(page, evidence=None))
                self._batch.dropped_evidence[run_id] += 1
                self.dropped_evidence += 1
            self._stripped += 1
        while len(pages) > self._most_pages:
            run_id, page = pages.popleft()
            self._bytes -= _bytes(page)
            self._stripped = max(self._stripped - 1, 0)
            self._batch.dropped_pages[run_id] += 1
            self.dropped_pages += 1


def _bytes(page: PageRecord) -> int:
    return sum(getattr(array, "nbytes", 0) for array in page.evidence.values()) if page.evidence else 0

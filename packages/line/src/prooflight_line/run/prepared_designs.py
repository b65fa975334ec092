"""Preparation of a job's designs before any run, by any process."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from prooflight.pages.job import opened
from prooflight_line.run.sheet_inspector import SheetInspector

if TYPE_CHECKING:
    from prooflight.inspection.prepared_store import PreparedStore
    from prooflight.pages.job import JobSource


@dataclass(frozen=True, slots=True, kw_only=True)
class PrepareDesign:
    """Preparation of one page of a job; it stores nothing, and can be sent to workers on other machines."""

    source: JobSource
    store: PreparedStore

    def __call__(self, number: int) -> bytes:
        """Return the file of page ``number``, from 1, for ``PreparedStore.put``.

        JobError: the page cannot be used, or does not fit the press.
        """
        inspector = self.store.inspector
        page = inspector.press.geometry.lay(opened(self.source).page(number))
        return self.store.content(SheetInspector(inspector=inspector).prepare(page))

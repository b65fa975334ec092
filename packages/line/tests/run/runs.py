"""What a run is made of, without a press: a book of sheets, and an inspector that says good of each."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from prooflight.detectors.verdict import Verdict
from prooflight_line.run.sheet_inspector import SheetResult
from prooflight_line.run.sheets.thumbnails import Thumbnail

if TYPE_CHECKING:
    from collections.abc import Callable

PATIENCE_S = 20.0
"""Only a test that fails waits so long."""
NOTHING = np.zeros((1, 1, 1), np.uint16)
SMALL = Thumbnail(
    light=np.zeros((1, 1), np.uint8), width_mm=1, height_mm=1, signature=np.zeros(1, np.float32)
)


@dataclass
class Book:
    """Sheets of designs that repeat; some cannot be read."""

    sheets: int
    torn: dict[int, Exception] = field(default_factory=dict)
    designs: int = 10**9

    def __len__(self) -> int:
        return self.sheets

    def design(self, sheet: int) -> int:
        return sheet % self.designs

    def page(self, sheet: int) -> Any:
        if sheet in self.torn:
            raise self.torn[sheet]
        return self.design(sheet)


@dataclass
class SheetInspector:
    """Says good of every sheet; ``first`` is called before, with the sheet's name."""

    first: Callable[[str], None] = lambda _name: None
    prepared: list[Any] = field(default_factory=list)
    before_sheets: list[str] = field(default_factory=list)
    """What was done before the first sheet: ``load`` of a design, or ``rehearse``."""

    def prepare(self, page: Any) -> Any:
        self.prepared.append(page)
        return SimpleNamespace(page=page, additional=SMALL.arrays, nbytes=1)

    def close(self) -> None:
        """It has no processes."""

    def rehearsal_scans(self, ready: Any) -> list[Any]:
        return []

    def rehearse_preparation(self, ready: Any) -> None:
        pass

    def rehearse(self, ready: Any, scans: Any, *, threads: int) -> None:
        self.before_sheets.append("rehearse")

    def load(self, ready: Any) -> None:
        self.before_sheets.append("load")

    def picture_to_store(self, scan: Any) -> None:
        pass

    def following(self, press: Any) -> SheetInspector:
        return self

    def renewed(self, ready: Any) -> Any:
        return ready

    def inspect(
        self,
        ready: Any,
        scan: Any,
        *,
        name: str,
        seed: int,
        unseen: Any = (),
        **_more: Any,
    ) -> SheetResult:
        self.first(name)
        return SheetResult(verdict=Verdict(page=f"design {ready.page}", verdict="good"))

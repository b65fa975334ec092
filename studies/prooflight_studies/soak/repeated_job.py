"""A job whose pages are printed over and over, for as many sheets as a soak takes."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight.line.sheets.thumbnails import Thumbnail


class RepeatedJob:
    """A job's thumbnails, printed over and over until so many sheets have passed; ``following.Expected``."""

    def __init__(self, designs: Sequence[Thumbnail | None], sheets: int) -> None:
        self._designs, self._sheets = designs, sheets

    def __len__(self) -> int:
        return self._sheets

    def __getitem__(self, sheet: int) -> Thumbnail | None:
        if not 0 <= sheet < self._sheets:
            raise IndexError(sheet)
        return self._designs[sheet % len(self._designs)]

"""A stand-in for the test of a run, which suspends its promise when it is told to."""

from __future__ import annotations

from typing import Any


class StrangeFrom:
    """A run's test that has had enough of so many pages."""

    strangest, remedy = "lines along the travel", "look at it"

    def __init__(self, enough: int) -> None:
        self.enough, self.pages = enough, 0

    def add(self, summary: Any) -> None:
        self.pages += 1

    @property
    def suspended(self) -> bool:
        return self.pages >= self.enough

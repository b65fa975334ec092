"""What a job ticket says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

SUFFIXES: Final = (".xjdf", ".jdf")
"""Endings of a ticket's file name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ticket:
    """What a ticket says; a text that it does not state is empty."""

    job_id: str
    name: str = ""
    """Descriptive name of the job."""
    customer: str = ""
    file: str = ""
    """Name of the job's file, which lies beside the ticket; empty: the file with the ticket's own stem."""
    copies: int | None = None
    layout: str = ""
    """Words of ``--layout`` that the ticket states."""
    brand: str = ""
    weight_gsm: float | None = None
    """Weight of the substrate. [g/m2]"""
    keep: str = ""
    """Evidence that is stored, as of ``watch --keep``."""
    sample: float | None = None
    """Share of passing sheets that people label, as of ``watch --sample``."""

    @property
    def facts(self) -> dict[str, Any]:
        """What the ticket states, in types that JSON can hold."""
        values = {name: getattr(self, name) for name in self.__slots__}
        return {name: value for name, value in values.items() if value not in ("", None)}


def is_ticket(name: str) -> bool:
    """Return whether a file of this name is a ticket."""
    return name.lower().endswith(SUFFIXES)


def layout_with(own: str, given: str | None) -> str | None:
    """Return the layout of a ticket's job on a press that was given ``--layout``; None: neither says anything.

    The ticket's words count; those that it does not say are the press's. Order and backs are of two sides.

    >>> layout_with("sides=2", "sides=1,gutter=4")
    'sides=2,gutter=4'
    >>> layout_with("sides=1", "sides=2,order=loop:4")
    'sides=1'
    """
    both: dict[str, str] = {}
    for part in f"{given or ''},{own}".split(","):
        key, _, value = (piece.strip() for piece in part.partition("="))
        if key:
            both[key] = value
    if both.get("sides") == "1":
        both = {key: value for key, value in both.items() if key not in ("order", "backs")}
    return ",".join(f"{key}={value}" for key, value in both.items()) or given

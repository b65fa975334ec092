"""Schema of the columns of a row, both for rows to be written and for rows that were read.

Statistics may be NaN or infinite, as they were computed; positions, times and counts may not.
"""

from __future__ import annotations

import json
import math
import re
from typing import Annotated, Any, Final, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    Json,
    ValidationError,
    field_validator,
    model_validator,
)

from prooflight.detectors.disposition import DecidedBy, Disposition, without_gate
from prooflight.detectors.verdict import Verdict
from prooflight_line.journal.records import Ending
from prooflight_line.journal.schema import MOST_TEXT

QUERY_COLUMNS: Final = ("page", "verdict", "kind", "probability", "score", "threshold", "p_value")
"""Fields of a verdict that have columns of their own, for queries."""
ACTION: Final = '"action": '
YEAR_9999_S: Final = 253_370_764_800
MOST_PACK_BYTES: Final = 2**30
ROUNDING: Final = 1e-6
PACK_NAME: Final = re.compile(r"run([0-9]{6,19})/-?[0-9]{7,19}-[0-9a-f]{8}\.npz")

Text = Annotated[str, Field(max_length=MOST_TEXT)]
Whole = Annotated[int, Field(ge=-(2**63), lt=2**63)]
Count = Annotated[int, Field(ge=0, lt=2**63)]
Number = Annotated[int, Field(ge=1, lt=2**63)]
Bit = Annotated[int, Field(ge=0, le=1)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Moment = Annotated[float, Field(ge=0, lt=YEAR_9999_S, allow_inf_nan=False)]


DISPOSITIONS: Final[dict[DecidedBy | None, tuple[str, ...]]] = {
    "default": get_args(Disposition),
    "costs": ("accept",),
    "gate": get_args(Disposition),
    None: ("accept", "reprint", "stop"),
}
"""Valid dispositions, by what decided them."""


class Columns(BaseModel):
    """A row as stored; raises ValidationError, a ValueError, if it is not valid."""

    model_config = ConfigDict(strict=True, frozen=True, extra="ignore")


class EndColumns(Columns):
    """Columns of ``runs`` that are filled when a run ends."""

    ended_s: Moment
    ending: Ending
    detail: Text
    counts: Json[dict[str, Any]]


class RunColumns(Columns):
    """Columns of ``runs``."""

    id: Number
    job: Text
    job_digest: Text
    press: Text
    press_digest: Text
    detector: Text
    source: Text
    started_s: Moment
    sheets: Number | None
    settings: Json[dict[str, Any]]
    ended_s: Moment | None = None
    ending: Ending | None = None
    detail: Text | None = None
    counts: Json[dict[str, Any]] | None = None
    dropped_pages: Count = 0
    dropped_evidence: Count = 0

    @model_validator(mode="after")
    def _ended_or_not(self) -> RunColumns:
        if (self.ended_s is None) != (self.ending is None):
            raise ValueError("ended_s and ending: one without the other")
        return self


class PackColumns(Columns):
    """Columns of ``packs``."""

    id: Number
    run_id: Number
    file: Text
    bytes: Annotated[int, Field(ge=0, le=MOST_PACK_BYTES)]

    @model_validator(mode="after")
    def _named_after_its_run(self) -> PackColumns:
        name = PACK_NAME.fullmatch(self.file)
        if name is None or int(name[1]) != self.run_id:
            raise ValueError(f"file: {self.file!r} is not the name of a pack of run {self.run_id}")
        return self


class PageColumns(Columns):
    """Columns of ``pages``."""

    run_id: Number
    sheet: Count
    job_page: Count | None
    page: Any
    verdict: Any
    disposition: Any
    decided_by: DecidedBy | None = None
    """Rule that decided the disposition; None: the row is of schema 2, which had an action in place of a
    disposition."""
    kind: Any
    probability: Any
    score: Any
    threshold: Any
    p_value: Any
    late: Bit
    faulty: Bit
    noted: Bit
    first_line: Whole
    time_s: Finite
    faults: Json[tuple[Text, ...]]
    notes: Json[tuple[Text, ...]]
    nuisance: Json[dict[str, float]]
    whole_verdict: Json[Verdict]
    asked: Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)] | None = None
    pack_id: Number | None = None

    @field_validator("whole_verdict", mode="before")
    @classmethod
    def _of_schema_2(cls, text: Any) -> Any:
        """Convert a verdict of schema 2, which wrote an action: a misprint was accepted if stopping cost more."""
        if isinstance(text, str) and ACTION in text:
            fields = json.loads(text)
            if isinstance(fields, dict) and "action" in fields:
                costly = (fields.get("verdict"), fields.pop("action")) == ("misprint", "accept")
                return json.dumps(fields | {"stopping_costs_more": costly})
        return text

    @model_validator(mode="after")
    def _is_consistent(self) -> PageColumns:
        for name in QUERY_COLUMNS:
            if not _same(getattr(self, name), getattr(self.whole_verdict, name)):
                raise ValueError(f"{name}: differs from whole_verdict")
        if self.disposition not in DISPOSITIONS[self.decided_by]:
            raise ValueError(f"disposition: {self.disposition!r} is not one")
        ruled = without_gate(self.whole_verdict, self.faults)
        if self.decided_by in ("default", "costs") and (self.disposition, self.decided_by) != ruled:
            raise ValueError("disposition: differs from that of whole_verdict")
        for name, of in (("faulty", "faults"), ("noted", "notes")):
            if getattr(self, name) != bool(getattr(self, of)):
                raise ValueError(f"{name}: does not agree with {of}")
        if odd := _odd(self.whole_verdict):
            raise ValueError(f"whole_verdict: {odd}")
        return self


def complaint(error: Exception) -> str:
    """Return what is wrong with a row, in one line: its column and why.

    >>> try:
    ...     PackColumns(id=0, run_id=1, file="run000001/00000001-01234567.npz", bytes=1)
    ... except ValueError as error:
    ...     complaint(error)
    'id: input should be greater than or equal to 1'
    """
    if not isinstance(error, ValidationError):
        message = str(getattr(error, "orig", None) or error)  # SQLAlchemy adds the whole statement
        return f"{type(error).__name__}: {message.partition(chr(10))[0]}"
    first = error.errors(include_url=False, include_context=False, include_input=False)[0]
    where = ".".join(str(part) for part in first["loc"])
    message = re.sub(
        "^[A-Z](?![A-Z])", lambda letter: letter[0].lower(), first["msg"].removeprefix("Value error, ")
    )
    return f"{where}: {message}" if where else message


def _same(column: Any, stated: Any) -> bool:
    """Return whether a column agrees with its verdict; SQLite stores NaN as NULL."""
    column, stated = (None if value != value else value for value in (column, stated))
    return type(column) is not bool and bool(column == stated)


def _odd(verdict: Verdict) -> str:
    """Return what is invalid about a verdict beyond its types; empty: nothing."""
    for index, region in enumerate(verdict.regions):
        place = (region.x_mm, region.y_mm, region.width_mm, region.height_mm)
        if not all(map(math.isfinite, place)) or min(place[2:]) < 0:
            return f"regions.{index}: has no valid place"
    if verdict.shift_mm is not None and not all(map(math.isfinite, verdict.shift_mm)):
        return "shift_mm: is not finite"
    for name in ("probability", "p_value"):
        share = getattr(verdict, name)
        if share is not None and not -ROUNDING <= share <= 1 + ROUNDING and share == share:
            return f"{name}: is not between 0 and 1"
    return ""

"""The journal's tables, and the conversion of values to text.

Schema history:
1: journal, runs, packs, pages.
2: ``pages.asked``.
3: ``pages.disposition`` and ``pages.decided_by`` in place of ``pages.action``.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import (
    JSON,
    Boolean,
    Column,
    Float,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    String,
    Table,
    column,
    table,
)

from prooflight.errors import InputError

if TYPE_CHECKING:
    from sqlalchemy.types import TypeEngine

SCHEMA: Final = 3
PREVIOUS: Final = 2
"""Schema that is still read: a journal of it is read as it is, and updated to ``SCHEMA`` when a run is
written into it."""
MOST_TEXT: Final = 20_000
"""Greatest number of characters of one text; more is cut."""


class JournalError(InputError):
    """A journal that cannot be used: damaged, of another schema, written by another process, or missing."""


def _filled(kind: type[TypeEngine[Any]], *names: str) -> list[Column[Any]]:
    """Return columns in which every row has a value."""
    return [Column(name, kind, nullable=False) for name in names]


all_tables = MetaData()
journal_table = Table(
    "journal", all_tables, Column("schema", Integer, primary_key=True), *_filled(String, "version")
)
runs_table = Table(
    "runs",
    all_tables,
    Column("id", Integer, primary_key=True),
    *_filled(String, "job", "job_digest", "press", "press_digest", "detector", "source"),
    *_filled(Float, "started_s"),
    Column("sheets", Integer),
    *_filled(JSON, "settings"),
    Column("ended_s", Float),
    Column("ending", String),
    Column("detail", String),
    Column("counts", JSON(none_as_null=True)),
    Column("dropped_pages", Integer, nullable=False, default=0),
    Column("dropped_evidence", Integer, nullable=False, default=0),
)
packs_table = Table(
    "packs",
    all_tables,
    Column("id", Integer, primary_key=True),
    Column("run_id", ForeignKey("runs.id"), nullable=False),
    Column("file", String, nullable=False, unique=True),
    *_filled(Integer, "bytes"),
)
pages_table = Table(
    "pages",
    all_tables,
    Column("run_id", ForeignKey("runs.id"), primary_key=True),
    Column("sheet", Integer, primary_key=True),
    Column("job_page", Integer),
    *_filled(String, "page", "verdict", "disposition"),
    Column("decided_by", String),
    Column("kind", String),
    *(Column(name, Float) for name in ("probability", "score", "threshold", "p_value")),
    *_filled(Boolean, "late", "faulty", "noted"),
    *_filled(Integer, "first_line"),
    *_filled(Float, "time_s"),
    *_filled(JSON, "faults", "notes", "nuisance", "whole_verdict"),
    Column("asked", Float),
    Column("pack_id", ForeignKey("packs.id")),
    Index("pages_by_outcome", "run_id", "verdict", "late", "faulty", "noted"),
    Index("pages_by_pack", "pack_id"),
)


# Untyped, so that SQLAlchemy converts no stored value: values are checked in ``columns``.
stored_runs, stored_packs, stored_pages = (
    table(each.name, *(column(name) for name in each.columns.keys()))  # noqa: SIM118
    for each in (runs_table, packs_table, pages_table)
)


def json_text(value: Any) -> str:
    """Return the JSON of ``plain`` values; NaN and infinity are kept."""
    return json.dumps(plain(value))


def finite(value: Any) -> Any:
    """Return the value with None for every number that is not finite, which JSON does not have; lists for tuples."""
    match value:
        case float():
            return value if math.isfinite(value) else None
        case dict():
            return {str(name): finite(part) for name, part in value.items()}
        case list() | tuple():
            return [finite(part) for part in value]
    return value


def plain(value: Any) -> Any:
    """Return a value as JSON and SQLite can store it: without NumPy or dataclasses, in limited Unicode texts."""
    if isinstance(value, str):
        # Names of files need not be UTF-8: an invalid byte is written as backslash and number.
        text = str(value).encode("utf-8", "backslashreplace").decode("utf-8")
        return text if len(text) <= MOST_TEXT else text[: MOST_TEXT - 3] + "..."
    if value is None or isinstance(value, bool | int):
        return value
    if isinstance(value, float):
        return float(value)
    if isinstance(value, Mapping):
        return {plain(str(name)): plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    return plain(str(value))

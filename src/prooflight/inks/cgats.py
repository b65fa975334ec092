"""CGATS text (CGATS.17, ISO 28178, ArgyllCMS .ti1/.ti2/.ti3): tables of named columns under keywords.

The reader accepts the variants of files in use: lines padded with tabs, strings in quotes with tabs inside,
unquoted names with spaces in tab-separated files, several tables in one file, repeated keywords, KEYWORD
declarations, comments, any line end, UTF-8, UTF-16 and Latin-1, names and data on the line of their BEGIN.
Cells stay text; ``number`` reads decimal commas.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from prooflight.errors import ChartError
from prooflight.files.atomic import whole_file
from prooflight.files.given import GivenFiles, shortly

_TOKEN: Final = re.compile(r'"[^"]*(?:""[^"]*)*"|[^\s"]\S*|"\S*')
_NUMBER: Final = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")
_CONTROL: Final = re.compile(r"[\x00-\x08\x0e-\x1f]")
_STRUCTURE: Final = frozenset({"NUMBER_OF_FIELDS", "NUMBER_OF_SETS"})  # written anew, never kept
_EXPORT: Final = "export the chart again as CGATS text"
CHART_FILES: Final = GivenFiles(error=ChartError, remedy=_EXPORT, largest_mb=8)
MOST_ROWS: Final = 10_000
"""Greatest number of rows: ten times the largest usual chart.

Fitting inks takes memory in the square of it.
"""
_MOST_TABLES: Final = 100
_MOST_COLUMNS: Final = 2000
_MOST_KEYWORDS: Final = 10_000
_LONGEST_NUMBER: Final = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """One table of a CGATS file, as text."""

    kind: str
    """Identifier at the head of the table, e.g. ``CGATS.17``, ``ISO28178``, ``CTI3``.

    It is empty if the file has none.
    """
    keywords: tuple[tuple[str, str], ...]
    """Keywords and values in the file's order; repeated keywords and KEYWORD declarations included."""
    fields: tuple[str, ...]
    """Names of the columns."""
    rows: tuple[tuple[str, ...], ...]
    """Cells, one tuple for each data set, as long as ``fields``."""
    lines: tuple[int, ...] = field(default=(), compare=False)
    """Line of the file each row came from, from 1; empty for a table that was not read."""

    def keyword(self, name: str) -> str | None:
        """Return the value of the first keyword of that name, None without one."""
        return next((value for key, value in self.keywords if key.upper() == name.upper()), None)

    def numbers(self, names: Sequence[str]) -> NDArray[np.float64]:
        """Return the values of some columns, (rows, names); NaN where a cell is not a finite number."""
        places = [self.fields.index(name) for name in names]
        return np.array([[number(row[place]) for place in places] for row in self.rows])

    def line(self, row: int) -> str:
        """Return the position of a row in its file, for messages."""
        return f"line {self.lines[row]}" if self.lines else f"data set {row + 1}"


def number(cell: str) -> float:
    """Return the value of a cell, decimal point or comma; NaN if it is not a finite number.

    >>> number("0,25"), number("1e2"), number("1,000.5")
    (0.25, 100.0, nan)
    """
    if len(cell) > _LONGEST_NUMBER or not _NUMBER.fullmatch(cell):
        return math.nan
    value = float(cell.replace(",", "."))
    return value if math.isfinite(value) else math.nan


def read_tables(path: Path) -> tuple[Table, ...]:
    """Read every table of a CGATS file; ChartError if it is none, is cut off, or contradicts itself."""
    return parse(_decoded(path), where=path)


def write_tables(path: Path, tables: Sequence[Table]) -> None:
    """Write CGATS text, UTF-8, whole or not at all; reading it gives equal tables."""
    with whole_file(path) as unfinished:
        unfinished.write_text("\n".join(_lines(tables)) + "\n", encoding="utf-8", newline="\n")


def parse(text: str, *, where: object) -> tuple[Table, ...]:
    """Parse the tables of CGATS text; ``where`` is named in a ChartError."""
    lines = re.split(r"\r\n|\r|\n", text)
    tables = []
    start, kind = 0, ""
    while True:
        reader = _TableReader(where, lines, start, kind)
        table = reader.table()
        if table is None:
            break
        tables.append(table)
        if len(tables) > _MOST_TABLES:
            raise ChartError(where, f"there are more than {_MOST_TABLES} tables", remedy=_EXPORT)
        start, kind = reader.at, table.kind
    if not tables:
        raise ChartError(where, "there is no BEGIN_DATA: this is not CGATS text", remedy=_EXPORT)
    return tuple(tables)


class _TableReader:
    """Reader of the lines of one table; ``at`` is the next line to be read."""

    def __init__(self, where: object, lines: Sequence[str], at: int, kind: str) -> None:
        self.where, self.lines, self.at, self.kind = where, lines, at, kind
        self.keywords: list[tuple[str, str]] = []
        self.fields: list[str] = []

    def table(self) -> Table | None:
        """Return the next table, None if only keywords or nothing are left."""
        while self.at < len(self.lines):
            line = _without_comment(self.lines[self.at])
            tokens = _TOKEN.findall(line)
            self.at += 1
            if not tokens:
                continue
            head = tokens[0].upper()
            if head == "BEGIN_DATA_FORMAT":
                self.fields = [
                    _unquoted(token) for _, cells in self._block("DATA_FORMAT", tokens) for token in cells
                ]
            elif head == "BEGIN_DATA":
                return self._rows(tokens)
            elif len(tokens) == 1 and not self.keywords and not self.fields:
                self.kind = _unquoted(tokens[0])
            elif head not in _STRUCTURE:
                self.keywords.append((tokens[0], _value(line)))
            else:
                self.keywords.append((head, _value(line)))
            if len(self.keywords) > _MOST_KEYWORDS:
                what = f"there are more than {_MOST_KEYWORDS} keywords before line {self.at}"
                raise ChartError(self.where, what, remedy=_EXPORT)
        return None

    def _block(self, name: str, tokens: list[str]) -> list[tuple[int, list[str]]]:
        """Return the lines up to END_``name`` with their numbers, as tokens."""
        block = [(self.at, tokens[1:])] if len(tokens) > 1 else []
        while self.at < len(self.lines):
            line = _without_comment(self.lines[self.at])
            self.at += 1
            cells = _TOKEN.findall(line)
            if cells and cells[0].upper() == f"END_{name}":
                return block
            if cells and name == "DATA" and self.fields and len(cells) != len(self.fields) and "\t" in line:
                cells = _tab_separated(line, len(self.fields))
            if cells:
                block.append((self.at, cells))
            if len(block) > MOST_ROWS:
                what = f"{name} has more than {MOST_ROWS} lines"
                raise ChartError(self.where, what, remedy="give a smaller chart")
        what = f"the file ends without END_{name}: it is cut off"
        raise ChartError(self.where, what, remedy="export or copy it again")

    def _rows(self, tokens: list[str]) -> Table:
        if not self.fields:
            what = f"BEGIN_DATA on line {self.at} without BEGIN_DATA_FORMAT before"
            raise ChartError(self.where, what, remedy=_EXPORT)
        if len(self.fields) > _MOST_COLUMNS:
            what = f"there are {len(self.fields)} columns"
            raise ChartError(self.where, what, remedy=f"export at most {_MOST_COLUMNS}")
        block = self._block("DATA", tokens)
        for line, cells in block:
            if len(cells) != len(self.fields):
                what = f"line {line} has {len(cells)} values for {len(self.fields)} columns"
                raise ChartError(
                    self.where, what, remedy="one value for each column; put names with spaces in quotes"
                )
        table = Table(
            kind=self.kind,
            keywords=tuple(pair for pair in self.keywords if pair[0] not in _STRUCTURE),
            fields=tuple(self.fields),
            rows=tuple(tuple(_unquoted(cell) for cell in cells) for _, cells in block),
            lines=tuple(line for line, _ in block),
        )
        self._check_counts(table)
        return table

    def _check_counts(self, table: Table) -> None:
        seen: set[str] = set()
        for name in table.fields:
            if name.upper() in seen:
                what = f"the column {shortly(name)} appears twice"
                raise ChartError(self.where, what, remedy="keep one of the two")
            seen.add(name.upper())
        for name, count in (("NUMBER_OF_FIELDS", len(table.fields)), ("NUMBER_OF_SETS", len(table.rows))):
            for key, value in self.keywords:
                if key == name and number(value) != count:
                    what = f"{name} states {shortly(value)}, the table has {count}"
                    raise ChartError(self.where, what, remedy="complete the file or correct that number")


def _decoded(path: Path) -> str:
    text = CHART_FILES.read_text(path, any_encoding=True)
    if not text.strip():
        raise ChartError(path, "the file is empty", remedy=_EXPORT)
    if _CONTROL.search(text[:4096]):
        raise ChartError(path, "the file is binary, not CGATS text", remedy=_EXPORT)
    return text


def _without_comment(line: str) -> str:
    """Return the line up to a # that starts a word outside quotes."""
    quoted = False
    for at, letter in enumerate(line):
        if letter == '"':
            quoted = not quoted
        elif letter == "#" and not quoted and (at == 0 or line[at - 1].isspace()):
            return line[:at]
    return line


def _value(line: str) -> str:
    """Return the text after the keyword: a quoted string without its quotes, else the rest of the line."""
    parts = line.strip().split(None, 1)
    return _unquoted(parts[1].strip()) if len(parts) > 1 else ""


def _unquoted(token: str) -> str:
    if len(token) >= 2 and token[0] == token[-1] == '"':
        return token[1:-1].replace('""', '"')
    return token


def _tab_separated(line: str, count: int) -> list[str]:
    """Return the cells between tabs; padding beyond ``count`` cells is dropped."""
    cells = [cell.strip() for cell in line.split("\t")]
    while len(cells) > count and not cells[-1]:
        cells.pop()
    return cells


def _lines(tables: Sequence[Table]) -> Iterable[str]:
    for table in tables:
        if table.kind:
            yield table.kind
        yield ""
        for key, value in table.keywords:
            yield f"{key}\t{_quoted(value)}"
        yield f"NUMBER_OF_FIELDS\t{len(table.fields)}"
        yield "BEGIN_DATA_FORMAT"
        yield "\t".join(table.fields)
        yield "END_DATA_FORMAT"
        yield f"NUMBER_OF_SETS\t{len(table.rows)}"
        yield "BEGIN_DATA"
        for row in table.rows:
            yield "\t".join(cell if _NUMBER.fullmatch(cell) else _quoted(cell) for cell in row)
        yield "END_DATA"


def _quoted(text: str) -> str:
    return '"' + text.replace('"', '""') + '"'

"""Edits of single values of a press file: comments and layout stay as they are, byte for byte, elsewhere."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import tomlkit

from prooflight.errors import PressFileError
from prooflight.files.atomic import whole_file
from prooflight.press.press_file import PressFile

_SOURCE_COMMENT: Final = re.compile(r"\s*#\s*(assumed|paper|measured|stated|as built)\b", re.IGNORECASE)
"""Pattern of comments that state the source of a number, and would be untrue of another number."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Edit:
    """New value of one field of a press file."""

    block: str
    """Name of ``[block]`` or ``[[block]]``."""
    field: str
    value: Any
    why: str
    """Reason in a few words, for a comment."""
    number: int = 0
    """Index of the ``[[block]]``, from 0."""

    @property
    def name(self) -> str:
        """Return the field's name in messages."""
        number = f".{self.number + 1}" if self.number or self.block == "sensor" else ""
        return f"{self.block}{number}.{self.field}"


def edited(text: str, edits: Iterable[Edit]) -> str:
    """Return the text with these values; a block that is not there is added at its end.

    A comment after a value stays, unless it states the source of the old number. ValueError: the text is not
    TOML, or holds a block in another way than under a heading of its own.
    """
    for edit in edits:
        text = _one(text, edit)
    return text


def toml_line(field: str, value: Any) -> str:
    """Return a field and its value as one line of a press file.

    >>> toml_line("quantum_efficiency", {"wave_nm": [380, 730.0], "file": "a.csv"})
    'quantum_efficiency = {wave_nm = [380, 730.0], file = "a.csv"}'
    """
    if isinstance(value, dict):  # as a table of one line
        inline = tomlkit.inline_table()
        for name, inner in value.items():
            inline.append(name, inner)
        value = inline
    return f"{field} = {tomlkit.item(value).as_string()}"


def write_edits(path: Path, edits: Iterable[Edit]) -> PressFile:
    """Write them into a press file, whole or not at all.

    PressFileError: the file would be invalid afterwards.
    """
    before = PressFile.read(path)
    try:
        text = edited(before.text, edits)
    except ValueError as error:
        raise PressFileError(path, str(error), remedy="give each block a heading of its own") from error
    after = PressFile(path, text)
    after.camera()  # numbers must go together as well
    with whole_file(path) as unfinished:
        unfinished.write_bytes(text.encode())
    return after


def _one(text: str, edit: Edit) -> str:
    document = tomlkit.parse(text)
    wanted = tomllib.loads(text)
    block: Any = document.get(edit.block)
    several = isinstance(block, tomlkit.items.AoT)
    if several and edit.number < len(block):
        block = block[edit.number]
    elif several or (edit.number and block is not None):
        message = f"there is no {edit.name.rpartition('.')[0]}"
        raise ValueError(message)
    place = wanted.setdefault(edit.block, {})
    if isinstance(place, list):
        place = place[edit.number]
    place[edit.field] = edit.value
    if block is not None and edit.field in block:
        if block[edit.field] == edit.value:
            return text
        before = block[edit.field]
        gap, long = before.trivia.comment_ws, len(before.as_string())
        block[edit.field] = edit.value
        if not isinstance(block, tomlkit.items.InlineTable):  # it is one line, and holds no comments
            now = block[edit.field]
            if not now.trivia.comment or _SOURCE_COMMENT.match(now.trivia.comment):
                now.comment(edit.why)
            # Comments that stand below each other stay so.
            now.trivia.comment_ws = " " * max(len(gap) + long - len(now.as_string()), 2)
        result = tomlkit.dumps(document)
    else:
        line = f"{toml_line(edit.field, edit.value)}  # {edit.why}"
        result = _inserted(text, edit, line, missing=block is None)
    if tomllib.loads(result) != wanted:
        message = f"{edit.name} cannot be written where {edit.block} is not under a heading of its own"
        raise ValueError(message)
    return result


def _inserted(text: str, edit: Edit, line: str, *, missing: bool) -> str:
    """Insert a new line below its block's heading: tomlkit would put it below the comments of the next block."""
    if missing:
        gap = "" if not text or text.endswith("\n") else "\n"
        return f"{text}{gap}\n[{edit.block}]\n{line}\n"
    heading = re.compile(
        rf"^[ \t]*\[{{1,2}}[ \t]*{re.escape(edit.block)}[ \t]*\]{{1,2}}[^\n]*(\r?\n|\Z)", re.MULTILINE
    )
    headings = list(heading.finditer(text))
    if edit.number >= len(headings):
        return text
    at, end = headings[edit.number].end(), headings[edit.number][1]
    return f"{text[:at]}{'' if end else chr(10)}{line}{end or chr(10)}{text[at:]}"

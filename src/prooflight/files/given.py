"""Files that a user names, read whole: ordinary files only, no larger than their kind ever is, and text as text."""

from __future__ import annotations

import codecs
import os
import stat
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.errors import InputError

_UTF16_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


@dataclass(frozen=True, slots=True, kw_only=True)
class GivenFiles:
    """A kind of file, and what is said of one that cannot be of that kind."""

    error: type[InputError]
    remedy: str
    largest_mb: float
    """Far more than such a file ever has; what it becomes in memory is some 30 times as large."""

    def read(self, path: Path) -> bytes:
        """All bytes. ``error``: no ordinary file (a pipe would be waited for, a device never ends), or too large.

        OSError: the system cannot open it.
        """
        try:
            descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except ValueError:  # a NUL or half a surrogate pair
            raise self.error(path, "is no file name", remedy=self.remedy) from None
        try:
            mode = os.fstat(descriptor).st_mode
            if not stat.S_ISREG(mode):
                kind = "a folder" if stat.S_ISDIR(mode) else "no ordinary file"
                raise self.error(path, f"cannot be read: it is {kind}", remedy=self.remedy)
            with open(descriptor, "rb", closefd=False) as file:
                data = file.read(self.most_bytes + 1)
        finally:
            os.close(descriptor)
        return self.bounded(data, where=path)

    def bounded(self, data: bytes, *, where: object) -> bytes:
        """``data``, if it is no larger than such a file ever is; ``error`` otherwise."""
        if len(data) > self.most_bytes:
            raise self.error(where, f"is larger than {self.largest_mb:g} MB", remedy=self.remedy)
        return data

    def read_text(self, path: Path, *, any_encoding: bool = False) -> str:
        r"""All text, lines ending in ``\n``; see ``text``."""
        return self.text(self.read(path), where=path, any_encoding=any_encoding)

    def text(self, data: bytes, *, where: object, any_encoding: bool = False) -> str:
        """UTF-8, with or without a mark; ``error`` if it is something else or holds NUL.

        any_encoding: UTF-16 that says so as well, and Latin-1 else, which older programs write and in which any byte is
        a letter.
        """
        try:
            text = data.decode("utf-16" if any_encoding and data.startswith(_UTF16_MARKS) else "utf-8-sig")
        except UnicodeDecodeError:
            if not any_encoding:
                raise self.error(where, "is not text", remedy=self.remedy) from None
            text = data.decode("latin-1")
        if "\x00" in text:
            raise self.error(where, "is binary, not text", remedy=self.remedy)
        return text.replace("\r\n", "\n").replace("\r", "\n")

    @property
    def most_bytes(self) -> int:
        """No file of this kind has more."""
        return int(self.largest_mb * 1_000_000)


def shortly(text: str) -> str:
    """What a file or an argument holds, for a message: its beginning will do."""
    return text if len(text) <= 60 else f"{text[:60]}..."

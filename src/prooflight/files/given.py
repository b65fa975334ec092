"""Bounded reading of files that a user names: regular files only, of limited size, and text decoded as text."""

from __future__ import annotations

import codecs
import os
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from prooflight.errors import InputError

_UTF16_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


@dataclass(frozen=True, slots=True, kw_only=True)
class GivenFiles:
    """A kind of file, with the error that is raised for a file that cannot be of that kind."""

    error: type[InputError]
    remedy: str
    largest_mb: float
    """Size far above that of any such file; in memory it takes some 30 times as much."""

    def read(self, path: Path) -> bytes:
        """Return all bytes.

        ``error``: not a regular file (a pipe would block, a device never ends), or too large. OSError: the
        system cannot open it.
        """
        try:
            descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except ValueError:  # a NUL or half a surrogate pair
            raise self.error(path, "is not a file name", remedy=self.remedy) from None
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
        """Return ``data`` if it is within the size limit; ``error`` otherwise."""
        if len(data) > self.most_bytes:
            raise self.error(where, f"is larger than {self.largest_mb:g} MB", remedy=self.remedy)
        return data

    def read_text(self, path: Path, *, any_encoding: bool = False) -> str:
        r"""Return all text, with lines ending in ``\n``; see ``text``."""
        return self.text(self.read(path), where=path, any_encoding=any_encoding)

    def text(self, data: bytes, *, where: object, any_encoding: bool = False) -> str:
        """Decode UTF-8 with or without a byte order mark; ``error`` if it is something else or contains NUL.

        any_encoding: also decode UTF-16 with a byte order mark, and Latin-1 otherwise, which older programs
        write and in which any byte is a letter.
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
        """Size limit in bytes."""
        return int(self.largest_mb * 1_000_000)


def shortly(text: str) -> str:
    """Shorten the contents of a file or an argument for a message to their beginning."""
    return text if len(text) <= 60 else f"{text[:60]}..."

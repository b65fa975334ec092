"""What may be given as a file of text, and what is said of the rest."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import pytest

from prooflight.errors import RequestError
from prooflight.files.given import GivenFiles, shortly

if TYPE_CHECKING:
    from pathlib import Path

NOTES = GivenFiles(error=RequestError, remedy="give notes", largest_mb=0.001)


def refused(path: Path, *, any_encoding: bool = False) -> str:
    with pytest.raises(RequestError) as refusal:
        NOTES.read_text(path, any_encoding=any_encoding)
    return str(refusal.value)


@pytest.mark.parametrize("data", [b"a\nb", b"a\r\nb", b"a\rb", b"\xef\xbb\xbfa\nb"])
def test_text_with_any_line_end(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "x").write_bytes(data)
    assert NOTES.read_text(tmp_path / "x") == "a\nb"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "latin-1"])
def test_older_encodings_where_they_are_met(tmp_path: Path, encoding: str) -> None:
    (tmp_path / "x").write_bytes("Grün".encode(encoding))
    assert NOTES.read_text(tmp_path / "x", any_encoding=True) == "Grün"
    if encoding != "utf-8":
        assert "is not text" in refused(tmp_path / "x")


@pytest.mark.parametrize("data", [b"a\x00b", "a".encode("utf-16-le")])
def test_binary_files(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "x").write_bytes(data)
    assert "is binary, not text" in refused(tmp_path / "x", any_encoding=True)


def test_as_large_as_may_be_and_larger(tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"a" * 1000)
    assert len(NOTES.read_text(tmp_path / "x")) == 1000
    (tmp_path / "x").write_bytes(b"a" * 1001)
    assert refused(tmp_path / "x") == f"{tmp_path / 'x'}: is larger than 0.001 MB; give notes"


def test_what_is_no_ordinary_file_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    assert "is no ordinary file" in refused(tmp_path / "pipe")
    assert "is no ordinary file" in refused(tmp_path.joinpath("/dev/zero"))
    assert "is a folder" in refused(tmp_path)
    assert "is not a file name" in refused(tmp_path / "a\x00b")
    with pytest.raises(FileNotFoundError):
        NOTES.read(tmp_path / "none")


def test_long_values_are_cut() -> None:
    assert shortly("a" * 60) == "a" * 60
    assert shortly("[" * 100_000) == "[" * 60 + "..."

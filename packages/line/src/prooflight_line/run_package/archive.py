"""An archive whose every byte is signed: a ZIP file with the signature as its comment, which comes last.

Members are written one by one and never all in memory. Times, owners and the order of members are fixed, so that the
same members give the same bytes.
"""

from __future__ import annotations

import hashlib
import os
import struct
import zipfile
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from prooflight.errors import RequestError
from prooflight.files.atomic import whole_file
from prooflight_line.journal.schema import json_text
from prooflight_line.run_package.signing import Signature

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from pathlib import Path

    from prooflight_line.run_package.signing import SigningKey

FORMAT: Final = 1
MANIFEST: Final = "manifest.json"
SIGNED_COMMENT: Final = f"Prooflight run package, format {FORMAT}"
PIECE: Final = 1 << 20
_BEGAN: Final = (1980, 1, 1, 0, 0, 0)
"""Earliest time that a ZIP file can state: the archive states no other, so that its bytes depend on no clock."""
_MODE: Final = 0o100644 << 16
_END: Final = struct.Struct("<4s4H2LH")
_MOST_COMMENT: Final = 2048
REMEDY: Final = "give an archive that `prooflight run package` wrote"


@dataclass(frozen=True, slots=True, kw_only=True)
class Member:
    """A file of the archive, whose content is read when it is written."""

    path: str
    content: Iterable[bytes]
    packed: bool = True
    """Whether deflate makes it smaller; False: it is compressed already."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Listed:
    """A file of the archive as its manifest states it."""

    path: str
    bytes: int
    sha256: str


def write_archive(
    out: Path, members: Iterable[Member], key: SigningKey, *, facts: Callable[[], Mapping[str, Any]]
) -> list[Listed]:
    """Write and sign an archive; return its members. OSError, or an error of a member: no file is left.

    Parameters
    ----------
    facts : gives values of JSON that the manifest states beside its members, when the last of them is written
    """
    listed: list[Listed] = []
    with whole_file(out) as unfinished:
        with zipfile.ZipFile(unfinished, "w") as archive:
            for member in members:
                listed.append(_add(archive, member))
            manifest = {"format": FORMAT, **facts(), "members": listed}
            text = json_text(manifest) + "\n"
            _add(archive, Member(path=MANIFEST, content=[text.encode()]))
            archive.comment = key.sign(b"", comment=SIGNED_COMMENT).text  # of the length that it will have
        comment = len(archive.comment)
        digest = _digest(unfinished, unfinished.stat().st_size - comment)
        with unfinished.open("r+b") as file:
            file.seek(-comment, os.SEEK_END)
            file.write(key.sign(digest, comment=SIGNED_COMMENT).text)
            file.flush()
            os.fsync(file.fileno())
    return listed


def signature_of(path: Path) -> tuple[Signature, bytes]:
    """Return the signature of an archive, and the BLAKE2b-512 digest of all bytes before it.

    RequestError: the file is not a ZIP file, or its comment is no signature.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        file.seek(max(size - _MOST_COMMENT, 0))
        tail = file.read(_MOST_COMMENT)
    at = tail.rfind(b"PK\x05\x06")
    if at < 0 or len(tail) - at < _END.size:
        raise RequestError(path, "is not a ZIP file, or its end is missing", remedy=REMEDY)
    comment = tail[at + _END.size :]
    try:
        signature = Signature.parse(comment)
    except ValueError as error:
        raise RequestError(path, "has no signature, or a damaged one", remedy=REMEDY) from error
    return signature, _digest(path, size - len(comment))


def pieces_of(path: Path) -> Iterator[bytes]:
    """Yield the content of a file in pieces."""
    with path.open("rb") as file:
        while piece := file.read(PIECE):
            yield piece


def _add(archive: zipfile.ZipFile, member: Member) -> Listed:
    info = zipfile.ZipInfo(member.path, _BEGAN)
    info.create_system, info.external_attr = 3, _MODE
    info.compress_type = zipfile.ZIP_DEFLATED if member.packed else zipfile.ZIP_STORED
    sha, size = hashlib.sha256(), 0
    with archive.open(info, "w", force_zip64=True) as file:
        for piece in member.content:
            sha.update(piece)
            size += len(piece)
            file.write(piece)
    return Listed(path=member.path, bytes=size, sha256=sha.hexdigest())


def _digest(path: Path, size: int) -> bytes:
    """Return the BLAKE2b-512 digest of a file's first bytes."""
    digest, left = hashlib.blake2b(), size
    with path.open("rb") as file:
        while left and (piece := file.read(min(PIECE, left))):
            digest.update(piece)
            left -= len(piece)
    return digest.digest()

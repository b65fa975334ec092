"""Digests of what files and folders hold."""

from __future__ import annotations

import hashlib
from pathlib import Path


def content_digest(path: Path) -> str:
    """Return the SHA-256 of a file, or of all files in a folder with their names."""
    sha = hashlib.sha256()
    files = sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]
    for file in files:
        named = f"{file.relative_to(path).as_posix()} {file.stat().st_size}\n"
        sha.update(named.encode("utf-8", "surrogateescape"))
        with file.open("rb") as content:
            while piece := content.read(1 << 20):
                sha.update(piece)
    return sha.hexdigest()

"""Digest of the program, by which results that it stored are found again by the same program alone."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Final

CALCULATING: Final = ("numpy", "scipy", "numba", "opencv-python-headless")
"""Libraries whose versions may change the last digits of what is computed."""


@cache
def program_digest(package: str = "prooflight") -> str:
    """Return the SHA-256 of a package's files and of the versions of the libraries that it calculates with."""
    root = Path(str(files(package)))
    sha = hashlib.sha256("".join(f"{name} {version(name)}\n" for name in CALCULATING).encode())
    for path in sorted(root.rglob("*")):
        if path.is_file() and path.suffix in {".py", ".toml", ".safetensors", ".json"}:
            sha.update(path.relative_to(root).as_posix().encode())
            sha.update(path.read_bytes())
    return sha.hexdigest()

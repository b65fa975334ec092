"""Digest of the program, by which results that it stored are found again by the same program alone."""

from __future__ import annotations

import hashlib
import os
import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path
from typing import Final

CALCULATING: Final = ("numpy", "scipy", "numba", "opencv-python-headless")
"""Libraries whose versions may change the last digits of what is computed."""
READING: Final = ("pymupdf", "zxing-cpp", "pillow", "tifffile")
"""Libraries whose versions may change what is drawn of a page, or which codes are read on it."""


@cache
def program_digest(package: str = "prooflight") -> str:
    """Return the SHA-256 of a package's files and of the versions of the libraries that it calculates with."""
    root = Path(str(files(package)))
    sha = hashlib.sha256("".join(f"{name} {version(name)}\n" for name in CALCULATING).encode())
    for folder, folders, names in os.walk(root):
        folders[:] = sorted(set(folders) - {"__pycache__"})  # compiled kernels are thousands of files
        for path in (Path(folder, name) for name in sorted(names)):
            if path.suffix in {".py", ".toml", ".safetensors", ".json"}:
                sha.update(path.relative_to(root).as_posix().encode())
                sha.update(path.read_bytes())
    return sha.hexdigest()


@cache
def program_parts(*packages: str) -> dict[str, str]:
    """Return all that results depend on besides their input, by name: Python, libraries, and the files of packages.

    Libraries come first: a digest of files says nothing to a person.
    """
    libraries = {name: installed_version(name) for name in (*CALCULATING, *READING)}
    files_of = {f"files of {package}": program_digest(package)[:12] for package in packages}
    own = {"prooflight": version("prooflight")}
    return {"Python": platform.python_version(), **libraries, **own, **files_of}


def installed_version(library: str) -> str:
    """Return the version of a library; empty if it is not installed."""
    try:
        return version(library)
    except PackageNotFoundError:
        return ""

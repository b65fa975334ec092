"""Folders of a user's files: by the XDG base directory specification, or as Windows has them."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Final, Literal

XDG: Final = {
    "cache": ("XDG_CACHE_HOME", ".cache"),
    "data": ("XDG_DATA_HOME", ".local/share"),
    "state": ("XDG_STATE_HOME", ".local/state"),
}
"""Variable that names the base folder of each kind, and that folder within the user's home without it."""


def user_folder(kind: Literal["cache", "data", "state"]) -> Path:
    """Return the folder of Prooflight's files of a kind; it need not exist.

    Raises
    ------
    RuntimeError
        If the user has no home folder.
    """
    variable, within_home = XDG[kind]
    if sys.platform == "win32":
        variable, within_home = "LOCALAPPDATA", "AppData/Local"
    return Path(os.environ.get(variable) or Path.home() / within_home) / "prooflight"

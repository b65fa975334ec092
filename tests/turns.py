"""Turns of the processes that run tests, where all of them need a file that takes long to make."""

from __future__ import annotations

import fcntl
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@contextmanager
def in_turn(path: Path) -> Iterator[None]:
    """Let no other process make this file meanwhile; whoever comes next sees what was made."""
    with path.with_name(f"{path.name}.lock").open("w") as turn:
        fcntl.flock(turn, fcntl.LOCK_EX)
        yield

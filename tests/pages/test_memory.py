"""Available memory: what the system states, and what a container's limit leaves."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from prooflight.pages.memory import available_bytes

if TYPE_CHECKING:
    from pathlib import Path

GIB = 2**30


@pytest.mark.parametrize(
    ("limit", "expected"), [(None, 8 * GIB), ("max", 8 * GIB), (str(4 * GIB), 3 * GIB), (str(GIB // 2), 0)]
)
def test_a_containers_limit_counts(tmp_path: Path, limit: str | None, expected: float) -> None:
    """Of 2 GiB in use one is a file that may be dropped."""
    (tmp_path / "proc").mkdir()
    (tmp_path / "proc/meminfo").write_text(f"MemTotal: 16777216 kB\nMemAvailable: {8 * GIB // 1024} kB\n")
    if limit is not None:
        group = tmp_path / "sys/fs/cgroup"
        group.mkdir(parents=True)
        (group / "memory.max").write_text(f"{limit}\n")
        (group / "memory.current").write_text(f"{2 * GIB}\n")
        (group / "memory.stat").write_text(f"anon {GIB}\ninactive_file {GIB}\n")
    assert available_bytes(tmp_path) == expected


def test_memory_that_is_not_reported_is_taken_to_suffice(tmp_path: Path) -> None:
    assert available_bytes(tmp_path) == math.inf

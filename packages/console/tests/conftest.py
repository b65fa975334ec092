"""A console on a journal with one run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from packages.console.tests.consoles import Served, served

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture
def console(tmp_path: Path) -> Iterator[Served]:
    made = served(tmp_path)
    yield made
    made.close()

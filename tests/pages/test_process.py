"""How worker processes are set; in one of their own, since it is for good."""

from __future__ import annotations

import subprocess
import sys
from contextlib import suppress
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING

from prooflight.pages import process
from prooflight.pages.process import collector_spared

if TYPE_CHECKING:
    import pytest

SETTLED = """
from prooflight.pages.process import settle_process
settle_process()
import cv2
from threadpoolctl import threadpool_info
found = [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]
assert found and set(found) == {1}, found
assert cv2.getNumThreads() == 1
"""


def test_pages_share_the_cores_and_libraries_start_no_threads() -> None:
    subprocess.run([sys.executable, "-c", SETTLED], check=True, timeout=120)


def test_what_is_there_is_not_looked_through_until_the_run_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """Left frozen, the cycles of every run of a process would stay for ever."""
    asked: list[str] = []
    steps = {name: partial(asked.append, name) for name in ("collect", "freeze", "unfreeze")}
    monkeypatch.setattr(process, "gc", SimpleNamespace(**steps))
    with suppress(ValueError), collector_spared():
        assert asked == ["collect", "freeze"]
        raise ValueError("the run fails")
    assert asked == ["collect", "freeze", "unfreeze"]

"""A console on a journal with one run."""

from __future__ import annotations

import multiprocessing
from typing import TYPE_CHECKING, Any, Final

import pytest
from packages.console.tests.consoles import Served, served

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


LOADED: Final = [
    "packages.console.tests.zone_prices",
    "packages.console.tests.engineering_steps",
    "prooflight_console.pictures.pictures",
    "prooflight_console.zones.pricing",
]


@pytest.fixture(scope="session", autouse=True)
def processes_fork_from_one() -> Iterator[None]:
    """Fork pictures and prices from a process that has loaded what they need; each would load it for 3 s."""
    get_context = multiprocessing.get_context
    loaded = get_context("forkserver")
    loaded.set_forkserver_preload(LOADED)

    def context(method: str | None = None) -> Any:
        return loaded if method == "spawn" else get_context(method)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(multiprocessing, "get_context", context)
        yield


@pytest.fixture
def console(tmp_path: Path) -> Iterator[Served]:
    made = served(tmp_path)
    yield made
    made.close()

"""Kernels compiled by a process beside."""

from __future__ import annotations

import multiprocessing
import pickle
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.commissioning.training import train
from prooflight.commissioning.training.train import compile_in_background, score_unlocated
from prooflight.kernels.cache import is_cached
from prooflight.kernels.compiled import kernel

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.simulation.corpus.corpus import Designs


class OnePage:
    """Designs that are all one."""

    def __init__(self, page: Page) -> None:
        self.dpi, self._page = page.dpi, page

    def page(self, number: int) -> Page:
        return self._page


class Started:
    """Stands in for processes: notes what they would do."""

    def __init__(self) -> None:
        self.work: list[tuple[object, ...]] = []

    def Process(self, *, target: Callable[..., None], args: tuple[object, ...], daemon: bool) -> Started:
        assert daemon, "it must end with the process that started it"
        self.work.append((target, *args))
        return self

    def start(self) -> None:
        """Nothing."""


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> Started:
    found = Started()
    monkeypatch.setattr(multiprocessing, "get_context", lambda _way: found)
    monkeypatch.setattr(train.os, "cpu_count", lambda: 2)
    return found


def test_a_page_is_weighed_up_to_its_score(press: Press, make_page: Callable[..., Page]) -> None:
    """So that all kernels from the fit to the ranking are called; whatever the score of an untaught press is."""
    assert np.isfinite(score_unlocated(press, press.geometry.lay(make_page(1))))


@pytest.mark.parametrize(("kept", "processes"), [(True, 0), (False, 1)])
def test_only_where_nothing_is_compiled(
    kept: bool,
    processes: int,
    press: Press,
    make_page: Callable[..., Page],
    started: Started,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(train, "is_cached", lambda _kernel: kept)
    pages: Designs = OnePage(make_page(1))
    compile_in_background(press, pages)
    assert len(started.work) == processes
    assert all(pickle.loads(pickle.dumps(given))[0] is given[0] for given in started.work)


def test_not_where_there_is_one_processor(
    press: Press, make_page: Callable[..., Page], started: Started, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(train, "is_cached", lambda _kernel: False)
    monkeypatch.setattr(train.os, "cpu_count", lambda: 1)
    compile_in_background(press, OnePage(make_page(1)))
    assert not started.work


def test_what_was_compiled_is_known() -> None:
    from prooflight.kernels.residuals.residuals import take_columns

    image, gains = np.ones((4, 6), np.float32), np.ones(6, np.float32)
    take_columns(image.copy(), image, image, gains, 0, 4)
    assert is_cached(take_columns)
    assert not is_cached(kernel("image (L)")(lambda image: image[0]))

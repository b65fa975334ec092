"""Processes aside that cannot start, or end before they are done: one line for people, and the next one starts."""

from __future__ import annotations

import errno
import logging
import multiprocessing
import os
import signal
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from packages.console.tests.consoles import served
from packages.console.tests.test_zones import job_of

from prooflight_console.accounts.roles import Role
from prooflight_console.child_process import FAULT, FULL, result_or_refusal

if TYPE_CHECKING:
    from collections.abc import Iterator

    from packages.console.tests.consoles import Served

PYTHON_S_OWN = ("terminated abruptly", "process pool", "Errno", "Error", "Traceback", "future")


def one_line(text: str, *named: str) -> None:
    assert "\n" not in text
    assert not [word for word in PYTHON_S_OWN if word in text], text
    for word in (*named, "try again"):
        assert word in text


@pytest.fixture
def console(tmp_path: Path) -> Iterator[Served]:
    with closing(served(tmp_path, jobs=(job_of(tmp_path),))) as made:
        yield made


def refuse_to_start(_self: object) -> None:
    raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))


def vanish(*_given: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_picture_whose_process_dies_is_told_in_one_line_and_the_next_is_drawn(
    console: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    viewer, page = console.client(Role.VIEWER), "/api/v1/jobs/1/pages/1/picture"
    with monkeypatch.context() as patch:
        patch.setattr("prooflight_console.zones.rasters.make_tiles", vanish)
        answer = viewer.get(page)
    assert (answer.status_code, answer.json()["type"]) == (503, "urn:prooflight:no-process")
    one_line(answer.json()["detail"], "the process that draws pages ended", "memory")
    assert viewer.get(page).status_code == 200


def test_a_process_that_was_ended_while_nobody_asked_costs_no_picture(console: Served) -> None:
    with pytest.raises(BrokenProcessPool):
        console.console.pictures._workers().submit(vanish).result()
    viewer = console.client(Role.VIEWER)
    assert viewer.get("/api/v1/jobs/1/pages/1/picture").status_code == 200


def test_a_picture_whose_process_cannot_start_is_told_in_one_line(
    console: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(multiprocessing.get_context("spawn").Process, "start", refuse_to_start)
    answer = console.client(Role.VIEWER).get("/api/v1/jobs/1/pages/1/picture")
    assert answer.status_code == 503
    one_line(answer.json()["detail"], "no process can be started")


def test_a_picture_that_fails_without_words_of_ours_names_its_page(
    console: Served, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        monkeypatch.setattr(console.console.pictures, "aside", lambda *_: [].index(3))
        answer = console.client(Role.VIEWER).get("/api/v1/jobs/1/pages/1/picture")
    assert answer.status_code == 409
    assert answer.json()["detail"].startswith("page 1 of letter.tif could not be drawn")
    assert "is not in list" not in answer.json()["detail"]
    assert "is not in list" in caplog.text


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (MemoryError(), FULL),
        (KeyError("tables"), FAULT),
        (
            OSError(errno.EIO, os.strerror(errno.EIO), "a.press"),
            "(Input/output error: a.press)",
        ),
    ],
)
def test_why_a_computation_fails_is_stated_in_words(error: Exception, told: str) -> None:
    def fails() -> str:
        raise error

    why = result_or_refusal(fails, lambda reason: reason, what="a price")
    assert told in why
    assert type(error).__name__ not in why

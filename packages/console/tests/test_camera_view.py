"""What a watched camera sees, in the console: asked for while somebody looks, and nothing where nobody watches."""

from __future__ import annotations

import base64
import json
import os
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest
from packages.console.tests.consoles import Served

from prooflight.scans.lines import LineBlock, LineFault
from prooflight_console.accounts.roles import Role
from prooflight_console.pages.camera import HEIGHT, WIDTH, _current_view, camera_html
from prooflight_console.pages.language import language
from prooflight_line.cli.watch.camera_view import WINDOW_LINES, ShownLines, picture_of
from prooflight_line.journal.camera_view import ASKED, FRESH_S, MOST_BYTES, SHOWN, CameraExchange

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from prooflight.press.artefact import Press

TOLD: dict[str, Any] = {
    "camera": "<b>drum:5</b>",
    "press": "rig",
    "lines": 1024,
    "lines_seen": 99_000,
    "lines_lost": 1000,
    "lines_per_s": 2750.0,
    "top_code_dn": 4095,
    "width_mm": 250.0,
    "sensors": [
        {
            "name": "red",
            "mean_dn": [0.0, 4095.0],
            "paper_dn": [4095.0, 9000.0],
            "saturated_share": 0.25,
            "black_dn": 80.0,
            "noise_dn": 2.5,
            "flatness": 0.91,
            "focus_by": "still edges",
            "mtf50_across": 0.213,
            "mtf50_along": None,
        }
    ],
}


class Lines:
    """Two sensors' blocks: paper with a dark stripe, one block with lines lost before it."""

    def __init__(self, press: Press, blocks: int) -> None:
        self.sensors, self.pixels = len(press.sensors), press.geometry.pixels
        self._blocks, self.closed = blocks, False

    def blocks(self) -> Iterator[LineBlock]:
        for at in range(self._blocks):
            lines = np.full((self.sensors, 64, self.pixels), 3000, np.uint16)
            lines[:, :, : self.pixels // 2] = 1000
            fault = LineFault(kind="lost-blocks", first_line=64 * at, lines=5, detail="")
            yield LineBlock(first_line=64 * at, lines=lines, time_s=0.0, faults=(fault,) if at == 3 else ())

    def close(self) -> None:
        self.closed = True


def test_one_saturated_column_is_red_in_the_picture() -> None:
    lines = np.full((512, 7296), 2000, np.uint16)
    lines[:, 1000] = 4095
    encoded = np.frombuffer(base64.b64decode(picture_of(lines, 4095)), np.uint8)
    picture = cv2.imdecode(encoded, cv2.IMREAD_COLOR)
    red = picture[..., 2].astype(int) - picture[..., 0] > 100
    assert red.any(axis=0).sum() == 1
    assert red.all(axis=0).sum() == 1
    assert (picture[~red] == round(2000 / 4095 * 255)).all()
    assert picture_of(lines[:3], 4095) == ""


def test_a_picture_that_is_none_is_not_shown() -> None:
    view = {**TOLD, "sensors": [{**TOLD["sensors"][0], "picture": '"><script>'}]}
    html = camera_html(view, language("en"))
    assert "<img" not in html
    assert "script" not in html


@pytest.mark.parametrize("code", ["en", "de"])
def test_a_view_is_drawn_with_its_numbers(code: str) -> None:
    html = camera_html(TOLD, language(code))
    assert "&lt;b&gt;drum:5&lt;/b&gt;" in html
    assert f'points="{WIDTH / 4:.1f},{HEIGHT:.1f} {3 * WIDTH / 4:.1f},0.0"' in html
    assert html.count('class="bad"') == 2, "saturation, and lines that were lost"
    assert "50" in html
    assert ("25.000 %" in html) == (code == "en")
    assert "0.213" in html or "0,213" in html


def test_where_nobody_watches_it_says_how_to_look(tmp_path: Path) -> None:
    exchange = CameraExchange(journal=tmp_path / "runs.sqlite")
    assert _current_view(exchange, language("en"), waited=False) == ""
    assert (tmp_path / f"runs.sqlite{ASKED}").exists()
    assert "prooflight camera view" in _current_view(exchange, language("en"), waited=True)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"top_code_dn": "x"}', '{"sensors": 7}', "\x00"])
def test_a_file_that_is_none_of_ours_is_no_view(tmp_path: Path, text: str) -> None:
    exchange = CameraExchange(journal=tmp_path / "runs.sqlite")
    (tmp_path / f"runs.sqlite{SHOWN}").write_text(text)
    assert "prooflight camera view" in _current_view(exchange, language("en"), waited=True)


def test_what_is_old_is_not_now(tmp_path: Path) -> None:
    path = tmp_path / "runs.sqlite"
    now = [1_000_000.0]
    exchange = CameraExchange(journal=path, clock=lambda: now[0])
    exchange.ask()
    exchange.write(TOLD)
    for suffix in (SHOWN, ASKED):
        os.utime(tmp_path / f"runs.sqlite{suffix}", (now[0], now[0]))
    assert exchange.is_requested()
    assert exchange.read() == TOLD
    now[0] += FRESH_S + 1
    assert not exchange.is_requested()
    assert exchange.read() is None
    exchange.clear()
    assert list(tmp_path.iterdir()) == []


def test_lines_pass_unchanged_and_the_last_are_shown(tmp_path: Path, press: Press) -> None:
    exchange = CameraExchange(journal=tmp_path / "runs.sqlite")
    source = Lines(press, blocks=30)
    shown = ShownLines(source, exchange=exchange, press=press, name="drum:5")
    assert shown.current_view() is None
    passed = list(shown.blocks())
    assert sum(block.lines.shape[1] for block in passed) == 30 * 64
    told = shown.current_view()
    assert told is not None
    assert (told["lines"], told["lines_seen"], told["lines_lost"]) == (WINDOW_LINES, 30 * 64, 5)
    first = told["sensors"][0]
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(first["picture"]), np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape[1] <= 480
    assert (picture[..., 0] == picture[..., 2]).all(), "nothing is saturated"
    assert (first["mean_dn"][0], first["mean_dn"][-1]) == (1000.0, 3000.0)
    assert first["saturated_share"] == 0
    assert len(json.dumps(told)) < MOST_BYTES / 10
    assert "drum:5" in camera_html(json.loads(json.dumps(told)), language("en"))
    shown.close()
    assert source.closed


def test_nothing_is_written_until_somebody_looks(tmp_path: Path, press: Press) -> None:
    import threading

    wrote = threading.Event()
    looks = threading.Semaphore(0)

    class Exchange(CameraExchange):
        asking = False

        def is_requested(self) -> bool:
            looks.release()
            return self.asking

        def write(self, told: dict[str, Any]) -> None:
            super().write(told)
            wrote.set()

    exchange = Exchange(journal=tmp_path / "runs.sqlite")
    source = Lines(press, blocks=2)
    with ShownLines(source, exchange=exchange, press=press, name="drum", poll_s=0.001) as shown:
        list(shown.blocks())
        for _ in range(3):
            assert looks.acquire(timeout=30)
        assert not wrote.is_set()
        Exchange.asking = True
        assert wrote.wait(30)
        assert exchange.read() is not None
    assert list(tmp_path.iterdir()) == [], "the run has ended"


def test_the_view_is_for_whoever_may_look(console: Served) -> None:
    assert console.client().get("/setup/camera/events", follow_redirects=False).status_code == 303
    page = console.client(Role.VIEWER).get("/setup").text
    assert 'data-events="/setup/camera/events"' in page


def test_a_program_asks_for_the_view_and_gets_it(console: Served) -> None:
    client = console.client(Role.VIEWER)
    assert client.get("/api/v1/camera").json() == {"seen": None}
    exchange = CameraExchange(journal=console.journal)
    assert exchange.is_requested()
    exchange.write(TOLD)
    assert client.get("/api/v1/camera").json()["seen"]["sensors"][0]["saturated_share"] == 0.25

from __future__ import annotations

import io
import socket
import threading
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.errors import RequestError, ScanError
from prooflight.scans.lines import LineBlock, LineFault, check_block
from prooflight.scans.raw import HEADER, RawLines, open_raw, write_block

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

SENSORS, PIXELS = 2, 24


class Trickle(io.RawIOBase):
    """Bytes that come a few at a time, as from a pipe."""

    def __init__(self, data: bytes, steps: list[int]) -> None:
        self._data, self._steps, self._turn = data, steps, 0

    def readable(self) -> bool:
        return True

    def read(self, size: int = -1, /) -> bytes:
        step = self._steps[self._turn % len(self._steps)]
        self._turn += 1
        taken = self._data[: min(size, step)]
        self._data = self._data[len(taken) :]
        return taken


def lines(count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.integers(0, 4096, (SENSORS, count, PIXELS), dtype=np.uint16)


def plain(data: np.ndarray) -> bytes:
    """Line by line, sensor by sensor, least byte first."""
    return data.transpose(1, 0, 2).astype("<u2").tobytes()


def framed(*blocks: LineBlock) -> bytes:
    stream = io.BytesIO()
    for block in blocks:
        write_block(stream, block)
    return stream.getvalue()


def source(stream: object, *, framed: bool = False, block_lines: int = 7) -> RawLines:
    return RawLines(
        stream,  # type: ignore[arg-type]
        name="pipe",
        sensors=SENSORS,
        pixels=PIXELS,
        framed=framed,
        block_lines=block_lines,
        clock=lambda: 5.0,
    )


def refused(data: bytes, *, framed: bool = False) -> str:
    with pytest.raises(ScanError) as caught:
        list(source(io.BytesIO(data), framed=framed).blocks())
    assert "\n" not in str(caught.value)
    return str(caught.value)


@given(
    count=st.integers(1, 40),
    block_lines=st.integers(1, 50),
    steps=st.lists(st.integers(1, 300), min_size=1, max_size=5),
)
def test_plain_lines_arrive_whatever_pieces_they_come_in(
    count: int, block_lines: int, steps: list[int]
) -> None:
    sent = lines(count)
    blocks = list(source(Trickle(plain(sent), steps), block_lines=block_lines).blocks())
    np.testing.assert_array_equal(np.concatenate([block.lines for block in blocks], axis=1), sent)
    assert [block.first_line for block in blocks] == list(range(0, count, block_lines))
    assert all(block.time_s == 5.0 for block in blocks)
    for block in blocks:
        check_block(block, sensors=SENSORS, pixels=PIXELS)


@given(
    sizes=st.lists(st.integers(1, 9), min_size=1, max_size=6),
    steps=st.lists(st.integers(1, 200), min_size=1, max_size=5),
)
def test_framed_blocks_arrive_with_their_count_and_time(sizes: list[int], steps: list[int]) -> None:
    sent = [
        LineBlock(first_line=1000 * n, lines=lines(size, n), time_s=0.25 * n) for n, size in enumerate(sizes)
    ]
    found = list(source(Trickle(framed(*sent), steps), framed=True).blocks())
    assert [(block.first_line, block.time_s) for block in found] == [
        (block.first_line, block.time_s) for block in sent
    ]
    for a, b in zip(found, sent, strict=True):
        np.testing.assert_array_equal(a.lines, b.lines)


@pytest.mark.parametrize("short", [1, 2, 2 * PIXELS, 4 * PIXELS - 1])
def test_a_plain_stream_that_is_cut_says_where(short: int) -> None:
    text = refused(plain(lines(10))[:-short])
    assert "pipe" in text
    assert "within line 9" in text


def test_a_framed_stream_that_is_cut_says_where() -> None:
    whole = framed(LineBlock(first_line=0, lines=lines(4), time_s=0.0))
    for end in range(1, len(whole)):
        text = refused(whole[:end], framed=True)
        assert "header" in text if end < HEADER.size else f"of {4 * SENSORS * PIXELS * 2} bytes" in text


def test_a_stream_of_another_camera_is_refused_by_name() -> None:
    wide = LineBlock(first_line=0, lines=np.zeros((SENSORS, 3, PIXELS + 1), np.uint16), time_s=0.0)
    text = refused(framed(wide), framed=True)
    assert f"{PIXELS + 1} pixels" in text
    assert f"{PIXELS} pixels" in text
    assert "not the header" in refused(plain(lines(30)), framed=True)


def test_a_header_that_asks_for_gigabytes_is_refused_before_its_lines_come() -> None:
    wide = 8192
    head = HEADER.pack(b"PLLB", SENSORS, wide, 1 << 16, 0, 0.0)
    source = RawLines(io.BytesIO(head), name="stream", sensors=SENSORS, pixels=wide, framed=True)
    with pytest.raises(ScanError, match="not the header"):
        next(iter(source.blocks()))


def test_a_block_of_another_form_is_refused() -> None:
    for array in (np.zeros((1, 4, PIXELS), np.uint16), np.zeros((SENSORS, 4, PIXELS), np.int16)):
        with pytest.raises(ScanError, match=f"line 77.*{SENSORS} sensors x {PIXELS} pixels"):
            check_block(
                LineBlock(first_line=77, lines=array, time_s=0.0),  # type: ignore[arg-type]
                sensors=SENSORS,
                pixels=PIXELS,
            )


def test_a_file_is_read_to_its_end(tmp_path: Path) -> None:
    path = tmp_path / "lines.raw"
    path.write_bytes(plain(lines(200)))
    found = open_raw(str(path), sensors=SENSORS, pixels=PIXELS)
    assert sum(block.lines.shape[1] for block in found.blocks()) == 200
    found.close()


def test_what_cannot_be_opened_is_one_line(tmp_path: Path) -> None:
    for address in (
        str(tmp_path / "none"),
        f"unix:{tmp_path / 'none'}",
        "tcp:localhost",
        "tcp:localhost:1",
        "tcp::5",
    ):
        with pytest.raises(RequestError) as caught:
            open_raw(address, sensors=1, pixels=8)
        assert "\n" not in str(caught.value)


@pytest.fixture(params=["tcp", "unix"])
def listening(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[str, socket.socket]]:
    if request.param == "tcp":
        server = socket.create_server(("127.0.0.1", 0))
        address = f"tcp:127.0.0.1:{server.getsockname()[1]}"
    else:
        server = socket.socket(socket.AF_UNIX)
        server.bind(str(tmp_path / "camera"))
        server.listen()
        address = f"unix:{tmp_path / 'camera'}"
    with server:
        yield address, server


def test_lines_come_over_a_socket(listening: tuple[str, socket.socket]) -> None:
    address, server = listening
    sent = LineBlock(first_line=3, lines=lines(50), time_s=1.5)

    def camera() -> None:
        connection, _ = server.accept()
        with connection, connection.makefile("wb") as stream:
            write_block(stream, sent)

    sender = threading.Thread(target=camera)
    sender.start()
    found = open_raw(address, sensors=SENSORS, pixels=PIXELS, framed=True)
    (block,) = found.blocks()
    sender.join()
    found.close()
    assert (block.first_line, block.time_s) == (3, 1.5)
    np.testing.assert_array_equal(block.lines, sent.lines)


def test_a_closed_source_ends() -> None:
    stream: BinaryIO = io.BytesIO(plain(lines(100)))
    found = source(stream)
    blocks = found.blocks()
    next(blocks)
    found.close()
    found.close()
    assert list(blocks) == []


def test_faults_travel_with_the_block_that_they_precede() -> None:
    lost = LineFault(kind="lost-packets", first_line=7, lines=3, detail="lines 7 to 9 were lost")
    away = LineFault(kind="camera-away", first_line=10, lines=90, detail="away, for 0.1 s — einen Augenblick")
    sent = [
        LineBlock(first_line=0, lines=lines(7), time_s=1.0),
        LineBlock(first_line=100, lines=lines(4), time_s=2.0, faults=(lost, away)),
    ]
    found = list(source(io.BytesIO(framed(*sent)), framed=True).blocks())
    assert [(block.first_line, block.faults) for block in found] == [(0, ()), (100, (lost, away))]
    cut = framed(sent[1])[: HEADER.size + 5]
    assert "ends within the text of a fault" in refused(cut, framed=True)
    unknown = HEADER.pack(b"PLLF", 99, 0, 1, 0, 0.0)
    assert "is not the header of a block" in refused(unknown, framed=True)

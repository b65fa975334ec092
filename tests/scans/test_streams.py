"""Bytes from real pipes and sockets: they come as they come, and nobody waits for what does not."""

from __future__ import annotations

import os
import socket
import struct
import threading
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.errors import RequestError, ScanError
from prooflight.scans.lines import LineBlock
from prooflight.scans.raw import InterruptibleStream, RawLines, open_raw, open_stream, write_block

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PATIENCE_S = 20.0
"""Only a test that fails waits so long."""


@pytest.fixture
def camera() -> Iterator[tuple[str, socket.socket]]:
    """The address of a listening camera, and the camera."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield f"tcp:127.0.0.1:{server.getsockname()[1]}", server


def read_aside(source: RawLines) -> tuple[threading.Thread, list[LineBlock | Exception]]:
    """Read a source to its end in another thread."""
    found: list[LineBlock | Exception] = []

    def read() -> None:
        try:
            found.extend(source.blocks())
        except ScanError as error:
            found.append(error)

    thread = threading.Thread(target=read, daemon=True)
    thread.start()
    return thread, found


@pytest.mark.parametrize("kind", ["socket", "pipe that nobody writes", "pipe whose writer is silent"])
def test_a_silent_source_is_closed_from_another_thread(
    kind: str, camera: tuple[str, socket.socket], tmp_path: Path
) -> None:
    address = camera[0]
    if kind != "socket":
        address = str(tmp_path / "pipe")
        os.mkfifo(address)
    writer = os.open(address, os.O_RDWR) if kind == "pipe whose writer is silent" else None
    source = open_raw(address, sensors=1, pixels=4)
    reading, found = read_aside(source)
    source.close()
    reading.join(PATIENCE_S)
    assert not reading.is_alive()
    assert found == []
    if writer is not None:
        os.close(writer)


def test_lines_that_came_before_the_end_are_given(tmp_path: Path) -> None:
    """A line and a half, then the source is closed: the line is there, and the half is no error."""
    os.mkfifo(tmp_path / "pipe")
    source = open_raw(str(tmp_path / "pipe"), sensors=1, pixels=4)
    with (tmp_path / "pipe").open("wb", buffering=0) as writer:
        writer.write(bytes(12))
        stream = source._stream
        assert isinstance(stream, InterruptibleStream)
        taken = threading.Event()
        read = stream.read

        def noted(most: int) -> bytes:
            if most < 64 * 8:
                taken.set()
            return read(most)

        stream.read = noted  # type: ignore[method-assign]
        reading, found = read_aside(source)
        assert taken.wait(PATIENCE_S)
        source.close()
        reading.join(PATIENCE_S)
    (block,) = found
    assert isinstance(block, LineBlock)
    assert block.lines.shape == (1, 1, 4)


def test_a_pipe_is_waited_for_until_somebody_writes(tmp_path: Path) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    reading, found = read_aside(open_raw(str(path), sensors=1, pixels=4))
    with path.open("wb") as writer:
        writer.write(bytes(80))
    reading.join(PATIENCE_S)
    (block,) = found
    assert isinstance(block, LineBlock)
    assert block.lines.shape == (1, 10, 4)


def test_a_camera_that_hangs_up_ends_its_lines_and_one_that_breaks_off_is_an_error(
    camera: tuple[str, socket.socket],
) -> None:
    block = LineBlock(first_line=0, lines=np.ones((1, 3, 4), np.uint16), time_s=0.0)
    for reset in (False, True):
        source = open_raw(camera[0], sensors=1, pixels=4, framed=True)
        connection, _ = camera[1].accept()
        reading, found = read_aside(source)
        with connection, connection.makefile("wb") as stream:
            write_block(stream, block)
            stream.flush()
            if reset:  # closed without a word: what was not sent is gone
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            else:  # half-closed: the camera would still listen
                connection.shutdown(socket.SHUT_WR)
                reading.join(PATIENCE_S)
        reading.join(PATIENCE_S)
        assert not reading.is_alive()
        errors = [one for one in found if isinstance(one, ScanError)]
        assert len(errors) == reset
        assert not reset or "reset" in str(errors[0])
        source.close()


@pytest.mark.parametrize(
    ("address", "names"),
    [
        ("tcp:a..b:5", "a..b"),
        ("tcp:localhost:70000", "1 to 65535"),
        ("tcp:localhost:0", "1 to 65535"),
        ("tcp:localhost:" + "9" * 30, "1 to 65535"),
        ("tcp:localhost:\N{SUPERSCRIPT TWO}", "tcp:HOST:PORT"),
        (".", "is a folder"),
        ("a\0b", "cannot be opened"),
        ("unix:" + "x" * 300, "cannot be opened"),
    ],
)
def test_what_is_no_address_is_one_line(address: str, names: str) -> None:
    with pytest.raises(RequestError, match=names):
        open_stream(address)


def test_a_stream_is_closed_once(tmp_path: Path) -> None:
    (tmp_path / "lines").write_bytes(b"12345678")
    stream = open_stream(str(tmp_path / "lines"))
    assert stream.read(5) == b"12345"
    stream.close()
    stream.close()
    assert stream.read(5) == b""

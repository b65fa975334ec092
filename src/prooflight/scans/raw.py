"""Lines from a pipe, a file or a socket, whose reading another thread or a signal can end at any moment.

Plain: uint16, least byte first, a line of the first sensor, then the same line of the next, and so on; lost lines are
not detected. Framed: before each block of such lines comes a header with the camera's count and a time, which also
states how many sensors and pixels follow, and before that one for each fault of its lines, with a message for a person;
``write_block`` is the other end.
"""

from __future__ import annotations

import io
import os
import select
import socket
import stat
import struct
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import BinaryIO, Final, Protocol, get_args

import numpy as np

from prooflight.errors import RequestError, ScanError
from prooflight.scans.lines import BLOCK_LINES, LineBlock, LineFault, LineFaultKind

CONNECT_S: Final = 10.0
"""Longest time for the camera's end to answer."""
MOST_BYTES: Final = 1 << 20
"""Greatest number of bytes read at once: the system allocates as many as are requested."""
PORTS: Final = 65_535
REMEDY: Final = "start the camera's end first, or give its path"


class ByteStream(Protocol):
    """Interface for reading bytes; an open Python file implements it."""

    def read(self, most: int, /) -> bytes:
        """Return at most so many bytes that have come, or none if the stream has ended."""
        ...

    def close(self) -> None:
        """Close the stream."""
        ...


class InterruptibleStream:
    """A file descriptor polled together with a pipe of its own: ``close`` writes to the pipe and ends the wait."""

    def __init__(self, descriptor: int, *, owned: bool = True) -> None:
        """Wrap a descriptor; owned: whether it is closed with the stream."""
        self._descriptor, self._owned = descriptor, owned
        self._woken, self._wake = os.pipe()
        self._ready = select.poll()
        self._ready.register(descriptor, select.POLLIN)
        self._ready.register(self._woken, select.POLLIN)
        self._closed = False
        self._lock = threading.RLock()  # a signal may close what its own thread reads

    def read(self, most: int, /) -> bytes:
        """Wait for bytes; none if the stream has ended or was closed. OSError: the other end broke off."""
        with self._lock:
            if self._closed:
                return b""
            self._ready.poll()
            return b"" if self._closed else os.read(self._descriptor, min(most, MOST_BYTES))

    def close(self) -> None:
        """End a ``read`` that waits, and close the descriptors. May be called more than once."""
        if self._closed:
            return
        self._closed = True
        os.write(self._wake, b"\0")
        with self._lock:
            for descriptor in (self._woken, self._wake, *((self._descriptor,) if self._owned else ())):
                os.close(descriptor)


def open_stream(address: str) -> ByteStream:
    """Open ``-`` (standard input), ``tcp:HOST:PORT``, ``unix:PATH``, or a file or named pipe.

    A named pipe without a writer is waited for when it is read, not here. RequestError: there is no such
    address, or nothing answers there.
    """
    kind, _, rest = address.partition(":")
    try:
        if address == "-":
            return _standard_input()
        if kind == "tcp":
            return _detached(socket.create_connection(_host_and_port(address, rest), timeout=CONNECT_S))
        if kind == "unix":
            return _detached(_unix(rest))
        return _file(address)
    except (OSError, UnicodeError, ValueError) as error:
        if isinstance(error, RequestError):
            raise
        why = getattr(error, "strerror", None) or error
        raise RequestError(address, f"cannot be opened ({why})", remedy=REMEDY) from error


def _standard_input() -> ByteStream:
    if sys.stdin is None:
        raise RequestError("-", "standard input is closed", remedy="pipe the camera's lines into it")
    try:
        return InterruptibleStream(sys.stdin.buffer.fileno(), owned=False)
    except io.UnsupportedOperation:  # it was replaced by an object without a descriptor
        return sys.stdin.buffer


def _host_and_port(address: str, rest: str) -> tuple[str, int]:
    host, _, port = rest.rpartition(":")
    if not host or not (port.isascii() and port.isdecimal()):
        raise RequestError(address, "is not an address", remedy="write tcp:HOST:PORT")
    if len(port) > len(str(PORTS)) or not 1 <= int(port) <= PORTS:
        raise RequestError(address, f"there is no port {port}", remedy=f"ports are 1 to {PORTS}")
    return host, int(port)


def _unix(path: str) -> socket.socket:
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        connection.settimeout(CONNECT_S)
        connection.connect(path)
    except BaseException:
        connection.close()
        raise
    return connection


def _detached(connection: socket.socket) -> InterruptibleStream:
    connection.setblocking(True)
    return InterruptibleStream(connection.detach())


def _file(path: str) -> InterruptibleStream:
    """Open a file at once, even a named pipe without a writer."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    if stat.S_ISDIR(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        remedy = "give a file or named pipe of raw lines, or replay:PATH for a folder of scans"
        raise RequestError(path, "is a folder", remedy=remedy)
    os.set_blocking(descriptor, True)
    return InterruptibleStream(descriptor)


MAGIC: Final = b"PLLB"
HEADER: Final = struct.Struct("<4sHHIQd")
"""Magic, sensors, pixels, lines, the camera's count at the first line, seconds at the last."""
FAULT_MAGIC: Final = b"PLLF"
"""Magic of a header whose numbers are a fault's: the index of its kind in ``FAULT_KINDS`` plus 256 times the
number of the sensor concerned (0: all of them); bytes of its message, lines, first line."""
FAULT_KINDS: Final[tuple[LineFaultKind, ...]] = get_args(LineFaultKind)
OF_SENSOR: Final = 256
MOST_LINES: Final = 1 << 16
MOST_BLOCK_BYTES: Final = 1 << 28
"""Greatest size of a framed block: a second of the fastest cameras. A header with more lines or bytes is
damaged."""


class RawLines:
    """A source of lines that come as bytes."""

    def __init__(
        self,
        stream: ByteStream,
        *,
        name: str,
        sensors: int,
        pixels: int,
        framed: bool = False,
        block_lines: int = BLOCK_LINES,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Read lines from a stream.

        name: in errors. framed: whether headers precede blocks; plain lines are counted and timed here.
        """
        self.sensors, self.pixels = sensors, pixels
        self._stream, self._name, self._framed = stream, name, framed
        self._block_lines, self._clock, self._closed = block_lines, clock, False

    def blocks(self) -> Iterator[LineBlock]:
        """Yield blocks until the stream ends. ScanError: it ends within a line or block, or is not of this camera."""
        return self._framed_blocks() if self._framed else self._plain_blocks()

    def close(self) -> None:
        """Close the stream; whole lines that have come are still given."""
        self._closed = True
        self._stream.close()

    def _plain_blocks(self) -> Iterator[LineBlock]:
        line_bytes = 2 * self.sensors * self.pixels
        first = 0
        while data := self._read(self._block_lines * line_bytes):
            count, rest = divmod(len(data), line_bytes)
            if count:
                yield self._block(data[: count * line_bytes], first, self._clock())
            first += count
            if rest and not self._closed:
                what = f"ends within line {first}, after {rest} of its {line_bytes} bytes"
                remedy = f"give whole lines of {self.sensors} x {self.pixels} uint16"
                raise ScanError(self._name, what, remedy=remedy)

    def _framed_blocks(self) -> Iterator[LineBlock]:
        place, faults = 0, list[LineFault]()
        while head := self._read(HEADER.size):
            where = f"{self._name}, byte {place}"
            if len(head) < HEADER.size:
                if self._closed:
                    return
                raise ScanError(where, "ends within a block's header", remedy="send whole blocks")
            magic, sensors, pixels, lines, first, time_s = HEADER.unpack(head)
            of_sensor, kind = divmod(sensors, OF_SENSOR)
            if magic == FAULT_MAGIC and kind < len(FAULT_KINDS) and of_sensor <= self.sensors:
                message = self._read(pixels)
                if len(message) < pixels:
                    if self._closed:
                        return
                    raise ScanError(where, "ends within the text of a fault", remedy="send whole blocks")
                detail = message.decode(errors="replace")
                faults.append(
                    LineFault(
                        kind=FAULT_KINDS[kind],
                        first_line=first,
                        lines=lines,
                        detail=detail,
                        sensor=of_sensor - 1 if of_sensor else None,
                    )
                )
                place += HEADER.size + pixels
                continue
            too_long = lines > MOST_LINES or 2 * self.sensors * self.pixels * lines > MOST_BLOCK_BYTES
            if magic != MAGIC or too_long:
                raise ScanError(
                    where, "is not the header of a block", remedy="send blocks as `write_block` does"
                )
            if (sensors, pixels) != (self.sensors, self.pixels):
                what = f"is of {sensors} sensors x {pixels} pixels"
                remedy = f"the press has {self.sensors} sensors x {self.pixels} pixels"
                raise ScanError(where, what, remedy=remedy)
            wanted = 2 * sensors * pixels * lines
            data = self._read(wanted)
            if len(data) < wanted:
                if self._closed:
                    return
                what = f"ends after {len(data)} of {wanted} bytes of a block"
                raise ScanError(where, what, remedy="send whole blocks")
            place += HEADER.size + wanted
            if lines:
                yield replace(self._block(data, first, time_s), faults=tuple(faults))
                faults.clear()

    def _block(self, data: bytes, first: int, time_s: float) -> LineBlock:
        lines = np.frombuffer(data, "<u2").reshape(-1, self.sensors, self.pixels)
        own = np.ascontiguousarray(lines.transpose(1, 0, 2), dtype=np.uint16)
        return LineBlock(first_line=first, lines=own, time_s=time_s)

    def _read(self, wanted: int) -> bytes:
        """Read so many bytes; fewer only at the stream's end, or when it is closed."""
        parts, left = [], wanted
        while left and not self._closed:
            try:
                part = self._stream.read(left)
            except (OSError, ValueError) as error:
                if self._closed:
                    break
                why = getattr(error, "strerror", None) or error
                what = f"cannot be read any more ({why})"
                raise ScanError(self._name, what, remedy="start the source again") from error
            if not part:
                break
            parts.append(part)
            left -= len(part)
        return b"".join(parts)


def write_block(stream: BinaryIO, block: LineBlock) -> None:
    """Write a framed block, its faults before it."""
    sensors, lines, pixels = block.lines.shape
    for fault in block.faults:
        message = fault.detail.encode()[: MOST_LINES - 1]
        of_sensor = 0 if fault.sensor is None else fault.sensor + 1
        kind = FAULT_KINDS.index(fault.kind) + OF_SENSOR * of_sensor
        stream.write(
            HEADER.pack(FAULT_MAGIC, kind, len(message), fault.lines, fault.first_line, block.time_s)
        )
        stream.write(message)
    stream.write(HEADER.pack(MAGIC, sensors, pixels, lines, block.first_line, block.time_s))
    stream.write(np.ascontiguousarray(block.lines.transpose(1, 0, 2), dtype="<u2").tobytes())


def open_raw(address: str, *, sensors: int, pixels: int, framed: bool = False) -> RawLines:
    """Open lines at an address, with the errors of ``streams.open_stream``."""
    return RawLines(open_stream(address), name=address, sensors=sensors, pixels=pixels, framed=framed)

"""Streams of bytes from a pipe, a file or a socket, whose reading another thread or a signal can end at any moment."""

from __future__ import annotations

import io
import os
import select
import socket
import stat
import sys
import threading
from typing import Final, Protocol

from prooflight.errors import RequestError

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

"""Simulated cameras: processes that answer on loopback and play given lines."""

from __future__ import annotations

import fcntl
import signal
import socket
import subprocess
import sys
import tempfile
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

PEER: Final = Path(__file__).with_name("gige_peer.py")
ID: Final = "Aravis-Fake-PL01"


class Peer:
    """Process of one camera, which can be killed and restarted as a camera is unplugged and plugged in."""

    def __init__(self, folder: Path, *, lost: float, address: str, serial: str) -> None:
        files = [str(folder / "lines.npy"), str(folder / "description.xml")]
        self._arguments = [*files, str(lost), address, serial]
        self._process: subprocess.Popen[str] | None = None

    def plug_in(self) -> None:
        """Start the camera; it answers when this returns."""
        self._process = subprocess.Popen(
            [sys.executable, str(PEER), *self._arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == "ready\n"

    def send(self, what: str, value: float) -> None:
        """Send a command, ``lost``, ``encoder``, ``at`` or ``control``; it is in effect when this returns."""
        assert self._process is not None
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{what} {value}\n")
        self._process.stdin.flush()
        assert self._process.stdout.readline() == "done\n"

    def freeze(self) -> None:
        """Stop the process, so that it does not answer, as if its cable were out; until ``thaw``."""
        assert self._process is not None
        self._process.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        """Continue the process where it was stopped."""
        assert self._process is not None
        self._process.send_signal(signal.SIGCONT)

    def unplug(self) -> None:
        """Kill the process; it has ended when this returns."""
        assert self._process is not None
        self._process.kill()
        self._process.communicate()


def own_addresses() -> list[str]:
    """Return the address of this machine's network card; what is sent there does not leave the machine."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        try:
            one.connect(("192.0.2.1", 9))  # nothing is sent: it says from which address that would be
        except OSError:
            return []
        address = str(one.getsockname()[0])
    return [] if address.startswith("127.") else [address]


@contextmanager
def alone() -> Iterator[None]:
    """Hold a lock so that no other simulated camera runs on this machine: GigE Vision has one port."""
    with Path(tempfile.gettempdir(), "prooflight-gige.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@contextmanager
def plugged_in(*lines: np.ndarray, lost: float = 0.0) -> Iterator[list[Peer]]:
    """Start cameras that play lines of bytes (n, bytes).

    They are Aravis-Fake-PL01 at 127.0.0.1, and PL02 at this machine's own address. lost: share of packets that are
    never sent.
    """
    addresses = ["127.0.0.1", *own_addresses()]
    with tempfile.TemporaryDirectory() as name, alone(), ExitStack() as stack:
        peers = []
        for number, own in enumerate(lines, start=1):
            folder = Path(name, str(number))
            folder.mkdir()
            np.save(folder / "lines.npy", own)
            peers.append(Peer(folder, lost=lost, address=addresses[number - 1], serial=f"PL{number:02}"))
            peers[-1].plug_in()
            stack.callback(peers[-1].unplug)
        yield peers

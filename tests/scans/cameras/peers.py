"""Cameras to plug in: processes that answer on loopback."""

from __future__ import annotations

import fcntl
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.scans.cameras.aravis import Aravis

if TYPE_CHECKING:
    from collections.abc import Iterator

    from prooflight.scans.cameras.source import CameraLines
    from prooflight.scans.lines import LineBlock, LineFault

PEER = Path(__file__).with_name("gige_peer.py")
ID = "Aravis-Fake-PL01"


def numbered_lines(count: int, pixels: int, *, seed: int = 1) -> np.ndarray:
    """Lines of bytes (count, pixels), each different, that say their number in their first four bytes."""
    lines = np.random.default_rng(seed).integers(0, 256, (count, pixels), np.uint8)
    lines[:, :4] = np.arange(count, dtype="<u4")[:, None].view(np.uint8)
    return lines


def numbers(lines: np.ndarray) -> np.ndarray:
    """What lines (1, n, pixels) say that they are."""
    return (lines[0, :, :4].astype(np.uint32) << np.array([0, 8, 16, 24], np.uint32)).sum(axis=1)


def read(source: CameraLines, lines: int) -> list[LineBlock]:
    """Blocks until so many lines were counted."""
    blocks = []
    for block in source.blocks():
        blocks.append(block)
        if block.next_line >= lines:
            source.close()
    return blocks


def faults_of(blocks: list[LineBlock]) -> list[LineFault]:
    return [fault for block in blocks for fault in block.faults]


def named_and_came(blocks: list[LineBlock]) -> tuple[set[int], set[int]]:
    """Lines that a fault says were not seen, and lines that came."""
    unseen = [fault for fault in faults_of(blocks) if fault.unseen]
    named = {line for fault in unseen for line in range(fault.first_line, fault.next_line)}
    return named, {line for block in blocks for line in range(block.first_line, block.next_line)}


class Peer:
    """The process, which can be killed and started again as a camera is unplugged and plugged in."""

    def __init__(self, folder: Path, *, lost: float) -> None:
        self._arguments = [str(folder / "lines.npy"), str(folder / "description.xml"), str(lost)]
        self._process: subprocess.Popen[str] | None = None

    def plug_in(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, str(PEER), *self._arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == "ready\n"

    def unplug(self) -> None:
        assert self._process is not None
        self._process.kill()
        self._process.communicate()


@contextmanager
def gige_camera(lines: np.ndarray, *, lost: float = 0.0) -> Iterator[Peer]:
    """A camera that plays lines of bytes, and loses a share of its packets; one at a time on this machine."""
    if lacks := Aravis().lacks:
        pytest.skip(lacks)
    with (
        tempfile.TemporaryDirectory() as name,
        Path(tempfile.gettempdir(), "prooflight-gige.lock").open("w") as lock,
    ):
        fcntl.flock(lock, fcntl.LOCK_EX)
        np.save(Path(name, "lines.npy"), lines)
        peer = Peer(Path(name), lost=lost)
        peer.plug_in()
        try:
            yield peer
        finally:
            peer.unplug()

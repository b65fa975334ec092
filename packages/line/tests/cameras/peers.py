"""Cameras to plug in: processes that answer on loopback."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.scans.camera_settings import CameraSettings
from prooflight_line.cameras.aravis import Aravis
from prooflight_line.testing.peer import ID, Peer, own_addresses, plugged_in

if TYPE_CHECKING:
    from collections.abc import Iterator

    from prooflight.scans.lines import LineBlock, LineFault
    from prooflight_line.cameras.source import CameraLines

__all__ = ["FREE", "ID", "Peer"]
FREE = CameraSettings(trigger="free")


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


@contextmanager
def gige_camera(lines: np.ndarray, *, lost: float = 0.0) -> Iterator[Peer]:
    """A camera that plays lines of bytes, and loses a share of its packets; one test at a time on this machine."""
    with gige_cameras(lines, lost=lost) as (peer,):
        yield peer


@contextmanager
def gige_cameras(*lines: np.ndarray, lost: float = 0.0) -> Iterator[list[Peer]]:
    """Two at most: Aravis-Fake-PL01 at 127.0.0.1, Aravis-Fake-PL02 at this machine's own address."""
    if lacks := Aravis().lacks:
        pytest.skip(lacks)
    if len(lines) > 1 + len(own_addresses()):
        pytest.skip("this machine has no address but 127.0.0.1, and each camera needs one")
    with plugged_in(*lines, lost=lost) as peers:
        yield peers

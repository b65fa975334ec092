from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.errors import RequestError, ScanError
from prooflight.scans.recorded import Replay, recorded_scans, write_scan

if TYPE_CHECKING:
    from pathlib import Path

PIXELS = 16


@pytest.fixture
def recorded(tmp_path: Path) -> list[np.ndarray]:
    """Three scans of two sensors, of different lengths, in files."""
    rng = np.random.default_rng(0)
    scans = [rng.integers(0, 4096, (2, count, PIXELS), dtype=np.uint16) for count in (30, 41, 7)]
    for number, scan in enumerate(scans, start=1):
        write_scan(tmp_path / f"p{number:04}.tif", scan, facts={})
    return scans


def test_recorded_scans_are_played_line_by_line(tmp_path: Path, recorded: list[np.ndarray]) -> None:
    source = Replay(recorded_scans(tmp_path, sensors=2), sensors=2, pixels=PIXELS, block_lines=8)
    blocks = list(source.blocks())
    np.testing.assert_array_equal(
        np.concatenate([block.lines for block in blocks], axis=1), np.concatenate(recorded, axis=1)
    )
    assert all(a.next_line == b.first_line for a, b in itertools.pairwise(blocks))
    source.close()
    assert list(source.blocks()) == []


@pytest.mark.usefixtures("recorded")
def test_scans_of_another_camera_are_named(tmp_path: Path) -> None:
    source = Replay(recorded_scans(tmp_path, sensors=2), sensors=2, pixels=PIXELS + 1)
    with pytest.raises(ScanError, match=r"p0001\.tif.*17 pixels"):
        list(source.blocks())
    with pytest.raises(RequestError, match="above 0"):
        Replay([], sensors=2, pixels=PIXELS, line_rate_hz=0.0)


@pytest.mark.usefixtures("recorded")
def test_a_damaged_scan_ends_the_replay_where_it_stands(tmp_path: Path) -> None:
    scans = recorded_scans(tmp_path, sensors=2)
    second = tmp_path / "p0002.tif"
    second.write_bytes(second.read_bytes()[:900])
    blocks = Replay(scans, sensors=2, pixels=PIXELS).blocks()
    assert next(blocks).lines.shape == (2, 30, PIXELS)
    with pytest.raises(ScanError, match=r"p0002\.tif"):
        next(blocks)

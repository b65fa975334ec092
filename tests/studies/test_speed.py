"""The benchmark runs and its rows make sense; speed itself is never asserted."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight.studies.speed import bench

if TYPE_CHECKING:
    from prooflight.press import Press


def test_every_step_stands_beside_its_peer(press: Press) -> None:
    rows = bench(press, quick=True)
    assert len(rows) == 8
    assert [row.ratio for row in rows[1::2]] == [1.0] * 4
    assert all(row.mpx_per_cpu_s > 0 for row in rows)
    assert {row.name.split(", ")[1] for row in rows} == {"text", "photo"}

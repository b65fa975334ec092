"""The benchmark runs and its rows make sense; speed itself is never asserted."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from prooflight.kernels.compiled import kernel
from prooflight.prediction.predict import expected_light
from prooflight_studies.speed import study as speed
from prooflight_studies.speed.picture import PICTURE, counted, page_cost, page_costs, write_speed_page
from prooflight_studies.speed.study import LAB_WHITE, cmyk_to_lab

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.press.artefact import Press


def test_every_step_stands_beside_its_baselines(
    press: Press, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(speed, "REPEATS", 1)
    monkeypatch.setattr(speed, "QUICK_MM", 20.0)
    rows = speed.bench(press, quick=True)
    assert all(row.lowest_mpx_per_cpu_s <= row.mpx_per_cpu_s <= row.highest_mpx_per_cpu_s for row in rows)
    names = {row.name: row for row in rows}
    assert len(names) == len(rows)
    for page in ("text", "mixed", "photo"):
        assert names[f"look-up, {page}"].ratio == names[f"predict, {page}"].ratio == 1
        assert f"lcms2, {page}" in names
    costs = page_costs(press, quick=True)
    write_speed_page(rows, costs, tmp_path)
    assert (tmp_path / "images" / PICTURE).stat().st_size > 10_000
    assert f"| lcms2, photo | {names['lcms2, photo'].mpx_per_cpu_s:,.1f} |" in (
        tmp_path / "performance.md"
    ).read_text(encoding="utf-8")


def test_arrays_that_no_cache_holds_count_as_moved() -> None:
    large, small = np.zeros((600, 1000), np.float32), np.zeros(1000, np.float32)
    copied = kernel("of (L, P), row (P), out (L, P)")(_copied)
    with counted() as moved:
        copied(large, small, np.empty_like(large))
    copied(large, small, np.empty_like(large))
    assert moved == [2 * large.nbytes]


def _copied(of, row, out):  # type: ignore[no-untyped-def]
    out[:] = of + row


def test_as_many_pages_are_carried_as_cores_or_memory_carry() -> None:
    """0.1 s and 1 GB a page: 10 a core and second, and of 51.2 GB/s 80 %, 41 a second."""
    cost = page_cost("look", cpu_s=0.1, moved_bytes=10**9)
    assert cost.pages_per_s["2 channels of DDR4-3200"] == (10, 20, 40, 41.0, 41.0, 41.0, 41.0)


def test_lcms2_looks_up_the_table_that_prediction_does(press: Press) -> None:
    """To L*'s 8 bits, 100 / 255, and lcms2's simplexes, which err a few times as much as sixteen corners."""
    table = press.sensors[0].mean_dn
    cmyk = np.random.default_rng(4).integers(0, 256, (1, 500, 4)).astype(np.uint8)
    transform = cmyk_to_lab(table[::2, ::2, ::2, ::2] / table.max())
    image = Image.frombuffer("CMYK", (500, 1), cmyk.tobytes(), "raw", "CMYK", 0, 1)
    lightness = np.asarray(transform.apply(image))[0, :, 0] / 255
    assert LAB_WHITE == 0xFF00
    np.testing.assert_allclose(
        lightness, expected_light(cmyk[0], press.sensors[0])[0] / table.max(), atol=0.03
    )

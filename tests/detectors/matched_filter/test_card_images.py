"""What a card computes, by plain loops of the same bodies, is what the processor's tuned kernels compute."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import numpy as np
import pytest

from prooflight.detectors.base import refuse_without_card
from prooflight.detectors.matched_filter.analysis import analyse
from prooflight.detectors.matched_filter.card.images import engine_on
from prooflight.detectors.matched_filter.design import prepare_page
from prooflight.detectors.matched_filter.statistics.families import all_statistics, screen_statistics
from prooflight.detectors.matched_filter.statistics.local_evidence import MODES, Scatter
from prooflight.detectors.matched_filter.statistics.statistic import SCREEN_MODES, values_of
from prooflight.errors import RequestError
from prooflight.inspection.inspector import Inspector
from prooflight.kernels.gpu import prediction, residuals, sums
from prooflight.kernels.gpu.body import Body
from prooflight.kernels.gpu.runners import Loops, Pool, lacking
from prooflight.prediction.predict import predict
from prooflight.scans.placement import Placement
from prooflight.simulation.scans import ideal_scan

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

MOVED = Placement(shift_mm=(0.23, -0.17), skew_deg=0.05, stretch_percent=(0.02, -0.01))


def test_loops_give_what_the_tuned_kernels_give(two_sensor_press: Press, page: Page) -> None:
    """Two sensors, lost lines, a faulty column, unresolved places and hidden edges: every body runs."""
    press = two_sensor_press
    expected = predict(page, sensors=press.sensors, geometry=press.geometry)
    known = prepare_page(page, expected, sensors=press.sensors, geometry=press.geometry, fringes=True)
    unresolved = np.zeros(known.images.levels.shape[1:], np.float32)
    unresolved[20:40, 50:90] = 1
    known = replace(known, unresolved=unresolved)
    assert known.hidden is not None
    there = predict(page, sensors=press.sensors, geometry=press.geometry, placement=MOVED)
    scan = ideal_scan(there, press, np.random.default_rng(5))
    scan[:, :, 101] //= 2
    lost = np.zeros(scan.shape[:2], bool)
    lost[1, 200:230] = True
    pool = Pool(Loops)
    on_card = engine_on(pool)
    host = analyse(known, scan, lost=lost, analysed_modes=SCREEN_MODES, floor_share=0.1)
    for _ in range(2):  # the second uses the first's memory again
        card = analyse(known, scan, lost=lost, analysed_modes=SCREEN_MODES, floor_share=0.1, engine=on_card)
        assert card.blind_columns == host.blind_columns == (100,)
        np.testing.assert_allclose(card.noise, host.noise, rtol=2e-3)
        np.testing.assert_allclose(card.fit.pulls, host.fit.pulls, atol=5e-3)
        for name in ("columns", "flat_columns", "cover", "column_gains"):
            close(getattr(card.sums, name), getattr(host.sums, name))
        for part in range(4):
            for mode in range(3):
                close(card.sums.tiles[part, mode], host.sums.tiles[part, mode])
        close(card.marks.greatest, host.marks.greatest)
        np.testing.assert_allclose(screened(card), screened(host), atol=0.05)
    whole, whole_card = host.of_every_mode(), card.of_every_mode()
    assert whole_card.sums.modes == MODES
    np.testing.assert_allclose(every(whole_card), every(whole), atol=0.05)


@pytest.mark.filterwarnings("ignore")  # what is recorded computes nothing, and later steps divide by 0
@pytest.mark.parametrize("capability", [(8, 0), (9, 0)])
def test_every_body_compiles_for_cards(press: Press, page: Page, capability: tuple[int, int]) -> None:
    pytest.importorskip("numba_cuda", reason="numba-cuda is not installed")
    from numba import cuda, int64, typeof

    seen: dict[str, tuple[Body, Any]] = {}

    class Recording(Loops):
        def run(self, body: Body, shape: tuple[int, int], *arguments: Any) -> None:
            seen.setdefault(body.name, (body, typeof(arguments)))

    expected = predict(page, sensors=press.sensors, geometry=press.geometry)
    known = prepare_page(page, expected, sensors=press.sensors, geometry=press.geometry)
    known = replace(known, unresolved=np.ones(known.images.levels.shape[1:], np.float32))
    there = predict(page, sensors=press.sensors, geometry=press.geometry, placement=MOVED)
    scan = ideal_scan(there, press, np.random.default_rng(5))
    scan[:, :, 101] //= 2
    analyse(known, scan, analysed_modes=SCREEN_MODES, engine=engine_on(Pool(Recording)))
    every = {
        name
        for module in (prediction, residuals, sums)
        for name, one in vars(module).items()
        if isinstance(one, Body)
    }
    assert set(seen) == every
    with patch(
        "numba.cuda.dispatcher.get_current_device", lambda: SimpleNamespace(compute_capability=capability)
    ):
        for body, kinds in seen.values():
            text, _ = cuda.compile_ptx(body.kernel.py_func, (int64, int64, kinds), cc=capability)
            assert body.name in text


def test_on_the_simulator_kernels_give_what_the_tuned_ones_give() -> None:
    """Some 100 s: a thread for each place."""
    if not os.environ.get("CUDA_SIMULATOR_TESTS"):
        pytest.skip("takes some 100 s: set CUDA_SIMULATOR_TESTS=1")
    script = Path(__file__).with_name("on_the_simulator.py")
    environment = os.environ | {"NUMBA_ENABLE_CUDASIM": "1"}
    done = subprocess.run(
        [sys.executable, script], env=environment, capture_output=True, text=True, check=True
    )
    assert float(done.stdout) < 5e-3


def test_without_a_card_the_device_is_refused(press: Press) -> None:
    with patch("prooflight.kernels.gpu.runners.find_spec", lambda _: None):
        lacking.cache_clear()
        with pytest.raises(RequestError, match=r"--device gpu: the package numba-cuda is not installed"):
            refuse_without_card()
    lacking.cache_clear()
    with pytest.raises(RequestError, match="computes on the processor alone"):
        Inspector.of(press, "chi-square").on("gpu")


def screened(one):  # type: ignore[no-untyped-def]
    return values_of(screen_statistics(one.sums, one.marks, one.fit, one.registration, Scatter.white()))


def every(one):  # type: ignore[no-untyped-def]
    return values_of(all_statistics(one.sums, one.marks, one.fit, one.registration, Scatter.white()))


def close(found, asked) -> None:  # type: ignore[no-untyped-def]
    """Alike to a twentieth of their root mean square.

    The card takes the nearest of 4,096 phases of a pixel, and the processor what lies between: at an edge of 3,000 DN
    that is 0.4 DN, 0.04 of the noise.
    """
    scale = float(np.sqrt(np.square(asked, dtype=np.float64).mean()))
    off = float(np.abs(np.asarray(found, np.float64) - asked).max()) / max(scale, 1e-9)
    assert off < 0.05

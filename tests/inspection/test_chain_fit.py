"""The signal chain of printer and scanner, fitted to edges."""

from __future__ import annotations

import numpy as np
import pytest

from prooflight.detectors.golden.chain import RINGS, SignalChain, between, rings, slope_of_numbers, to_numbers
from prooflight.inspection.scanner.fits import SheetEdges, chains_of, fitted_chain

RASTER_MM = 25.4 / 600
KERNEL = np.array([0.85, 0.15, 0.05, 0.1, -0.1, -0.05])


def edges(seed: int, *, growth: float = 0.5, misprint: float = 0.0) -> SheetEdges:
    """Return samples of a page of random strokes under a known chain; misprint: share of samples that are paper."""
    rng = np.random.default_rng(seed)
    strokes = np.kron((rng.random((2, 40, 40)) < 0.3)[0], np.ones((4, 4))).astype(np.float32)
    grown = [strokes]
    for _ in range(2):
        last = np.pad(grown[-1], 1, mode="edge")
        grown.append(
            np.max(
                [last[1:-1, 1:-1], last[2:, 1:-1], last[:-2, 1:-1], last[1:-1, 2:], last[1:-1, :-2]], axis=0
            )
        )
    light = np.stack([1 - 0.97 * one for one in grown])[:, None]
    chain = SignalChain(
        growth_um=growth * RASTER_MM * 1000, growth_sd_um=0, kernels=KERNEL[None], edge_sd=0.1, sheets=1
    )
    numbers = chain.numbers(light, RASTER_MM)[0].reshape(1, -1)
    numbers = np.where(rng.random(numbers.shape) < misprint, 1, numbers + rng.normal(0, 0.01, numbers.shape))
    dark = np.stack([[rings(1 - one).reshape(len(RINGS), -1).T for one in step] for step in light])
    return SheetEdges(
        dark=dark,
        numbers=np.clip(numbers, 0, 1).astype(np.float32),
        varying=np.full(numbers.shape, 0.5, np.float32),
    )


@pytest.mark.parametrize("misprint", [0.0, 0.05])
def test_a_known_chain_is_found_even_where_some_print_is_missing(misprint: float) -> None:
    chain = fitted_chain([edges(1, misprint=misprint)], RASTER_MM)
    assert chain.growth_um == pytest.approx(21.2, abs=4)  # a fifth of the step of growths that are tried
    assert chain.kernels[0] == pytest.approx(KERNEL, abs=0.05)
    assert chain.kernels[0].sum() == pytest.approx(1)


def test_a_sheet_is_judged_by_the_others() -> None:
    sheets = {"a": edges(1), "b": edges(2), "odd": edges(3, growth=1.5)}
    chains = chains_of(sheets, RASTER_MM)
    assert chains["odd"].sheets == 2
    assert chains["odd"].growth_um == pytest.approx(21.2, abs=4)
    assert chains["a"].growth_um > chains["odd"].growth_um
    assert chains[""].sheets == 3


def test_no_sheet_tells_no_chain() -> None:
    assert chains_of({}, RASTER_MM) == {}


def test_numbers_are_those_of_srgb() -> None:
    assert to_numbers(np.array([-1, 0, 0.0021404, 0.2140411, 1, 2])) == pytest.approx(
        [0, 0, 0.02765, 0.5, 1, 1], abs=1e-4
    )
    light, step = np.array([0.001, 0.01, 0.3]), 1e-4
    slope = (to_numbers(light + step) - to_numbers(light - step)) / (2 * step)
    assert slope_of_numbers(light) == pytest.approx(slope, rel=1e-2)


def test_growth_lies_between_its_neighbours() -> None:
    grown = np.array([1.0, 0.5, 0.0], np.float32).reshape(3, 1, 1, 1)
    assert [float(between(grown, pixels).item()) for pixels in (0, 0.5, 1.5, 2)] == [1, 0.75, 0.25, 0]

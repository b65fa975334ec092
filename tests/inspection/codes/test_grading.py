"""Grades of codes against profiles whose parameters are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.inspection.codes.reading import CONTRAST, DEFECTS, decodability, letter, level
from prooflight.inspection.codes.symbols import Profile, cut_elements

STEP = 0.25
PAPER, INK = 1.0, 0.1


def bars(widths: list[float], *, blur: float = 0.0) -> np.ndarray:
    """Light of bars and spaces of these widths [pixel], a bar first, between quiet zones of ten pixels."""
    edges = 10.0 + np.concatenate([[0.0], np.cumsum(widths)])
    at = np.arange(0, edges[-1] + 10.0, STEP)
    element = np.searchsorted(edges, at, side="right")
    light = np.where(element % 2, INK, PAPER)
    if blur:
        steps = np.arange(-6 * blur, 6 * blur + STEP / 2, STEP)
        kernel = np.exp(-0.5 * (steps / blur) ** 2)
        light = np.convolve(np.pad(light, steps.size // 2, mode="edge"), kernel / kernel.sum(), "valid")
    return light


def seen(light: np.ndarray) -> Profile:
    (found,) = cut_elements(light[None], STEP)
    assert found is not None
    return found


@given(st.lists(st.sampled_from([3.0, 6.0, 9.0]), min_size=3, max_size=31).filter(lambda w: len(w) % 2))
def test_edges_lie_where_elements_meet(widths: list[float]) -> None:
    found = seen(bars(widths))
    assert np.diff(found.edges) == pytest.approx(widths, abs=STEP)
    assert found.peaks == pytest.approx([PAPER, *([INK, PAPER] * (len(widths) // 2 + 1))])
    assert found.defects == pytest.approx(0, abs=1e-12)


def test_a_symmetric_blur_moves_no_edge() -> None:
    widths = [3.0, 3.0, 6.0, 3.0, 9.0, 6.0, 3.0]
    sharp, blurred = seen(bars(widths)), seen(bars(widths, blur=0.8))
    assert blurred.edges == pytest.approx(sharp.edges, abs=0.2)


def test_a_spot_in_a_space_is_a_defect_of_its_depth() -> None:
    light = bars([4.0, 20.0, 4.0])
    middle = light.size // 2
    light[middle - 3 : middle + 3] = 0.8
    assert seen(light).defects.max() == pytest.approx(PAPER - 0.8)


def test_a_profile_without_bars_is_none() -> None:
    assert cut_elements(np.full((1, 200), PAPER), STEP) == (None,)
    assert cut_elements(1.1 - bars([4.0, 4.0, 4.0])[None], STEP) == (None,)  # it begins in the dark


@given(st.lists(st.integers(0, 2**32 - 1), min_size=1, max_size=6), st.integers(0, 5))
def test_lines_cut_together_are_what_they_are_alone(seeds: list[int], bare: int) -> None:
    lines = [np.full(200, PAPER)] * bare
    for seed in seeds:
        rng = np.random.default_rng(seed)
        light = bars([float(width) for width in rng.integers(2, 5, 9)], blur=0.8)[:200]
        light = np.pad(light, (0, 200 - light.size), mode="edge")
        lines.append(light + rng.normal(0, 0.02, 200))
    together = cut_elements(np.array(lines), STEP)
    for light, one in zip(lines, together, strict=True):
        (alone,) = cut_elements(light[None], STEP)
        assert (one is None) == (alone is None)
        if one is not None and alone is not None:
            for name in ("edges", "peaks", "defects"):
                assert getattr(one, name) == pytest.approx(getattr(alone, name), abs=1e-9)


def test_decodability_falls_to_nothing_where_an_element_is_half_a_module_off() -> None:
    nominal = np.cumsum([0.0, 2, 2, 4, 2, 6, 2])
    off = nominal.copy()
    off[3] += 0.5  # one element grows by 0.5 and its neighbour shrinks
    assert decodability(nominal, nominal) == 1
    assert decodability(2 * nominal, nominal) == pytest.approx(1)  # a stretched sheet is not wrong
    assert decodability(off, nominal) == pytest.approx(1 - 0.5 / 1.0)
    off[3] += 0.5
    assert decodability(off, nominal) == 0


def test_levels_are_those_of_the_standard() -> None:
    assert [level(value, CONTRAST) for value in (0.70, 0.69, 0.55, 0.40, 0.20, 0.19)] == [4, 3, 3, 2, 1, 0]
    assert [level(value, DEFECTS, falling=True) for value in (0.15, 0.16, 0.30, 0.31)] == [4, 3, 1, 0]
    assert [letter(grade) for grade in (4.0, 3.5, 3.4, 2.5, 1.5, 0.5, 0.4)] == list("AABBCDF")

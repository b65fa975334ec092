"""The packed look-up against plain whole numbers, against the tables it stands for, and for its instructions."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numba
import numpy as np
import pytest
from llvmlite import binding
from numba import njit

from prooflight.kernels.prediction import filtering as filtering_kernels
from prooflight.kernels.prediction import lookup as look_up_kernels
from prooflight.kernels.prediction.lookup import (
    NODES,
    eight_at_once,
    has_extraction,
    lookup_light,
    masks_of,
)
from prooflight.prediction.quantised_table import (
    CELL_BITS,
    QuantisedTable,
    _along,
    cells_bits,
    quantised_table,
)

if TYPE_CHECKING:
    from prooflight.press.artefact import Press


def random_words(count: int, seed: int = 5) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 2**32, count, dtype=np.uint32)


def plain_sums(packed: np.ndarray, quantised: QuantisedTable) -> np.ndarray:
    """65536 times the interpolated code, in 64-bit integers."""
    inks = packed.view(np.uint8).reshape(-1, 4).astype(np.int64)
    bits = quantised.bits.astype(np.int64)
    cell, fraction = np.divmod(inks, 256 >> bits)
    place = np.zeros(packed.size, np.int64)
    for ink in (3, 2, 1, 0):
        place = (place << bits[ink]) + cell[:, ink]
    total = np.zeros_like(place)
    for corner in product((0, 1), repeat=4):
        weight = np.prod(np.where(np.array(corner) == 1, fraction, (256 >> bits) - fraction), axis=1)
        total += weight * quantised.codes[place, np.array(corner) @ (1, 2, 4, 8)]
    return total


def as_light(sums: np.ndarray, quantised: QuantisedTable, level: float) -> np.ndarray:
    roots = sums.astype(np.float32)
    return roots * roots * quantised.unit - (np.float32(level) + quantised.offset)


def random_bricks(seed: int) -> QuantisedTable:
    """Of a table that bends more the more nodes an ink has."""
    rng = np.random.default_rng(seed)
    inks = np.linspace(0, 1, NODES)
    bends = rng.permutation([0.2, 1.0, 2.0, 8.0])
    axes = [np.exp(-2 * inks**bend) for bend in bends]
    return QuantisedTable.of((3000 * np.einsum("a,b,c,d->abcd", *axes)).astype(np.float32))


@pytest.mark.parametrize("seed", range(3))
def test_look_up_is_plain_arithmetic_to_the_bit(seed: int) -> None:
    quantised, packed = random_bricks(seed), random_words(4000, seed)
    packed[1000:1100] = packed[1000]  # a run
    light = np.empty(packed.size, np.float32)
    lookup_light(packed, quantised, np.float32(123), light)
    np.testing.assert_allclose(
        light, as_light(plain_sums(packed, quantised), quantised, 123), rtol=0, atol=1e-3
    )
    lookup_light(packed, quantised._replace(unit=np.float32(1), offset=np.float32(0)), np.float32(0), light)
    exact = plain_sums(packed, quantised).astype(np.float32)
    np.testing.assert_array_equal(light, exact * exact)


def test_processors_without_extraction_give_the_same() -> None:
    by_shifts = eight_at_once(one_instruction=False)

    @njit
    def all_of(packed, table, bits, out):  # type: ignore[no-untyped-def]
        for first in range(0, packed.size, 8):
            by_shifts(
                table.codes, table.inner, table.outer, packed, bits, first, masks_of(table.bits),
                table.unit, table.offset, out,
            )  # fmt: skip

    quantised, packed = random_bricks(7), random_words(800)
    b = quantised.bits
    shifted, light = np.empty((2, packed.size), np.float32)
    all_of(packed, quantised, (b[0], b[1], b[2], b[3], np.uint32(16 - b[0] - b[1])), shifted)
    lookup_light(packed, quantised, np.float32(0), light)
    np.testing.assert_array_equal(shifted, light)


def test_curved_inks_have_more_cells() -> None:
    axes = [np.ones(NODES), np.linspace(1, 0.1, NODES) ** 3, np.ones(NODES), np.linspace(1, 0.5, NODES)]
    bits = cells_bits(np.einsum("a,b,c,d->abcd", *axes))
    assert sum(bits) == CELL_BITS
    assert bits[1] == max(bits) == 5


@pytest.mark.parametrize("ink", range(4))
def test_nodes_are_fitted_along_one_ink(ink: int) -> None:
    rng = np.random.default_rng(9)
    matrix, values = rng.normal(size=(3, 5)), rng.normal(size=(5, 5, 5, 5))
    plain = np.moveaxis(np.tensordot(matrix, values, axes=(1, ink)), 0, ink)
    np.testing.assert_allclose(_along(matrix, values, ink), plain, rtol=1e-12, atol=1e-12)


def test_a_table_is_left_as_it_was(press: Press) -> None:
    table = press.sensors[0].mean_dn
    before = table.copy()
    for kind in (np.float32, np.float64):
        exact = table.astype(kind)
        QuantisedTable.of(exact)
        np.testing.assert_array_equal(exact, before)


@pytest.mark.skipif(not has_extraction(), reason="the processor has no BMI2")
@pytest.mark.skipif(not binding.get_host_cpu_features().get("avx2"), reason="the processor has no AVX2")
@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="compiling is switched off")
def test_compiled_look_up_and_filter_are_vectors(press: Press) -> None:
    quantised, packed = quantised_table(press.sensors[0].mean_dn), random_words(64)
    fresh = njit(lookup_light.py_func)
    fresh(packed, quantised, np.float32(0), np.empty(64, np.float32))
    (assembly,) = fresh.inspect_asm().values()
    assert assembly.count("vpmaddwd") >= look_up_kernels.AT_ONCE
    assert "pext" in assembly
    light, out = np.zeros(256, np.float32), np.empty(64, np.float32)
    along = njit(filtering_kernels.sum_row.py_func)
    along(light, np.zeros(3, np.int64), np.zeros(3, np.float32), 0, 3, 0, 64, out)
    places = np.zeros(64, np.int32)
    moved = njit(filtering_kernels.filter_row.py_func)
    moved(light, places, light, places, 8, out)
    for kernel in (along, moved):
        (assembly,) = kernel.inspect_asm().values()
        assert "vfmadd" in assembly

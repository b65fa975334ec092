"""The compiled pass against plain NumPy, bit for bit; the dither against its law; vector instructions."""

from __future__ import annotations

import re
from typing import NamedTuple

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from llvmlite import binding
from scipy import special

from prooflight.detectors.paper.evidence import (
    Camera,
    Evidence,
    Part,
    compare,
    interval_edges,
    interval_shares,
    join,
    parts,
)
from prooflight.kernels.comparison import one_pass as kernels
from prooflight.prediction.compact import Scale

# Only compiled loops call these.
_normalise_row = numba.njit(lambda *arguments: kernels.normalise_row(*arguments))
_dither_row = numba.njit(lambda *arguments: kernels.dither_row(*arguments))
_dither_soft_row = numba.njit(lambda *arguments: kernels.dither_soft_row(*arguments))
_settle_row = numba.njit(lambda *arguments: kernels.settle_row(*arguments))


TILE, BLOCK = 64, 8


def fine(measured: np.ndarray, mean: np.ndarray, inverse: np.ndarray, scale: Scale) -> np.ndarray:
    """Z in 1024ths of a sigma, rounded down: all (lines, pixels), in 64-bit integers."""
    distance = np.minimum(measured.astype(np.int64), scale.top_code_dn) * 2**scale.mean_bits - mean
    drop = scale.mean_bits + scale.inverse_bits - 10
    steps = np.minimum((np.abs(distance) * inverse) >> drop, 8 * 4095 - 1)
    return np.where(distance >= 0, steps, ~steps)


def reference(measured: np.ndarray, mean: np.ndarray, inverse: np.ndarray, scale: Scale) -> np.ndarray:
    """Z in 128ths of a sigma, to the nearest, cut off at 4095."""
    return (fine(measured, mean, inverse, scale) + 4) >> 3


def tiles(values: np.ndarray) -> list[list[np.ndarray]]:
    """Squares of 64, the last of each row and column larger by what is left over."""
    cuts = [range(TILE, TILE * max(n // TILE, 1), TILE) for n in values.shape]
    return [np.split(row, cuts[1], axis=1) for row in np.split(values, cuts[0], axis=0)]


def per_tile(values: np.ndarray, of: object) -> np.ndarray:
    return np.array([[of(tile) for tile in row] for row in tiles(values)])  # type: ignore[operator]


class Codes(NamedTuple):
    """A prediction in integers, (sensors, lines, pixels) each; all sensors alike."""

    mean: np.ndarray
    inverse: np.ndarray
    scale: Scale


def compared(measured: np.ndarray, codes: Codes, *, seed: int, dither: bool = True) -> list[list[Part]]:
    sensors, *size = measured.shape
    return [
        [
            compare(
                *(each[s, lines.start : lines.stop] for each in (measured, codes.mean, codes.inverse)),
                scale=codes.scale,
                sensor=s,
                lines=lines,
                seed=seed,
                dither=dither,
            )
            for lines in parts(*size)
        ]
        for s in range(sensors)
    ]


def any_images(seed: int, shape: tuple[int, int, int], scale: Scale) -> tuple[np.ndarray, Codes]:
    """Scans near their predictions, far from them and at the ends of the range."""
    rng = np.random.default_rng(seed)
    steps = 2**scale.mean_bits
    mean = rng.integers(0, scale.top_code_dn * steps + 1, shape)
    near = mean / steps + rng.standard_normal(shape) * rng.choice([0.5, 3, 20, 2000], shape)
    measured = np.clip(np.rint(near), 0, scale.top_code_dn).astype(np.uint16)
    measured[rng.random(shape) < 0.01] = 65535  # what no such camera sends counts as its top code
    inverse = (65535 / rng.choice([1, 1.5, 4, 30, 60000], shape)).astype(np.uint16)
    return measured, Codes(mean.astype(np.uint16), inverse, scale)


def assert_as_in_numpy(evidence: Evidence, measured: np.ndarray, codes: Codes) -> None:
    for s in range(len(measured)):
        z = reference(measured[s], codes.mean[s], codes.inverse[s], codes.scale)
        lines, pixels = z.shape
        rows, columns = lines // BLOCK, pixels // BLOCK
        blocks = z[: rows * BLOCK, : columns * BLOCK].reshape(rows, BLOCK, columns, BLOCK).sum(axis=(1, 3))
        np.testing.assert_array_equal(evidence.block_z[s], (blocks / 1024).astype(np.float32))
        np.testing.assert_array_equal(
            evidence.tile_histogram[s].sum(axis=-1), per_tile(z, lambda tile: tile.size)
        )


SCALES = [
    Scale(mean_bits=4, inverse_bits=16, top_code_dn=4095),
    Scale(mean_bits=8, inverse_bits=14, top_code_dn=255),
    Scale(mean_bits=0, inverse_bits=19, top_code_dn=65535),
]


@pytest.mark.parametrize("scale", SCALES, ids=["12 bits", "8 bits", "16 bits"])
@pytest.mark.parametrize(
    ("lines", "pixels"),
    [(1, 1), (63, 63), (64, 64), (65, 127), (127, 128), (200, 2048), (71, 2049), (130, 4200), (600, 1900)],
)
def test_every_statistic_is_numpys_to_the_bit(scale: Scale, lines: int, pixels: int) -> None:
    measured, codes = any_images(1, (1, lines, pixels), scale)
    assert_as_in_numpy(join(compared(measured, codes, seed=1)), measured, codes)


@given(
    st.integers(0, 2**31),
    st.integers(1, 2),
    st.integers(1, 200),
    st.integers(1, 150),
    st.sampled_from(SCALES),
)
@settings(max_examples=60)
def test_at_any_size(seed: int, sensors: int, lines: int, pixels: int, scale: Scale) -> None:
    measured, codes = any_images(seed, (sensors, lines, pixels), scale)
    assert_as_in_numpy(join(compared(measured, codes, seed=seed)), measured, codes)


def test_the_naive_histogram_counts_z_between_the_edges() -> None:
    measured, codes = any_images(3, (2, 150, 200), SCALES[0])
    naive = compared(measured, codes, seed=1, dither=False)
    evidence = join(compared(measured, codes, seed=1), naive)
    for s in range(2):
        z = fine(measured[s], codes.mean[s], codes.inverse[s], SCALES[0])
        place = np.searchsorted(interval_edges(), (z >> 4).ravel(), side="right")
        np.testing.assert_array_equal(evidence.naive_histogram[s], np.bincount(place, minlength=16))


def exact_code(n: int, mean_dn: float, sigma_dn: float, w: np.ndarray, top: int) -> np.ndarray:
    """64 Phi^-1(u), u uniform between Phi at the ends of a digital number; sigma before rounding."""
    low = 0.0 if n == 0 else special.ndtr((n - 0.5 - mean_dn) / sigma_dn)
    high = 1.0 if n == top else special.ndtr((n + 0.5 - mean_dn) / sigma_dn)
    return np.asarray(64 * special.ndtri(low + (high - low) * w))


@pytest.mark.parametrize(
    ("sigma", "tolerance"),
    # steps of sigma / 64 allowed between the drawn code and the law's: the series' next term, and rounding
    [(1.0, 3.5), (1.3, 1.6), (2.0, 1.1), (3.9, 1.1), (4.1, 1.1), (8.0, 1.1), (30.0, 1.1)],
)
def test_the_dither_draws_from_the_law_before_rounding(sigma: float, tolerance: float) -> None:
    scale = Scale.of(top_code_dn=4095, least_variance_dn2=sigma**2 + 1 / 12)
    camera = Camera.of(scale)
    noise = np.arange(31, 65536, 64, dtype=np.uint16)
    inverse = np.full(noise.size, round(2**scale.inverse_bits / np.sqrt(sigma**2 + 1 / 12)), np.uint16)
    z, codes = np.empty(noise.size, np.int16), np.empty(noise.size, np.int8)
    dither = _dither_row if sigma < 4 else _dither_soft_row
    for n in range(int(1000 - 2.2 * sigma), int(1000 + 2.2 * sigma) + 1):
        seen, mean = np.full(noise.size, n, np.uint16), np.full(noise.size, round(1000.3125 * 16), np.uint16)
        _normalise_row(seen, mean, inverse, camera.top_code, camera.mean_bits, camera.drop, z)
        dither(z, inverse, camera.inverse_drop, noise, codes)
        law = exact_code(n, 1000.3125, sigma, (noise + 0.5) / 65536, 4095)
        inside = np.abs(law) < 120
        assert np.abs(codes[inside] + 0.5 - law[inside]).max(initial=0) < tolerance


@pytest.mark.parametrize(("n", "mean_dn"), [(0, 0.25), (0, 2.0), (4095, 4094.5), (4095, 4090.0), (7, 6.75)])
@pytest.mark.parametrize("sigma", [0.5, 0.8, 2.0])
def test_settled_codes_lie_in_the_interval_of_the_law(n: int, mean_dn: float, sigma: float) -> None:
    scale = Scale.of(top_code_dn=4095, least_variance_dn2=sigma**2 + 1 / 12)
    camera = Camera.of(scale)._replace(unsure=np.uint16(0))  # all of them
    noise = np.arange(31, 65536, 64, dtype=np.uint16)
    seen, mean = np.full(noise.size, n, np.uint16), np.full(noise.size, round(mean_dn * 16), np.uint16)
    inverse = np.full(noise.size, int(2**scale.inverse_bits / np.sqrt(sigma**2 + 1 / 12)), np.uint16)
    codes = np.zeros(noise.size, np.int8)
    edges = interval_edges()
    _settle_row(seen, mean, inverse, camera, noise, edges, special.ndtr(edges / 64), codes)
    law = exact_code(n, mean_dn, sigma, (noise + 0.5) / 65536, 4095)
    clear = np.abs(law[:, None] - edges).min(axis=1) > 0.02
    assert clear.mean() > 0.9
    assert (np.searchsorted(edges, codes, side="right") == np.searchsorted(edges, law, side="right"))[
        clear
    ].all()


def test_intervals_are_nearly_equally_likely_and_have_the_papers_0_675_among_their_edges() -> None:
    shares = interval_shares()
    assert shares.sum() == pytest.approx(1, abs=1e-12)
    assert np.abs(shares * shares.size - 1).max() < 0.06
    np.testing.assert_array_equal(interval_edges(), -interval_edges()[::-1])
    assert abs(interval_edges()[11] / 64 - 0.6745) < 1 / 128


def instructions(function: numba.core.dispatcher.Dispatcher, *arguments: object) -> str:
    """Machine code of a loop, compiled anew: cached code cannot be read."""
    fresh = numba.njit(nogil=True)(function.py_func)
    fresh(*arguments)
    return str(fresh.inspect_asm(fresh.signatures[0]))


needs_avx2 = pytest.mark.skipif(
    not dict(binding.get_host_cpu_features()).get("avx2", False), reason="this processor has no AVX2"
)


@needs_avx2
@pytest.mark.parametrize(
    ("name", "wanted", "unwanted"),
    [
        ("normalise_row", ("vpmulhuw", "vpmullw", "vpsubw"), ("vpmulld",)),
        ("dither_row", ("vpmulhw", "vpaddw"), ("vpmulld", "vpmuldq")),
        ("dither_soft_row", ("vpmulhw", "vpaddw"), ("vpmulld", "vpmuldq")),
        ("count_lines", ("vpaddb|vpsubb",), ()),
        ("fold_lines", ("vpaddw", "vpsraw"), ()),
    ],
)
def test_loops_are_vector_instructions_of_words(
    name: str, wanted: tuple[str, ...], unwanted: tuple[str, ...]
) -> None:
    words, z = np.ones(64, np.uint16), np.ones(64, np.int16)
    few, many = np.uint16(4), np.ones(8 * kernels.STRIP, np.int16)
    codes = np.ones(64, np.int8)
    arguments = {
        "normalise_row": (words, words, words, few, few, few, z),
        "dither_row": (z, words, few, words, codes),
        "dither_soft_row": (z, words, few, words, codes),
        "count_lines": (many.astype(np.int8), codes[:15], np.zeros((15, 64), np.uint8)),
        "fold_lines": (many, z),
    }[name]
    code = instructions(getattr(kernels, name), *arguments)
    for pattern in wanted:
        assert re.search(rf"\b(?:{pattern})\b.*%[yz]mm", code), f"no {pattern} of whole registers in {name}"
    for pattern in unwanted:
        assert not re.search(rf"\b{pattern}\b", code), f"{pattern}: {name} has left 16-bit words"

"""Quantised tables against the tables that they stand for, looked up exactly."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from prooflight.kernels.prediction.lookup import (
    lookup_light,
)
from prooflight.prediction.quantised_table import (
    quantised_table,
)
from prooflight_studies.harness.exact_tables import exact_lookup

if TYPE_CHECKING:
    from prooflight.press.artefact import Press


def random_words(count: int, seed: int = 5) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 2**32, count, dtype=np.uint32)


def test_stays_with_the_tables_it_stands_for(press: Press) -> None:
    """A tenth of a sigma is asked of tables against the spectral model; a look-up may not use it up."""
    model = press.sensors[0]
    packed = random_words(20_000)
    packed[:2] = 0, 0xFFFFFFFF
    cmyk = packed.view(np.uint8).reshape(-1, 4)
    light = np.empty(packed.size, np.float32)
    mean, variance = exact_lookup(cmyk, model)
    lookup_light(packed, quantised_table(model.mean_dn), np.float32(0), light)
    error = (light - mean) / np.sqrt(variance)
    assert abs(light[0] - model.white_dn) < 1e-3
    assert np.sqrt(np.mean(error**2)) < 0.1
    assert np.abs(error).max() < 1.5


def test_solid_inks_are_the_tables_own(press: Press) -> None:
    """Rounding of codes: half of one is 2 sqrt(3000) sqrt(3000) / 65534 DN."""
    model = press.sensors[0]
    solid = np.array(list(product((0, 255), repeat=4)), np.uint8)
    light = np.empty(len(solid), np.float32)
    mean, _ = exact_lookup(solid, model)
    lookup_light(solid.view(np.uint32).ravel(), quantised_table(model.mean_dn), np.float32(0), light)
    np.testing.assert_allclose(light, mean, atol=0.15)

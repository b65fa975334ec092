"""Doctests print arrays as NumPy does by itself, whatever an earlier test or an import has set.

>>> np.array([0.5, 1.0])
array([0.5, 1. ])
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture(autouse=True)
def as_numpy_1_13_did() -> Iterator[None]:
    """Print as colour-science has NumPy print from its import on."""
    with np.printoptions(legacy="1.13"):
        yield

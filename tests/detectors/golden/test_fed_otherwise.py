"""A sheet that goes into a feeder by its other edge is found, though it is sheared, stretched and waved by more."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from prooflight.detectors.golden import place as placing
from prooflight.detectors.golden.place import place

LINES, PIXELS = 3300, 2550
"""A page of Letter at 300 dpi."""


def _sparse_page() -> np.ndarray:
    """Two lines of letters at the top and one at the bottom, as on a paper that leaves room for answers."""
    rng, page = np.random.default_rng(443), np.ones((LINES, PIXELS), np.float32)
    for top in (640, 720, 3180):
        for left in range(120, 2400, 21):
            if rng.random() < 0.8:
                page[top : top + 36, left : left + 15] = cv2.resize(
                    (rng.random((4, 3)) < 0.5).astype(np.float32), (15, 36), interpolation=cv2.INTER_NEAREST
                )
    return cv2.GaussianBlur(page, (0, 0), 1.0)


def test_a_sparse_page_fed_by_its_other_edge_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    golden = _sparse_page()
    y, x = np.mgrid[:LINES, :PIXELS].astype(np.float32)
    down, right = y - LINES / 2, x - PIXELS / 2
    across = (
        31 - 0.01 * down + 2.0 * np.sin(x / 80)
    )  # as two real copies: sheared, turned, stretched, and waved
    along = -18 + 0.0035 * right - 0.0075 * down
    scan = cv2.remap(golden, x - across, y - along, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    found = place(golden, scan)
    assert found.likeness > 0.95
    row, column = 3200 // found.tile_pixels, 1300 // found.tile_pixels
    centre = (
        row * found.tile_pixels + found.tile_pixels // 2,
        column * found.tile_pixels + found.tile_pixels // 2,
    )
    # A pixel is what the edge of a letter may be off by.
    assert abs(found.nodes[0, row, column] - across[centre]) < 1
    assert abs(found.nodes[1, row, column] - along[centre]) < 1
    monkeypatch.setattr(placing, "LIKE_BENT", 0.0)  # without another try it is lost
    assert place(golden, scan).likeness < 0.9

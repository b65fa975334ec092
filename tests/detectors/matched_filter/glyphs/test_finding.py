"""Glyphs of a raster: pieces as OpenCV finds them, those of a letter's size, and lines of text."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from prooflight.detectors.matched_filter.glyphs.letters import find_glyphs, hardened, lines_of
from prooflight.kernels.statistics.pieces import PIECE, RUN, filled_pieces, joined_runs, piece_boxes
from prooflight.pages.raster import Page

DPI = 200.0
BLACK, RED, TINT = (0, 0, 0, 255), (0, 255, 200, 0), (30, 0, 0, 0)


def blank() -> NDArray[np.uint8]:
    return np.zeros((200, 300, 4), np.uint8)


def letter(cmyk: NDArray[np.uint8], row: int, column: int, ink: tuple[int, ...] = BLACK) -> None:
    """An open square of 12 x 9 pixels, 1.5 mm high."""
    cmyk[row : row + 12, column : column + 9] = np.where(
        np.pad(np.zeros((8, 6, 1), bool), ((2, 2), (2, 1), (0, 0)), constant_values=True),
        ink,
        cmyk[row, column],
    )


def page(cmyk: NDArray[np.uint8]) -> Page:
    return Page(cmyk=cmyk, dpi=DPI, name="p", number=1)


@given(seed=st.integers(0, 10_000), share=st.floats(0.05, 0.95))
def test_pieces_are_those_of_opencv(seed: int, share: float) -> None:
    ink = np.random.default_rng(seed).random((23, 31)) < share
    packed = np.where(ink, np.uint32(7), np.uint32(0))
    runs, parents = np.empty((800, RUN), np.int64), np.empty(800, np.int64)
    count = joined_runs(packed, np.array([7], np.uint32), runs, parents)
    pieces = np.empty((max(count, 1), PIECE), np.int64)
    found = pieces[: piece_boxes(runs[:count], parents[:count], pieces)]
    _, labels, stats, _ = cv2.connectedComponentsWithStats(ink.view(np.uint8), connectivity=8)
    np.testing.assert_array_equal(
        sorted(map(tuple, found[:, :5])), sorted(map(tuple, stats[1:][stats[1:, 4] > 0]))
    )
    sizes = found[:, 2] * found[:, 3]
    wanted = np.cumsum(sizes) - sizes
    flat = np.zeros(int(sizes.sum()), np.uint8)
    filled_pieces(runs[:count], found, wanted, flat)
    for (x, y, width, height, area, _), begin in zip(found, wanted, strict=True):
        mask = flat[begin : begin + width * height].reshape(height, width)
        assert mask.sum() == area
        assert np.unique(labels[y : y + height, x : x + width][mask > 0]).size == 1


def test_runs_that_do_not_fit_are_said_and_not_written() -> None:
    packed = np.tile(np.array([7, 0], np.uint32), (4, 8))
    runs, parents = np.empty((5, RUN), np.int64), np.empty(5, np.int64)
    assert joined_runs(packed, np.array([7], np.uint32), runs, parents) == -1


def test_letters_are_found_with_their_ink_and_what_is_about_them() -> None:
    cmyk = blank()
    cmyk[100:150] = TINT
    letter(cmyk, 20, 40)
    letter(cmyk, 20, 60)
    letter(cmyk, 120, 80, RED)
    found = find_glyphs(page(cmyk))
    np.testing.assert_array_equal(found.box, [[40, 20, 9, 12], [60, 20, 9, 12], [80, 120, 9, 12]])
    np.testing.assert_array_equal(found.ink, [BLACK, BLACK, RED])
    np.testing.assert_array_equal(found.ground, [(0, 0, 0, 0), (0, 0, 0, 0), TINT])
    assert found.shape.tolist() == [0, 0, 0]
    assert found.masks[0].sum() == 12 * 9 - 8 * 6


def test_specks_rules_pictures_and_what_stands_across_an_edge_are_no_letters() -> None:
    cmyk = blank()
    cmyk[10:13, 10:13] = BLACK  # a full stop
    cmyk[30:32, 10:250] = BLACK  # a rule
    cmyk[60:110, 10:100] = BLACK  # a block
    cmyk[120:, 100:] = np.random.default_rng(1).integers(0, 255, (80, 200, 4))
    cmyk[150:, :50] = TINT
    letter(cmyk, 144, 20)
    assert not len(find_glyphs(page(cmyk)).box)


def test_a_page_without_ink_has_none() -> None:
    found = find_glyphs(page(blank()))
    assert found.box.shape == (0, 4)
    assert found.ink.shape == (0, 4)


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 1, 0, 2)])
def test_glyphs_beside_each_other_are_of_one_line(order: tuple[int, ...]) -> None:
    box = np.array([[10, 20, 8, 12], [30, 23, 8, 9], [200, 21, 8, 14], [10, 40, 8, 12]])
    assert lines_of(box[list(order)]).tolist() == [[1, 1, 1, 2][at] for at in order]


@given(seed=st.integers(0, 1000), rows=st.integers(1, 150))
def test_a_raster_of_whole_inks_stays_as_it_is(seed: int, rows: int) -> None:
    """Squares of 2 x 2 pixels and more."""
    ink = np.random.default_rng(seed).random((rows, 9)) < 0.5
    cmyk = np.kron(ink, np.ones((2, 2)))[..., None] * np.array(BLACK)
    packed = cmyk.astype(np.uint8).view(np.uint32)[..., 0]
    np.testing.assert_array_equal(hardened(packed), packed)


@given(seed=st.integers(0, 1000), rows=st.integers(1, 9), columns=st.integers(1, 20), every=st.integers(1, 4))
def test_an_ink_becomes_the_nearer_of_the_extremes_about_it(
    seed: int, rows: int, columns: int, every: int
) -> None:
    cmyk = np.random.default_rng(seed).integers(0, 256, (rows, columns, 4), np.uint8)
    wide = np.pad(cmyk.astype(int), ((1, 1), (1, 1), (0, 0)), mode="edge")
    about = np.stack([wide[i : i + rows, j : j + columns] for i in range(3) for j in range(3)])
    most, least = about.max(axis=0), about.min(axis=0)
    wanted = np.where(most - cmyk > cmyk - least, least, most)[::every]
    found = hardened(cmyk.view(np.uint32)[..., 0], every=every)
    np.testing.assert_array_equal(found[..., None].view(np.uint8), wanted)


@pytest.mark.parametrize(("part", "box"), [(64, [60, 40, 9, 12]), (191, [59, 39, 11, 13])])
def test_parts_of_ink_on_a_letter_s_edges_are_its_or_the_paper_s(part: int, box: list[int]) -> None:
    cmyk = blank()
    letter(cmyk, 40, 60)
    cmyk[39, 59:70, 3] = part
    found = find_glyphs(page(cmyk))
    assert found.box.tolist() == [box]
    assert found.ground.tolist() == [[0, 0, 0, 0]]

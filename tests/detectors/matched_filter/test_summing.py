"""Compiled sums give what plain NumPy does, on any data."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from prooflight.detectors.matched_filter.fit.modes import (
    PixelMap,
    QuantisedImages,
    filled_cells,
    moved,
    moved_modes,
)
from prooflight.detectors.matched_filter.fit.nuisance import Colours, ResidualVariance
from prooflight.detectors.matched_filter.fit.residuals import median_of, noise_factor
from prooflight.detectors.matched_filter.statistics.boxes import Ghosts, boxes, cells_of
from prooflight.detectors.matched_filter.statistics.local_evidence import (
    GHOST_BOXES_MM,
    LEAST_POWER,
    MODES,
    SIZES,
    Sums,
    assumed_light,
    spread_of,
    t_statistic,
    without_common,
)
from prooflight.detectors.matched_filter.statistics.page_scale import extremes_of_boxes
from prooflight.detectors.print_prior import PrintPrior
from prooflight.kernels.memory import unset
from prooflight.kernels.residuals.fit import LEVELS, SHAPES, SUMS, InkImages, block_sums
from prooflight.kernels.residuals.moving import CELL, STRETCH, move_smooth
from prooflight.kernels.residuals.residuals import (
    FittedAmounts,
    VarianceShares,
    flat_squares,
    residuals,
    variances,
)
from prooflight.kernels.statistics.boxes import own_of_cells, t_of_squares
from prooflight.kernels.statistics.misplaced_planes import swap_sums
from prooflight.kernels.statistics.streaks import levelled_parts, tile_scores, widened
from prooflight.kernels.statistics.tiles import ResidualImages, line_sums, tile_sums
from prooflight.pages.parallel import parts_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=8, deadline=None)


def images(seed: int, lines: int = 23, pixels: int = 37) -> dict[str, NDArray[np.float32]]:
    """What ``tile_sums`` takes; nothing within two pixels of the border."""
    rng = np.random.default_rng(seed)
    found = {
        "residual": rng.normal(0, 20, (lines, pixels)),
        "weight": rng.random((lines, pixels)) * (rng.random((lines, pixels)) < 0.8) * 0.02,
        "light": rng.random((lines, pixels)) * 3000,
        "white": 3000 + rng.random(pixels),
        "add": -rng.random((4, lines, pixels)) * 500,
        "gain": -rng.random((4, lines, pixels)) * 500,
        "of_edges": rng.random((lines, pixels)),
    }
    inner = np.zeros((lines, pixels))
    inner[2:-2, 2:-2] = 1
    found["weight"] *= inner
    return {name: value.astype(np.float32) for name, value in found.items()}


def products(of: dict[str, NDArray[np.float32]], most: float) -> NDArray[np.float64]:
    """N, D, C and edges of every mode pixel by pixel, (4, modes, lines, pixels)."""
    r, w, light = (of[name].astype(np.float64) for name in ("residual", "weight", "light"))
    r = np.clip(r * np.sqrt(w), -most, most) / np.sqrt(np.maximum(w, 1e-30))
    blur = 0.5 * sum(np.roll(light, by, axis) for by in (1, -1) for axis in (0, 1)) - 2 * light
    modes = np.stack([light, *of["add"], *of["gain"], of["white"] - light, blur, of["gain"].sum(axis=0)])
    return np.stack([modes * w * r, modes**2 * w, modes * light * w, modes**2 * w * of["of_edges"]]) * (w > 0)


@few
@given(seeds, st.sampled_from([2, 3, 5]))
def test_tiles_sum_what_their_pixels_say(seed: int, side: int) -> None:
    of = images(seed)
    rows, columns = 23 // side, 37 // side
    found = np.empty((4, len(MODES) + 1, rows, columns), np.float32)
    two = [of, images(seed + 1)]
    gains = 0.01 * np.random.default_rng(seed).random((2, 37)).astype(np.float32)
    for first, last in parts_of(rows, 3):
        tile_sums(
            ResidualImages(**{name: np.stack([one[name] for one in two]) for name in of}),
            gains,
            side,
            np.arange(len(MODES)),
            first,
            last,
            found,
        )
    for one, own in zip(two, gains, strict=True):
        one["residual"] = one["residual"] - one["light"] * own
    said = products(two[0], 10) + products(two[1], 10)
    cut = said[..., : rows * side, : columns * side]
    asked = cut.reshape(4, len(MODES), rows, side, columns, side).sum(axis=(3, 5))
    scale = np.abs(asked).max(axis=(2, 3), keepdims=True) + 1e-6
    np.testing.assert_allclose(found[:, :-1] / scale, asked / scale, atol=2e-5)
    z2 = sum(np.minimum(one["residual"] ** 2 * one["weight"], 25) for one in two)
    z2 = z2[: rows * side, : columns * side]
    np.testing.assert_allclose(
        found[0, -1], z2.reshape(rows, side, columns, side).sum(axis=(1, 3)), rtol=1e-4, atol=1e-3
    )


@few
@given(seeds)
def test_columns_of_a_turned_page_lie_on_each_other(seed: int) -> None:
    of = images(seed)
    shift = np.random.default_rng(seed).integers(-3, 4, 23)
    shares = np.array([0.7, 0.3], np.float32)
    found = np.zeros((2, 4, 10, 2, 37), np.float32)
    for segment in range(2):
        part = segment, segment + 1
        line_sums(ResidualImages(**of), shares, shift, 12, np.arange(10), *part, found)
    for share, found_of in zip(shares, found, strict=True):
        said = products(of, 4)[:, :10] * (of["of_edges"] <= share)
        asked = np.zeros((4, 10, 2, 37))
        for line in range(2, 21):
            for x in range(37):
                if 0 <= x - shift[line] < 37:
                    asked[:, :, line // 12, x - shift[line]] += said[:, :, line, x]
        scale = np.abs(asked).max(axis=(2, 3), keepdims=True) + 1e-6
        np.testing.assert_allclose(found_of / scale, asked / scale, atol=2e-5)


@few
@given(seeds)
def test_extremes_are_those_of_all_boxes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tiles = np.abs(rng.normal(0, 50, (4, len(MODES) + 1, 41, 30))).astype(np.float32)
    tiles[0] -= 40
    tiles[3] = tiles[1] * rng.random((len(MODES) + 1, 41, 30))
    tiles[1:, :, :8, :8] = 0  # nothing is known there
    sums = Sums(
        tiles=tiles, columns=np.zeros((4, 10, 4, 60), np.float32), flat_columns=np.zeros((4, 10, 4, 60), np.float32),
        cover=np.zeros((4, 41, 30), np.float32), shifts=np.zeros((4, 4)),
        tile_mm=0.5, pixel_mm=0.25, left_mm=0.0, top_mm=0.0, prior=PrintPrior(),
        column_gains=np.zeros((1, 60), np.float32),
    )  # fmt: skip
    scatter = rng.uniform(0.5, 2, (len(MODES), 3)) * [1, 1, 1e-4]
    merged = tiles
    for cells, size in zip(cells_of(sums, assumed_light(PrintPrior())), SIZES, strict=True):
        assert cells.size == size
        np.testing.assert_allclose(merged, cells.sums, rtol=1e-4, atol=1e-1)
        own, power, edges = boxes(cells)
        merged = cells.room(len(MODES))
        for mode, found in enumerate(extremes_of_boxes(cells, scatter, overlap=4, larger=merged)):
            t = t_statistic(own[mode], power[mode], edges[mode], scatter[mode])
            high, low = max(t.max(), 0), min(t.min(), 0)
            assert found.high == pytest.approx(high, rel=2e-3, abs=1e-3)
            assert found.low == pytest.approx(low, rel=2e-3, abs=1e-3)
            if high > 0:
                assert t[tuple(found.places[0])] == pytest.approx(high, rel=2e-3, abs=1e-3)
            assert found.energy == pytest.approx(np.minimum(t[t != 0] ** 2, 100).mean(), rel=1e-2)


ONE = np.ones(1, np.float32)


@few
@given(seeds, st.floats(-3, 3), st.floats(-3, 3))
def test_images_move_as_lines_say(seed: int, right: float, down: float) -> None:
    """Exact for a plane, and what ``scipy.ndimage`` finds of anything."""
    rng = np.random.default_rng(seed)
    lines, pixels = 40, 52
    nodes = -(-lines // STRETCH) + 1, -(-pixels // STRETCH) + 1
    across = (right + rng.normal(0, 0.003, nodes)).astype(np.float32)
    along = (down + rng.normal(0, 0.003, nodes)).astype(np.float32)
    y, x = np.mgrid[:lines, :pixels].astype(np.float64)
    at = [
        ndimage.map_coordinates(n.astype(np.float64), [y / STRETCH, x / STRETCH], order=1)
        for n in (along, across)
    ]
    where = [y + at[0], x + at[1]]
    inner = (slice(6, -6), slice(6, -6))
    noise = rng.random((lines, pixels)).astype(np.float32)
    found = np.empty_like(noise)
    move_smooth(noise[None], ONE, filled_cells(noise[None]), np.array([0]), across, along, 0, found[None])
    asked = ndimage.map_coordinates(noise.astype(np.float64), where, order=1)
    np.testing.assert_allclose(found[inner], asked[inner], atol=2e-2)  # weights a little beyond a pixel
    plane = (3 * x - 2 * y).astype(np.float32)
    move_smooth(plane[None], ONE, filled_cells(plane[None]), np.array([0]), across, along, 0, found[None])
    np.testing.assert_allclose(found[inner], (3 * where[1] - 2 * where[0])[inner], atol=1e-2)


@few
@given(seeds, st.integers(0, 3 * STRETCH - 1), st.floats(-20, 20))
def test_an_image_with_a_single_line_moves_as_one_that_is_full(seed: int, line: int, down: float) -> None:
    rng = np.random.default_rng(seed)
    images = np.zeros((3, 3 * STRETCH, 40), np.float32)
    images[1, line] = rng.random(40)
    images[2] = images[1] + 1
    across, along = np.full((2, 4, 4), 0.3, np.float32)
    along[:] = down + rng.normal(0, 0.5, along.shape)
    found, ones = np.full_like(images, np.nan), np.empty_like(images[:1])
    move_smooth(images, np.ones(3, np.float32), filled_cells(images), np.arange(3), across, along, 0, found)
    move_smooth(
        np.ones_like(ones), ONE, filled_cells(np.ones_like(ones)), np.array([0]), across, along, 0, ones
    )
    np.testing.assert_array_equal(found[0], 0)
    np.testing.assert_allclose(found[1], found[2] - ones[0], atol=1e-5)


def test_quantised_images_move_as_their_values_do() -> None:
    """Of either sign and of any size; a level is 1/65,535 of an image's greatest value."""
    rng = np.random.default_rng(3)
    images = rng.random((3, 40, 52)).astype(np.float32) * np.float32([[[3000.0]], [[-1e-3]], [[0.0]]])
    images[:, 10:20] = 0
    kept = QuantisedImages.of(images)
    most = np.abs(images).max(axis=(1, 2))
    np.testing.assert_array_equal(kept.values == 0, images == 0)
    assert (np.abs(kept.values - images).max(axis=(1, 2)) <= 0.51 * most / 65535).all()
    nodes = np.full((4, 5), 0.3, np.float32)
    where = PixelMap(across=nodes, along=-nodes, inside=np.ones((40, 52), bool))
    difference = np.abs(moved(kept, where) - moved(kept.values, where)).max(axis=(1, 2))
    assert (difference <= 1e-6 * most).all()


def test_cleared_modes_are_moved_images() -> None:
    images = np.zeros((13, 3 * STRETCH, 52), np.float32)
    images[[2, 5, 8, 12], STRETCH + 4] = 1
    nodes = np.full((5, 5), 0.3, np.float32)
    where = PixelMap(across=nodes, along=-nodes, inside=np.ones(images.shape[1:], bool))
    unset(images.shape)[...] = np.nan  # what the memory of the modes has from another sheet
    modes = moved_modes(QuantisedImages.of(images), where, 1)
    modes.cleared()
    np.testing.assert_array_equal(modes.images, moved(QuantisedImages.of(images), where))


@few
@given(seeds)
def test_echoes_are_found_where_detail_is_repeated(seed: int) -> None:
    rng = np.random.default_rng(seed)
    detail = rng.normal(0, 0.1, (4, 60, 80)).astype(np.float32)
    own = rng.normal(0, 0.1, (4, 60, 80)).astype(np.float32)
    lag = int(rng.integers(3, 20))
    own[1, lag:] += 5 * detail[1, :-lag]
    one = np.ones((4, 60, 80), np.float32)
    seen = Ghosts(
        own=own, power=one, edges=0 * one, detail=detail, present=np.ones(4, bool),
        lags=np.arange(3, 21), square_mm=1.0,
    )  # fmt: skip
    found = seen.through(1)[0].t(np.array([1.0, 1.0, 0.0]))
    rows, columns = seen.bands(GHOST_BOXES_MM[0])
    asked = np.zeros_like(found)
    for which, down in enumerate(seen.lags):
        echo = np.zeros((60, 80))
        echo[down:] = detail[1, : 60 - down]
        for n, (top, bottom) in enumerate(rows):
            for m, (left, right) in enumerate(columns):
                power = (echo[top:bottom, left:right] ** 2).sum()
                push = (own[1] * echo)[top:bottom, left:right].sum()
                asked[n, m, which] = push / np.sqrt(power + 1e-6) if power > 1e-3 else 0.0
    np.testing.assert_allclose(found, asked, rtol=1e-3, atol=1e-3)


@few
@given(seeds)
def test_blocks_sum_their_pixels(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = 24, 32
    measured = rng.integers(0, 4000, shape).astype(np.uint16)
    expected, variance, texture = rng.random((3, *shape)).astype(np.float32) * 3000
    gain, dot = -rng.random((2, 4, *shape)).astype(np.float32) * 100
    # Well within a level: halfway between two, single precision may take either.
    cover = ((rng.integers(1, LEVELS - 1, (4, *shape)) + rng.uniform(-0.4, 0.4)) / (LEVELS - 1)).astype(
        np.float32
    )
    inside, offset = rng.random(shape) < 0.9, rng.random(32).astype(np.float32)
    bells = rng.random((4, LEVELS, SHAPES)).astype(np.float32)
    corners = np.array([[8, 8], [8, 16]])
    found = np.empty((2, SUMS), np.float32)
    inks = InkImages(gain=gain, dot=dot, texture=texture, cover=cover, shown=np.ones((3, 4, 2, 1), bool))
    block_sums(measured, expected, offset, variance, inks, inside, bells, corners, found)
    light = expected - offset
    levels = np.rint(cover.astype(np.float64) * (LEVELS - 1)).astype(int)
    bell = np.prod([bells[ink, levels[ink]] for ink in range(4)], axis=0)
    planes = [gain * np.gradient(cover, axis=axis) / cover * (cover > 0.02) for axis in (2, 1)]
    slope = np.gradient(expected, axis=1) ** 2 + np.gradient(expected, axis=0) ** 2
    channels = [np.ones(shape), measured - expected, light, variance, slope, texture, *gain, *dot]
    channels += [*np.moveaxis(bell * light[..., None], -1, 0), *planes[0], *planes[1]]
    for block, (top, left) in enumerate(corners):
        here = (slice(top, top + 8), slice(left, left + 8))
        asked = np.array([(one * inside)[here].sum() for one in channels])
        np.testing.assert_allclose(found[block], asked, rtol=2e-3, atol=np.abs(asked).max() * 1e-6 + 1e-2)


@few
@given(seeds)
def test_residuals_are_what_the_fit_leaves(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape, pixels = (24, 32), 32
    measured = rng.integers(0, 4000, shape).astype(np.uint16)
    expected, offset = rng.random(shape).astype(np.float32) * 3000, rng.random(pixels).astype(np.float32)
    gain, dot = -rng.random((2, 4, *shape)).astype(np.float32) * 100
    cover, inside = rng.random((4, *shape)).astype(np.float32), rng.random(shape) < 0.9
    cover[2], gain[2], dot[2] = 0, 0, 0
    centres = rng.random((5, 4)).astype(np.float32)
    root = np.linalg.inv(np.linalg.cholesky(np.eye(5) + 0.5)).astype(np.float32)
    colours, amounts = Colours(centres=centres, root=root), 0.01 * rng.standard_normal(5)
    columns, gains = rng.random(pixels).astype(np.float32) * 0.01, rng.random((4, 3)).astype(np.float32)
    dots, planes = rng.random(4).astype(np.float32), rng.random((4, 2)).astype(np.float32)
    found = np.empty(shape, np.float32)
    shown = (cover.any(axis=(1, 2)) & np.ones((3, 2, 1), bool)).swapaxes(1, 2)[..., None]
    inks = InkImages(gain=gain, dot=dot, texture=np.zeros(shape, np.float32), cover=cover, shown=shown)
    fitted = FittedAmounts(
        shape=colours.weights(amounts), columns=columns, gain=gains, dot=dots, planes=planes
    )
    for first, last in parts_of(shape[0], 3):
        residuals(measured, expected, offset, inside, inks, colours.bells(), fitted, first, last, found)
    kernel = np.exp(-((cover[None] - centres[:, :, None, None]) ** 2).sum(axis=1) / 0.25)
    relative = np.einsum("i,ij,jyx->yx", amounts, root, kernel) + columns
    v, u = np.meshgrid(*(2 * (np.arange(n) + 0.5) / n - 1 for n in shape), indexing="ij")
    fitted = (expected - offset) * relative
    for ink in range(4):
        tilted = gains[ink, 0] + gains[ink, 1] * u + gains[ink, 2] * v
        fitted += gain[ink] * tilted + dot[ink] * dots[ink]
        along, across = np.gradient(cover[ink])
        printed = np.maximum(cover[ink], 0.02)
        fitted -= (
            (cover[ink] > 0.02) * gain[ink] / printed * (across * planes[ink, 0] + along * planes[ink, 1])
        )
    asked = np.where(inside, measured - expected - fitted, 0)[1:-1, 1:-1]
    np.testing.assert_allclose(
        found[1:-1, 1:-1], asked, atol=0.5, rtol=1e-3
    )  # recipes that are alike share a value
    assert not found[0].any()
    assert not found[:, -1].any()


@few
@given(seeds)
def test_residuals_ignore_what_cells_without_ink_hold(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = 40, 150
    shown = np.zeros((3, 4, 3, 3), bool)
    shown[:, 3, :, 0], shown[:, :, 1:, 1] = True, True  # black alone, all inks, and none
    printed = np.repeat(np.repeat(shown[0], STRETCH, axis=1), CELL, axis=2)[:, : shape[0], : shape[1]]
    cover = (rng.random((4, *shape)) * printed).astype(np.float32)
    gain, dot = (-100 * rng.random((2, 4, *shape)) * printed).astype(np.float32)
    measured, expected = 3000 * rng.random((2, *shape)).astype(np.float32)
    offset, columns = 0.01 * rng.random((2, shape[1])).astype(np.float32)
    bells, inside = rng.random((4, LEVELS, SHAPES)).astype(np.float32), rng.random(shape) < 0.9
    amounts = [rng.random(size).astype(np.float32) for size in ((4, 3), (4,), (4, 2))]
    fitted = FittedAmounts(rng.random(SHAPES).astype(np.float32), columns, *amounts)
    found = np.empty((2, *shape), np.float32)
    for blank, cells, out in ((0, np.ones_like(shown), found[0]), (np.nan, shown, found[1])):
        effects = (np.where(printed, one, np.float32(blank)) for one in (gain, dot))
        inks = InkImages(*effects, texture=np.zeros(shape, np.float32), cover=cover, shown=cells)
        residuals(measured, expected, offset, inside, inks, bells, fitted, 0, shape[0], out)
    np.testing.assert_allclose(found[1], found[0], rtol=1e-4, atol=0.02)


@few
@given(seeds)
def test_streaks_are_sums_of_columns_less_what_lies_about_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns = np.abs(rng.normal(0, 50, (4, 10, 8, 90))).astype(np.float32)
    columns[2] = np.sqrt(columns[1] * columns[1, :1])
    columns[3] = columns[1] * rng.random((10, 8, 90))
    known, wide, length, step, count = 1 / PrintPrior().place ** 2, 21, 4, 2, 4
    found = np.empty((4, 10, 3, 90), np.float32)
    levelled_parts(columns, length, step, np.float32(known), wide, found)
    parts = [columns[:, :, k : k + length] for k in (0, 2, 4)]
    sums = np.stack([one.sum(axis=2) for one in parts], axis=2)
    own, power, edges = without_common(sums, PrintPrior().place)
    push, said = (
        ndimage.uniform_filter1d(one.astype(np.float64), wide, mode="nearest") for one in (own, power)
    )
    share = sums[2] / (sums[1, 0] + known)
    apart = [one[2] - one[1, 0] * share[:, k, None] for k, one in enumerate(parts)]
    uneven = np.stack([(one**2).sum(axis=1) for one in apart], axis=1)
    uneven[0] = 0  # light itself
    asked = np.stack([own - push / (said + 1e-6) * power, power, edges, uneven])
    np.testing.assert_allclose(found[:3], asked[:3], rtol=1e-3, atol=1e-2)
    np.testing.assert_allclose(found[3], asked[3], rtol=1e-3, atol=1e-2)
    wider = np.empty_like(found)
    widened(found.reshape(-1, 90), count, wider.reshape(-1, 90))
    np.testing.assert_allclose(
        wider, ndimage.uniform_filter1d(found, count, mode="constant") * count, rtol=1e-3, atol=1e-2
    )


@few
@given(seeds)
def test_swaps_are_summed_by_blocks(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tiles = np.abs(rng.normal(0, 50, (4, 9, 11, 14))).astype(np.float32)
    tiles[2] = 0.5 * np.sqrt(tiles[1] * tiles[1, :1])
    cover = rng.random((4, 11, 14)).astype(np.float32)
    found = np.empty((2, 1, 2, 3), np.float32)
    swap_sums(tiles, cover, np.array([[1, 3]]), np.float32(1 / PrintPrior().place ** 2), 4, found)
    own, power, _ = without_common(tiles, PrintPrior().place)
    push, said = own[1:5] + own[5:9], power[1:5] + power[5:9]
    step = cover[3] - cover[1]
    for got, all_of in zip(found, (step * (push[1] - push[3]), step**2 * (said[1] + said[3])), strict=True):
        asked = all_of[:8, :12].reshape(2, 4, 3, 4).sum(axis=(1, 3))
        np.testing.assert_allclose(got[0], asked, rtol=1e-3, atol=1e-2)


@few
@given(seed=seeds)
def test_variances_are_what_they_are_said_to_be(seed: int) -> None:
    """To single precision: logarithms are a polynomial's."""
    rng = np.random.default_rng(seed)
    shape, white = (19, 45), 2850.0
    light = (white * rng.random(shape) ** 3 * 1.1).astype(np.float32)
    light[rng.random(shape) < 0.2] = -5
    variance, texture = (rng.random((2, *shape)) * [[[60]], [[1e5]]]).astype(np.float32)
    inside = rng.random(shape) < 0.9
    shares = VarianceShares._make(map(np.float32, (1.2, 0.004, 0.0009, 0.002, 0.02, white)))
    sure, of_edges = np.empty((2, *shape), np.float32)
    for first, last in parts_of(shape[0], 3):
        variances(light, variance, texture, inside, shares, first, last, sure, of_edges)

    wide = light.astype(np.float64)
    across, along = (np.gradient(wide, axis=axis) for axis in (1, 0))
    slope = 0.004 * ndimage.uniform_filter(across**2 + along**2, 3)
    rest = 1.2 * variance + slope + 0.0009 * texture
    depth = np.log(white / wide.clip(0.01 * white, white))
    asked = 1 / (rest + ((0.002 + 0.02 * depth**2) * wide) ** 2)
    inner = np.zeros(shape, bool)
    inner[2:-2, 2:-2] = inside[2:-2, 2:-2]
    np.testing.assert_allclose(sure, asked * inner, rtol=1e-5)
    np.testing.assert_allclose(of_edges, slope / (rest + (0.002 * wide) ** 2) * inner, rtol=1e-5)


@few
@given(seeds, st.integers(2, 24), st.integers(2, 40))
def test_flat_squares_are_all_that_are_flat(seed: int, lines: int, pixels: int) -> None:
    rng = np.random.default_rng(seed)
    left, light = rng.normal(0, [[[9]], [[15]]], (2, lines, pixels)).astype(np.float32)
    variance, texture = (rng.random((2, lines, pixels)) * [[[200]], [[1e4]]] + 20).astype(np.float32)
    inside = rng.random((lines, pixels)) < 0.97
    found = np.empty((2, (lines // 2) * (pixels // 2)), np.float32)
    count = flat_squares(left, variance, light, texture, inside, 2.0, found)

    rows, columns = lines // 2 * 2, pixels // 2 * 2
    a, b, c, d = (left[i:rows:2, j:columns:2] for i in (0, 1) for j in (0, 1))
    first = slice(None, rows, 2), slice(None, columns, 2)
    steep = np.abs(light[1:rows:2, 1:columns:2] - light[first])
    flat = ndimage.minimum_filter(inside, 3)[first] & (steep < 2 * np.sqrt(variance[first]))
    square = (a - b - c + d) ** 2 / (4 * variance[first])
    np.testing.assert_allclose(found[0, :count], square[flat], rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(found[1, :count], (texture / variance)[first][flat], rtol=1e-6)


@pytest.mark.parametrize("plain", [1.0, 0.3, 0.02])
def test_noise_is_found_where_paper_is_plain_or_plainest(plain: float) -> None:
    """Of 1.4 times the variance stated, with halftones over all but so much of the page."""
    rng = np.random.default_rng(5)
    shape = (200, 300)
    squares = rng.random((100, 150)) * 4e4 * (rng.random((100, 150)) >= plain)
    texture = np.kron(squares, np.ones((2, 2))).astype(np.float32)
    more = ResidualVariance()
    left = (rng.normal(size=shape) * np.sqrt(1.4 * 60 + more.contrast * texture)).astype(np.float32)
    variance, light = np.full(shape, 60, np.float32), np.full(shape, 2000, np.float32)
    found = noise_factor(left, variance, light, texture, np.ones(shape, bool), more)
    assert found == pytest.approx(1.4, rel=0.1)


@few
@given(seeds)
def test_tiles_by_themselves_say_what_boxes_of_one_would(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cells = rng.normal(0, 5, (4, 3, 9, 14)).astype(np.float32)
    cells[1], cells[3] = np.abs(cells[1]) + 1, np.abs(cells[3]) / 9
    gains, level = (rng.normal(0, 0.01, shape).astype(np.float32) for shape in (9, (9, 14)))
    found, prior = np.empty((3, 9, 14), np.float32), 0.3
    own_of_cells(cells, gains, level, np.float32(1 / prior**2), 2, found)
    asked = cells.copy()
    asked[0] -= asked[2] * (gains[:, None] + level)
    for one, other in zip(found, without_common(asked, prior), strict=True):
        np.testing.assert_allclose(one, other[2], rtol=1e-4, atol=1e-5)

    t, known = np.empty((2, 9, 14), np.float32)
    scatter = np.array([1.2, 3.0, 0.02], np.float32)
    tile_scores(*found, scatter, np.float32(LEAST_POWER), t, known)
    spread = spread_of(found[1], found[2], scatter.astype(np.float64))
    informed = found[1] > LEAST_POWER
    np.testing.assert_allclose(t, t_statistic(*found, scatter.astype(np.float64)), rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(known, np.where(informed, found[1] ** 2 / spread, 0), rtol=1e-4)


@few
@given(seeds)
def test_squares_of_tiles_say_what_their_sums_do(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tiles = rng.random((3, 9, 37)).astype(np.float32)
    tiles[0] -= 0.5
    tiles[:, :3, :4] = 0  # nothing is known there
    rows, columns = np.array([0, 1, 2, 5, 8]), np.array([0, 1, 2, 20, 36])
    scatter, t = np.array([1.2, 0.7, 0.01]), np.empty((5, 5), np.float32)
    push, power, edges = tiles
    t_of_squares(push, power, edges, rows, columns, scatter.astype(np.float32), np.float32(LEAST_POWER), t)
    down = tiles[:, rows] + tiles[:, np.maximum(rows - 1, 0)]
    own, known, of_edges = down[..., columns] + down[..., np.maximum(columns - 1, 0)]
    np.testing.assert_allclose(t, t_statistic(own, known, of_edges, scatter), rtol=1e-4, atol=1e-6)


@few
@given(seeds, st.integers(1, 3000))
def test_the_median_of_flat_squares_is_the_median(seed: int, count: int) -> None:
    values = np.random.default_rng(seed).chisquare(1, count).astype(np.float32)
    assert median_of(values) == float(np.median(values))

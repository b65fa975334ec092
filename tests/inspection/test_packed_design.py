"""Packed designs: the same design in less memory, and nothing written beyond an array."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.inspection.inspector import Inspector
from prooflight.inspection.packed_design import PackedArray, PackedDesign, size_bytes

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([(7, 9, 4), (3, 5, 600), (1, 1, 4), (4, 3)]),
    st.sampled_from([np.uint8, np.uint16, np.float32]),
)
def test_arrays_come_back_as_they_were(seed: int, shape: tuple[int, ...], dtype: type) -> None:
    rng = np.random.default_rng(seed)
    array = (rng.random(shape) < rng.random()).astype(dtype) * rng.integers(0, 255, shape).astype(dtype)
    array[1:2] = array[:1]
    packed = PackedArray.of(array)
    np.testing.assert_array_equal(packed.written(), array)
    assert packed.written().dtype == dtype


def test_flat_rows_take_little_room_and_noise_no_more_than_itself() -> None:
    flat, noise = np.zeros((1000, 1000), np.uint32), np.random.default_rng(1).integers(0, 2**32, (1000, 1000))
    flat[500:] = 7
    places = 16 * len(flat)
    assert PackedArray.of(flat).nbytes - places == 2 * 4 * 5
    assert PackedArray.of(noise.astype(np.uint32)).nbytes - places == 4 * noise.size


def test_a_row_takes_room_only_where_it_differs_from_the_row_above() -> None:
    picture = np.random.default_rng(2).integers(0, 2**32, 200).astype(np.uint32)
    rows = np.repeat(picture[None], 100, axis=0)
    rows[1:, 50:53] = np.arange(297).reshape(99, 3)
    packed = PackedArray.of(rows)
    np.testing.assert_array_equal(packed.written(), rows)
    # The first row as it is; of each other, three cells, and marks and lengths of three pieces.
    assert packed.nbytes - 16 * len(rows) == 4 * 200 + 99 * (4 * 3 + 6)


@pytest.mark.parametrize("mark", [0, 255])
@pytest.mark.parametrize("part", ["values", "lengths", "value_at", "length_at"])
def test_runs_that_do_not_fill_their_array_are_refused(part: str, mark: int) -> None:
    array = np.repeat(np.arange(40, dtype=np.uint32), 25).reshape(10, 100)
    packed = PackedArray.of(array)
    spoilt = {"values": np.zeros(2, np.uint32), "lengths": np.full(40, mark, np.uint8)}
    spoilt |= {"value_at": np.full(10, 39), "length_at": np.full(10, 400)}
    runs = packed.runs._replace(**{part: spoilt[part]})
    with pytest.raises(ValueError, match="ends before its rows do"):
        replace(packed, runs=runs).written()


def test_size_counts_each_array_once() -> None:
    array = np.zeros(100, np.uint8)

    @dataclass
    class Nested:
        one: Any
        more: tuple[Any, ...]

    assert size_bytes(Nested(one=array, more=(array, np.zeros(11, np.uint8)))) == 111


def test_a_design_comes_back_as_it_was_prepared(trained_press: Press, page: Page) -> None:
    inspector = Inspector(trained_press).with_threads(1)
    prepared = inspector.prepare(page)
    packed = PackedDesign.of(prepared, {})
    again = packed.unpacked(threads=2)
    np.testing.assert_array_equal(again.page.cmyk, page.cmyk)
    own, found = prepared.prepared_page.prepared_page, again.prepared_page.prepared_page  # type: ignore[attr-defined]
    np.testing.assert_array_equal(found.images.levels, own.images.levels)
    np.testing.assert_array_equal(found.landmarks.windows, own.landmarks.windows)
    np.testing.assert_array_equal(found.added.images, own.added.images)
    large = (page.cmyk, own.images.levels, own.landmarks.windows, own.hidden)
    assert packed.nbytes < sum(one.nbytes for one in large if one is not None) / 2


def test_arrays_that_are_written_out_once_are_the_same_in_every_inspection(
    trained_press: Press, page: Page
) -> None:
    packed = PackedDesign.of(Inspector(trained_press).prepare(page), {})
    written = packed.written_out()
    cmyk = written.unpacked().page.cmyk
    assert written.unpacked().page.cmyk is cmyk
    np.testing.assert_array_equal(cmyk, page.cmyk)
    assert packed.written_bytes == sum(one.written().nbytes for one in packed.arrays.values())
    assert written.written_bytes == 0


def test_another_detectors_design_stays_as_it_is(press: Press, page: Page) -> None:
    prepared = Inspector.of(press, "chi-square").prepare(page)
    assert PackedDesign.of(prepared, {}).unpacked() is prepared

"""Every pixel format against its closed form: bits written one by one, as the convention draws them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.errors import ScanError
from prooflight_line.cameras.pixel_formats import PIXEL_FORMATS, pixel_format, unpacked

NAMES = tuple(PIXEL_FORMATS)


def packed(values: np.ndarray, name: str) -> np.ndarray:
    """Numbers (n,) -> bytes, from the drawings of PFNC and GigE Vision, a bit at a time."""
    form = PIXEL_FORMATS[name]
    if name.endswith("p"):  # one stream of bits, the least first
        bits = [value >> bit & 1 for value in values.tolist() for bit in range(form.bits)]
        bits += [0] * (-len(bits) % 8)
        return np.packbits(np.array(bits, np.uint8), bitorder="little")
    if name.endswith("Packed"):
        low = form.bits - 8
        pairs = np.pad(values, (0, values.size % 2)).reshape(-1, 2).tolist()
        told = [
            (first >> low, (first & (1 << low) - 1) | (second & (1 << low) - 1) << 4, second >> low)
            for first, second in pairs
        ]
        return np.array(told, np.uint8).ravel()[: -(-values.size * 12 // 8)]
    return values.astype("<u2").view(np.uint8) if form.bits > 8 else values.astype(np.uint8)


@given(
    name=st.sampled_from(NAMES),
    lines=st.integers(1, 5),
    pixels=st.integers(1, 19),
    seed=st.integers(0, 2**32 - 1),
)
def test_every_number_comes_back_whatever_the_width(name: str, lines: int, pixels: int, seed: int) -> None:
    form = PIXEL_FORMATS[name]
    rng = np.random.default_rng(seed)
    values = rng.integers(0, form.top_code_dn + 1, (lines, pixels, form.sensors), np.uint16)
    found = unpacked(packed(values.ravel(), name), form, lines=lines, pixels=pixels)
    assert found.dtype == np.uint16
    assert found.flags.c_contiguous
    np.testing.assert_array_equal(found, values.transpose(2, 0, 1))


@pytest.mark.parametrize(
    ("name", "data", "numbers"),
    [
        ("Mono12p", [0xAB, 0xCD, 0xEF], [0xDAB, 0xEFC]),
        ("Mono12Packed", [0xAB, 0xCD, 0xEF], [0xABD, 0xEFC]),
        ("Mono10Packed", [0xFF, 0x12, 0x00], [0x3FE, 0x001]),
        ("Mono10p", [0x01, 0x08, 0x30, 0x00, 0x01], [0x001, 0x002, 0x003, 0x004]),
        ("Mono16", [0x34, 0x12], [0x1234]),
    ],
)
def test_numbers_worked_out_by_hand(name: str, data: list[int], numbers: list[int]) -> None:
    found = unpacked(np.array(data, np.uint8), PIXEL_FORMATS[name], lines=1, pixels=len(numbers))
    assert found[0, 0].tolist() == numbers


@pytest.mark.parametrize("name", NAMES)
def test_bytes_behind_lines_are_no_pixels(name: str) -> None:
    form = PIXEL_FORMATS[name]
    values = np.arange(3 * 8 * form.sensors, dtype=np.uint16).reshape(3, 8, form.sensors)
    rows = [np.append(packed(row.ravel(), name), [255, 255]).astype(np.uint8) for row in values]
    data = np.concatenate(rows)
    for sent in (data, data[:-2]):  # some cameras leave out the last line's
        found = unpacked(sent, form, lines=3, pixels=8, padding=2)
        np.testing.assert_array_equal(found, values.transpose(2, 0, 1))


def test_what_cannot_be_read_is_said_in_one_line() -> None:
    with pytest.raises(
        ScanError, match=r"^cam 1: sends pixel format YUV422_8; set its PixelFormat to one of Mono8, "
    ):
        pixel_format("YUV422_8", where="cam 1")
    with pytest.raises(ScanError, match="sent 7 bytes where 2 lines of 4 Mono8 pixels take 8"):
        unpacked(np.zeros(7, np.uint8), PIXEL_FORMATS["Mono8"], lines=2, pixels=4)
    with pytest.raises(ScanError, match="end within a byte"):
        unpacked(np.zeros(99, np.uint8), PIXEL_FORMATS["Mono12p"], lines=2, pixels=3, padding=2)

"""TIFFs made to exhaust time or memory are refused before anything of them is decoded."""

from __future__ import annotations

import io
import logging
import struct
import tracemalloc
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import tifffile

from prooflight.errors import InputError, JobError, ScanError
from prooflight.pages import files, memory
from prooflight.pages.tiff_images import IMAGES_MAX
from prooflight.scans.pictures import picture_files
from prooflight.scans.recorded import recorded_scans

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

WIDTH, LENGTH, TYPE_SHORT, TYPE_LONG = 256, 257, 3, 4
CMYK = {"photometric": "separated", "resolution": (300, 300), "metadata": None}


def tiff(image: np.ndarray[Any, Any], **options: Any) -> bytearray:
    buffer = io.BytesIO()
    tifffile.imwrite(buffer, image, **options)
    return bytearray(buffer.getvalue())


def entry(data: bytes, code: int) -> int:
    """Where a tag of the first directory lies."""
    (at,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<H", data, at)
    return next(
        at + 2 + 12 * n for n in range(count) if struct.unpack_from("<H", data, at + 2 + 12 * n)[0] == code
    )


def changed(data: bytearray, code: int, value: int, *, count: int = 1, kind: int = TYPE_LONG) -> bytearray:
    struct.pack_into("<HHII", data, entry(data, code), code, kind, count, value)
    return data


def next_directory(data: bytearray, value: int) -> bytearray:
    (at,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<H", data, at)
    struct.pack_into("<I", data, at + 2 + 12 * count, value)
    return data


def circle() -> bytearray:
    data = tiff(np.zeros((8, 8, 4), np.uint8), **CMYK)
    return next_directory(data, struct.unpack_from("<I", data, 4)[0])


def endless() -> bytearray:
    """More directories than any job has, none twice."""
    data = tiff(np.zeros((8, 8, 4), np.uint8), **CMYK)
    first = len(data)
    one = struct.pack("<HHHII", 1, WIDTH, TYPE_LONG, 1, 8)
    for n in range(IMAGES_MAX):
        data += one + struct.pack("<I", first + 18 * (n + 1))
    return next_directory(data, first)


def shared_tiles(side: int = 40_000) -> bytearray:
    """Every tile is the same few bytes of the file."""
    data = tiff(np.zeros((256, 256), np.uint16), tile=(256, 256), compression="zlib", metadata=None)
    tiles = (-(-side // 256)) ** 2
    offset, size = (struct.unpack_from("<I", data, entry(data, code) + 8)[0] for code in (324, 325))
    for code, value in ((324, offset), (325, size)):
        place = len(data)
        data += struct.pack("<I", value) * tiles
        changed(data, code, place, count=tiles)
    return changed(changed(data, WIDTH, side), LENGTH, side)


def overlapping(side: int = 2048) -> bytearray:
    """As above, small enough for memory."""
    return shared_tiles(side)


def huge_tile() -> bytearray:
    data = tiff(np.zeros((16, 16), np.uint16), tile=(16, 16), compression="zlib", metadata=None)
    return changed(changed(data, 322, 1 << 16), 323, 1 << 16)


def many_values() -> bytearray:
    return changed(tiff(np.zeros((8, 8), np.uint16), metadata=None), 273, 8, count=2**32 - 1)


def jpeg_within() -> bytearray:
    """A strip of 16 lines whose JPEG says that it has 65,000."""
    data = tiff(np.zeros((16, 16, 4), np.uint8), compression="jpeg", **CMYK)
    at = data.index(b"\xff\xc0")
    struct.pack_into(">HH", data, at + 5, 65000, 65000)
    return data


def other_compression() -> bytearray:
    return changed(tiff(np.zeros((8, 8, 4), np.uint8), **CMYK), 259, 34712)


def two_widths() -> bytearray:
    return changed(tiff(np.zeros((8, 8), np.uint16), metadata=None), WIDTH, 8, count=2, kind=TYPE_SHORT)


def no_width() -> bytearray:
    return changed(tiff(np.zeros((8, 8), np.uint16), metadata=None), WIDTH, 0)


def read_scan(path: Path) -> object:
    return recorded_scans(path, sensors=1)[0].read()


READERS: dict[Callable[[], bytearray], Callable[[Path], object]] = {
    **dict.fromkeys((circle, endless, jpeg_within, other_compression), files.read_image),
    huge_tile: lambda path: picture_files(path)[0].read(),
}


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (circle, "form a loop"),
        (endless, f"more than {IMAGES_MAX} images"),
        (shared_tiles, r"40000 x 40000 pixels need|pieces of its image overlap"),
        (overlapping, "pieces of its image overlap"),
        (huge_tile, "tiles are larger than its image"),
        (many_values, "tag 273 holds 4294967295 values|truncated"),
        (jpeg_within, "a JPEG of 65000 x 65000 pixels is in a smaller strip"),
        (two_widths, "tag 256 holds 2 values"),
        (no_width, "0 x 8 pixels"),
        (other_compression, "compression 34712"),
    ],
)
def test_bombs_are_refused_at_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, make: Any, what: str
) -> None:
    path = tmp_path / "bomb.tif"
    path.write_bytes(make())
    tracemalloc.start()
    try:
        with caplog.at_level(logging.DEBUG), pytest.raises(InputError, match=what) as caught:
            READERS.get(make, read_scan)(path)
        assert tracemalloc.get_traced_memory()[1] < 64e6
    finally:
        tracemalloc.stop()
    assert str(path) in str(caught.value)
    assert not caplog.records  # tifffile speaks through the error alone


def test_a_scan_that_its_press_cannot_have_made_is_not_decoded(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, np.zeros((40, 50), np.uint16), metadata=None)
    (scan,) = recorded_scans(path, sensors=1)
    assert scan.read(pixels=50, lines_max=40).shape == (1, 40, 50)
    with pytest.raises(ScanError, match="1 sensors x 40 lines x 50 pixels; the press has 49 pixels"):
        scan.read(pixels=49, lines_max=40)
    with pytest.raises(ScanError, match="at most 39 lines"):
        scan.read(pixels=50, lines_max=39)


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
@pytest.mark.parametrize("strip", [64, 2000])
def test_a_page_takes_what_is_reckoned_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, depth: type, strip: int
) -> None:
    reckoned = []

    def note(*_: object, needed_bytes: float, **__: object) -> None:
        reckoned.append(needed_bytes)

    path = tmp_path / "a.tif"
    image = np.random.default_rng(1).integers(0, 255, (2000, 1500, 4)).astype(depth)
    path.write_bytes(tiff(image, compression="zlib", rowsperstrip=strip, **CMYK))
    monkeypatch.setattr("prooflight.pages.tiff_images.refuse_unaffordable", note)
    files.read_page(path)
    tracemalloc.start()
    try:
        files.read_page(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 1.15 * reckoned[0] + 12e6  # tifffile reads ahead; bands of rows are converted
    assert reckoned[0] < (4 + 2.1 * depth().itemsize * 4 * strip / 2000) * image.size / 4 + 2e6


def test_a_large_file_may_take_more_than_a_small_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "available_bytes", lambda: 1e12)
    memory.refuse_unaffordable(JobError, "a", "1 x 1 pixels", needed_bytes=2.0e9, file_bytes=10_000)
    memory.refuse_unaffordable(JobError, "a", "1 x 1 pixels", needed_bytes=6.0e9, file_bytes=100_000_000)
    with pytest.raises(JobError, match=r"need 2.2 GB, in a file of 0.01 MB"):
        memory.refuse_unaffordable(JobError, "a", "1 x 1 pixels", needed_bytes=2.2e9, file_bytes=10_000)


def test_twelve_bits_are_not_taken_for_sixteen(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    path.write_bytes(tiff(np.zeros((8, 8, 4), np.uint16), bitspersample=12, **CMYK))
    with pytest.raises(JobError, match="12 bits a channel"):
        files.read_page(path)

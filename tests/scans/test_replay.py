from __future__ import annotations

import contextlib
import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import tifffile

from prooflight.errors import ScanError
from prooflight.scans.recorded import recorded_scans, write_scan

if TYPE_CHECKING:
    from pathlib import Path


def lines(sensors: int = 1, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 65536, (sensors, 40, 50)).astype(np.uint16)


def read_all(path: Path, *, sensors: int = 1) -> list[np.ndarray]:
    return [scan.read() for scan in recorded_scans(path, sensors=sensors)]


def refused(path: Path, *, sensors: int = 1) -> str:
    """The one line in which reading everything in ``path`` ends."""
    with pytest.raises(ScanError) as refusal:
        read_all(path, sensors=sensors)
    text = str(refusal.value)
    assert "\n" not in text
    assert text.startswith(str(path))
    return text


@pytest.mark.parametrize("sensors", [1, 2, 3, 4])
@pytest.mark.parametrize("shape", [(40, 50), (1, 50), (40, 3), (3, 4)])
def test_a_scan_comes_back_as_it_was_written(tmp_path: Path, sensors: int, shape: tuple[int, int]) -> None:
    dn = np.random.default_rng(1).integers(0, 65536, (sensors, *shape)).astype(np.uint16)
    path = tmp_path / "p0001.tif"
    write_scan(path, dn, facts={"page": "p0001", "press": "Größe"})
    (scan,) = recorded_scans(path, sensors=sensors)
    assert scan.name == "p0001"
    read = scan.read()
    assert read.dtype == np.uint16
    np.testing.assert_array_equal(read, dn)
    assert [file.name for file in tmp_path.iterdir()] == ["p0001.tif"]  # no temporary file left
    with tifffile.TiffFile(path) as file:
        assert json.loads(file.pages.first.description)["press"] == "Größe"


def test_a_folder_is_read_in_the_order_of_its_names(tmp_path: Path) -> None:
    for number in (3, 1, 2):
        write_scan(tmp_path / f"p000{number}.tif", lines(seed=number), facts={})
    (tmp_path / "p0002.TIFF").write_bytes((tmp_path / "p0002.tif").read_bytes())
    (tmp_path / "truth.json").write_text("{}")
    (tmp_path / "p0002.tif").unlink()
    scans = recorded_scans(tmp_path, sensors=1)
    assert [scan.name for scan in scans] == ["p0001", "p0002", "p0003"]
    for number, scan in enumerate(scans, 1):
        np.testing.assert_array_equal(scan.read(), lines(seed=number))


@pytest.mark.parametrize("sensors", [1, 2])
def test_a_multi_page_file_holds_one_image_a_sensor_page_after_page(tmp_path: Path, sensors: int) -> None:
    pages = [lines(sensors, seed) for seed in (1, 2, 3)]
    path = tmp_path / "run.tif"
    tifffile.imwrite(path, np.concatenate(pages), photometric="minisblack", metadata=None)
    scans = recorded_scans(path, sensors=sensors)
    assert len(scans) == 3
    for scan, page in zip(scans, pages, strict=True):
        np.testing.assert_array_equal(scan.read(), page)


@pytest.mark.parametrize("compression", ["zlib", "lzw", "packbits"])
def test_compressed_scans_are_read(tmp_path: Path, compression: str) -> None:
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, lines()[0], compression=compression)
    (scan,) = recorded_scans(path, sensors=1)
    np.testing.assert_array_equal(scan.read(), lines())


def test_images_of_different_pages_may_differ_in_length(tmp_path: Path) -> None:
    path = tmp_path / "run.tif"
    with tifffile.TiffWriter(path) as writer:
        writer.write(lines()[0], metadata=None)
        writer.write(lines()[0, :30], metadata=None)
    first, second = recorded_scans(path, sensors=1)
    assert first.read().shape == (1, 40, 50)
    assert second.read().shape == (1, 30, 50)


def test_nothing_to_read(tmp_path: Path) -> None:
    assert "holds no TIFF" in refused(tmp_path)
    assert "no such file or folder" in refused(tmp_path / "none.tif")


@pytest.mark.parametrize(
    "content", [b"", b"II*\0" + bytes(8), b"not a TIFF at all, but long enough to look at", b"\x89PNG\r\n"]
)
def test_what_is_no_tiff(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.tif"
    path.write_bytes(content)
    refused(path)


def test_a_truncated_file_is_refused_unless_every_pixel_is_there(tmp_path: Path) -> None:
    path, cut = tmp_path / "whole.tif", tmp_path / "cut.tif"
    scan = lines(3)
    write_scan(path, scan, facts={"page": "p0001"})
    whole = path.read_bytes()
    for end in [*range(600), *range(600, len(whole), 61), len(whole) - 1]:
        cut.write_bytes(whole[:end])
        if end > len(whole) - 64:  # only the name of the software that wrote it is lost
            with contextlib.suppress(ScanError):
                np.testing.assert_array_equal(read_all(cut, sensors=3)[0], scan)
        else:
            refused(cut, sensors=3)


@pytest.mark.parametrize(
    "compression",
    [
        pytest.param("zlib"),
        "lzw",
        pytest.param("packbits"),
    ],
)
def test_a_truncated_compressed_file_is_refused(tmp_path: Path, compression: str) -> None:
    path, cut = tmp_path / "whole.tif", tmp_path / "cut.tif"
    tifffile.imwrite(path, lines(1)[0], compression=compression)
    whole = path.read_bytes()
    for end in range(8, len(whole), 97):
        cut.write_bytes(whole[:end])
        refused(cut)


def test_a_file_with_a_flipped_bit_is_read_or_refused(tmp_path: Path) -> None:
    path, bad = tmp_path / "whole.tif", tmp_path / "bad.tif"
    write_scan(path, lines(2), facts={"page": "p0001"})
    whole = path.read_bytes()
    rng = np.random.default_rng(1)
    for place in [*range(300), *range(300, len(whole), 37)]:
        flipped = bytearray(whole)
        flipped[place] ^= 1 << int(rng.integers(8))
        bad.write_bytes(flipped)
        with contextlib.suppress(ScanError):
            assert all(scan.dtype == np.uint16 and scan.ndim == 3 for scan in read_all(bad, sensors=2))


@pytest.mark.parametrize(
    ("image", "options"),
    [
        (lines()[0].astype(np.uint8), {}),
        (lines()[0].astype(np.float32), {}),
        (lines()[0].astype(np.int16), {}),
        (np.zeros((40, 50, 3), np.uint16), {"photometric": "rgb"}),
    ],
)
def test_images_of_another_form_are_refused_with_what_they_are(
    tmp_path: Path, image: np.ndarray, options: dict[str, Any]
) -> None:
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, image, **options)
    text = refused(path)
    assert image.dtype.name in text
    assert "uint16" in text


def test_sensors_that_saw_different_numbers_of_lines_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    with tifffile.TiffWriter(path) as writer:
        writer.write(lines()[0], metadata=None)
        writer.write(lines()[0, :30], metadata=None)
    text = refused(path, sensors=2)
    assert "(40, 50)" in text
    assert "(30, 50)" in text


def test_a_file_of_three_images_is_no_scan_of_two_sensors(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    write_scan(path, lines(3), facts={})
    text = refused(path, sensors=2)
    assert "3 images" in text
    assert "2 sensors" in text


def test_a_folder_with_one_bad_file_names_that_file(tmp_path: Path) -> None:
    write_scan(tmp_path / "p0001.tif", lines(), facts={})
    (tmp_path / "p0002.tif").write_bytes(b"not a TIFF")
    with pytest.raises(ScanError, match=r"p0002\.tif"):
        recorded_scans(tmp_path, sensors=1)

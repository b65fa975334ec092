"""CMYK files: bit-exact round trips, files as other programs write them, and files that cannot be used."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

import imagecodecs
import numpy as np
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from tests.stand_ins import write_jpeg

from prooflight.errors import JobError, RequestError
from prooflight.pages import files, memory
from prooflight.pages.raster import Page

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray


def noise(rows: int = 33, columns: int = 21, seed: int = 1) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, (rows, columns, 4), dtype=np.uint8)


def smooth(rows: int = 64, columns: int = 48) -> NDArray[np.uint8]:
    """Gentle ramps, different in each ink, that a JPEG keeps within a level or two."""
    y, x = np.mgrid[0:rows, 0:columns]
    return np.stack([x * 2, y * 2, 255 - x - y, 30 + x], axis=-1).astype(np.uint8)


def page_of(cmyk: NDArray[np.uint8], dpi: float = 300.0) -> Page:
    return Page(cmyk=cmyk, dpi=dpi, name="p0001", number=1)


def write(path: Path, cmyk: NDArray[Any], **options: Any) -> Path:
    settings_ = {
        "photometric": "separated",
        "resolution": (300, 300),
        "resolutionunit": "inch",
        "metadata": None,
    }
    tifffile.imwrite(path, cmyk, **(settings_ | options))
    return path


@settings(max_examples=30, deadline=None)
@given(
    rows=st.integers(1, 40),
    columns=st.integers(1, 40),
    dpi=st.decimals(1, 9600, places=3).map(float),
    seed=st.integers(0, 2**32 - 1),
)
def test_tiff_round_trip_is_exact(
    tmp_path_factory: pytest.TempPathFactory, rows: int, columns: int, dpi: float, seed: int
) -> None:
    path = tmp_path_factory.mktemp("round") / "page.tif"
    cmyk = noise(rows, columns, seed)
    files.write_tiff(page_of(cmyk, dpi), path)
    (back,) = files.read_image(path)
    np.testing.assert_array_equal(back.cmyk, cmyk)
    assert back.dpi == dpi
    assert (back.name, back.number) == ("p0001", 1)
    assert [file.name for file in path.parent.iterdir()] == ["page.tif"]


def test_written_tiff_is_what_other_programs_expect(tmp_path: Path) -> None:
    files.write_tiff(page_of(noise()), tmp_path / "page.tif")
    with Image.open(tmp_path / "page.tif") as image:
        assert (image.mode, image.info["dpi"]) == ("CMYK", (300.0, 300.0))
        np.testing.assert_array_equal(np.asarray(image), noise())


@pytest.mark.parametrize("compression", [None, "lzw", "zlib", "adobe_deflate", "packbits", "zstd"])
@pytest.mark.parametrize("planar", ["contig", "separate"])
@pytest.mark.parametrize("byteorder", ["<", ">"])
def test_tiff_variants(tmp_path: Path, compression: str | None, planar: str, byteorder: str) -> None:
    stored = noise() if planar == "contig" else np.moveaxis(noise(), -1, 0)
    path = write(
        tmp_path / "a.tif",
        stored,
        compression=compression,
        planarconfig=planar,
        byteorder=byteorder,
        rowsperstrip=8,
    )
    np.testing.assert_array_equal(files.read_page(path).cmyk, noise())


def test_tiles_and_bigtiff(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif", noise(), tile=(16, 16), bigtiff=True)
    np.testing.assert_array_equal(files.read_page(path).cmyk, noise())


def test_sixteen_bits_become_the_nearest_eight(tmp_path: Path) -> None:
    wide = np.random.default_rng(2).integers(0, 65536, (9, 9, 4), dtype=np.uint16)
    wide[0, 0] = [0, 65535, 128, 129]
    cmyk = files.read_page(write(tmp_path / "a.tif", wide)).cmyk
    np.testing.assert_array_equal(cmyk, np.rint(wide / 257))
    assert cmyk[0, 0].tolist() == [0, 255, 0, 1]


def test_jpeg_in_tiff_is_not_inverted(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif", smooth(), compression="jpeg", compressionargs={"level": 98})
    np.testing.assert_allclose(files.read_page(path).cmyk.astype(int), smooth(), atol=6)


def test_pages_of_a_tiff_and_its_thumbnails(tmp_path: Path) -> None:
    path = tmp_path / "job.tif"
    with tifffile.TiffWriter(path) as tiff:
        for seed in (1, 2, 3):
            common = {"photometric": "separated", "metadata": None, "resolutionunit": "inch"}
            tiff.write(noise(seed=seed), resolution=(100 * seed, 100 * seed), **common)
            tiff.write(noise(4, 3), resolution=(10, 10), subfiletype=1, **common)
    pages = files.read_image(path)
    assert [(page.name, page.number, page.dpi) for page in pages] == [
        ("p0001", 1, 100.0),
        ("p0002", 2, 200.0),
        ("p0003", 3, 300.0),
    ]
    for seed, page in enumerate(pages, 1):
        np.testing.assert_array_equal(page.cmyk, noise(seed=seed))
    assert files.read_page(path, 3).dpi == 300.0
    with pytest.raises(RequestError, match="no page 4; it has pages 1 to 3"):
        files.read_page(path, 4)


def test_resolution_in_centimetres(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif", noise(), resolution=(100, 100), resolutionunit="centimeter")
    assert files.read_page(path).dpi == pytest.approx(254.0)
    assert files.read_page(path, dpi=600).dpi == 600


def adobe_jpeg(cmyk: NDArray[np.uint8], *, exif: bytes = b"") -> bytes:
    """A CMYK JPEG as Photoshop stores it: 255 - ink, an APP14 marker, no JFIF."""
    data = bytes(imagecodecs.jpeg8_encode(255 - cmyk, level=100, colorspace="CMYK", outcolorspace="CMYK"))
    assert b"Adobe" in data[:40]
    return data[:2] + exif + data[2:]


def exif_resolution(dpi: int, unit: int = 2) -> bytes:
    entries = [(282, 5, 1, 50), (283, 5, 1, 58), (296, 3, 1, unit << 16)]  # offsets after the directory
    body = (
        b"MM\0*\0\0\0\x08"
        + struct.pack(">H", 3)
        + b"".join(struct.pack(">HHII", *entry) for entry in entries)
    )
    body += b"\0" * 4 + struct.pack(">IIII", dpi, 1, dpi, 1)
    return b"\xff\xe1" + struct.pack(">H", len(body) + 8) + b"Exif\0\0" + body


def test_adobe_jpeg_is_ink_again(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    path.write_bytes(adobe_jpeg(smooth(), exif=exif_resolution(240)))
    page = files.read_page(path)
    assert page.dpi == 240
    np.testing.assert_allclose(page.cmyk.astype(int), smooth(), atol=3)


def test_photoshop_resolution_is_the_last_resort(tmp_path: Path) -> None:
    record = struct.pack(">IHHIHH", 350 << 16, 1, 1, 350 << 16, 1, 1)
    block = b"Photoshop 3.0\0" + b"8BIM\x03\xed\0\0" + struct.pack(">I", len(record)) + record
    path = tmp_path / "a.jpg"
    path.write_bytes(adobe_jpeg(smooth(), exif=b"\xff\xed" + struct.pack(">H", len(block) + 2) + block))
    assert files.read_page(path).dpi == 350


def test_jpeg_round_trip(tmp_path: Path) -> None:
    write_jpeg(page_of(smooth(), 300), tmp_path / "a.jpg", quality=98)
    (page,) = files.read_image(tmp_path / "a.jpg")
    assert page.dpi == 300
    np.testing.assert_allclose(page.cmyk.astype(int), smooth(), atol=4)
    raw = imagecodecs.jpeg8_decode((tmp_path / "a.jpg").read_bytes(), colorspace="CMYK", outcolorspace="CMYK")
    np.testing.assert_allclose(255 - raw.astype(int), smooth(), atol=4)  # stored as Adobe does


def no_tags(path: Path) -> None:
    data = bytearray(write(path, noise(), resolutionunit="none").read_bytes())
    path.write_bytes(data)


def cut(path: Path) -> None:
    data = write(path, noise(), compression="zlib", rowsperstrip=4).read_bytes()
    with tifffile.TiffFile(path) as tiff:
        last = tiff.pages[0].dataoffsets[-1]
    path.write_bytes(data[: last + 1])


def broken_strip(path: Path) -> None:
    data = bytearray(write(path, noise(), compression="zlib").read_bytes())
    with tifffile.TiffFile(path) as tiff:
        start = tiff.pages[0].dataoffsets[0]
    data[start : start + 40] = b"\xaa" * 40
    path.write_bytes(data)


def jpeg_of(mode: str) -> Callable[[Path], None]:
    return lambda path: Image.new(mode, (8, 8)).save(path, format="JPEG", dpi=(300, 300))


BAD: dict[str, tuple[Callable[[Path], object], str]] = {
    "empty": (lambda path: path.write_bytes(b""), "the file is empty"),
    "text": (lambda path: path.write_bytes(b"C M Y K"), "neither TIFF nor JPEG"),
    "header alone": (lambda path: path.write_bytes(b"II*\0\x08\0\0\0"), "TIFF"),
    "RGB TIFF": (lambda path: write(path, noise()[..., :3].copy(), photometric="rgb"), "rgb, not CMYK"),
    "grey TIFF": (
        lambda path: write(path, noise()[..., 0].copy(), photometric="minisblack"),
        "minisblack, not CMYK",
    ),
    "five channels": (lambda path: write(path, noise()[..., [0, 1, 2, 3, 0]].copy()), "5 channels"),
    "floats": (lambda path: write(path, noise().astype(np.float32)), "32 bits"),
    "no resolution": (no_tags, "states no resolution"),
    "fax resolution": (
        lambda path: write(path, noise(), resolution=(204, 98)),
        "204 dpi across and 98 along",
    ),
    "truncated TIFF": (cut, "truncated"),
    "broken strip": (broken_strip, "cannot be read"),
    "turned": (lambda path: write(path, noise(), extratags=[(274, "H", 1, 6, True)]), "stored rotated"),
    "RGB JPEG": (jpeg_of("RGB"), "RGB, not CMYK"),
    "grey JPEG": (jpeg_of("L"), "L, not CMYK"),
    "JPEG without resolution": (lambda path: path.write_bytes(adobe_jpeg(smooth())), "states no resolution"),
    "truncated JPEG": (
        lambda path: path.write_bytes(adobe_jpeg(smooth(), exif=exif_resolution(300))[:-400]),
        "truncated",
    ),
    "JPEG header alone": (lambda path: path.write_bytes(b"\xff\xd8\xff\xe0"), "cannot be read"),
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_files_end_in_one_line(tmp_path: Path, kind: str) -> None:
    make, what = BAD[kind]
    path = tmp_path / "page.img"
    make(path)
    with pytest.raises(JobError, match=what) as caught:
        files.read_image(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_given_dpi_helps_where_there_is_none(tmp_path: Path) -> None:
    no_tags(tmp_path / "a.tif")
    assert files.read_image(tmp_path / "a.tif", dpi=123.4)[0].dpi == 123.4
    with pytest.raises(RequestError, match="above 0"):
        files.read_page(tmp_path / "a.tif", dpi=-1)


def test_a_missing_file_stays_an_oserror(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        files.read_image(tmp_path / "none.tif")


def test_a_page_too_large_is_refused_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    huge = tmp_path / "huge.tif"
    data = bytearray(write(huge, noise()).read_bytes())
    with tifffile.TiffFile(huge) as tiff:
        for name in ("ImageWidth", "ImageLength"):
            offset = tiff.pages[0].tags[name].valueoffset
            struct.pack_into("<H", data, offset, 65535)
    huge.write_bytes(data)
    with pytest.raises(JobError, match=r"65535 x 65535 pixels are 4295 megapixels; at most 400"):
        files.read_page(huge)
    monkeypatch.setattr(memory, "available_bytes", lambda: 1000.0)
    with pytest.raises(JobError, match="memory are free"):
        files.read_page(write(tmp_path / "a.tif", noise()))


def test_nothing_is_left_when_writing_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "page.tif").write_bytes(b"old")

    def fail(path: Path, *_: Any, **__: Any) -> None:
        path.write_bytes(b"half")
        message = "disk full"
        raise OSError(message)

    monkeypatch.setattr(tifffile, "imwrite", fail)
    with pytest.raises(OSError, match="disk full"):
        files.write_tiff(page_of(noise()), tmp_path / "page.tif")
    assert [file.read_bytes() for file in tmp_path.iterdir()] == [b"old"]

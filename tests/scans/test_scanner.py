"""Scans as people have them: every kind of file, in every tone, becomes the same linear light."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pymupdf
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image, ImageCms

from prooflight.errors import RequestError, ScanError
from prooflight.scans.scanner.reading import ScannerSettings, Tone, scanned_pages

DPI = 100
RAMP = np.tile(np.arange(256, dtype=np.uint8), (60, 1))
"""A grey ramp, 256 pixels wide."""
COLOUR = np.stack([RAMP, RAMP[:, ::-1], np.full_like(RAMP, 255)], axis=-1)


def srgb(codes: NDArray[np.generic]) -> NDArray[np.float64]:
    share = np.asarray(codes, np.float64) / 255
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def read(path: Path, settings: ScannerSettings | None = None):  # type: ignore[no-untyped-def]
    return [page.read(settings or ScannerSettings()) for page in scanned_pages(path)]


def pdf_of(path: Path, *pictures: NDArray[np.uint8]) -> Path:
    document = pymupdf.open()
    for picture in pictures:
        rows, columns = picture.shape[:2]
        page = document.new_page(width=72 * columns / DPI, height=72 * rows / DPI)
        stream = io.BytesIO()
        Image.fromarray(picture).save(stream, "PNG")
        page.insert_image(page.rect, stream=stream.getvalue())
    document.save(path)
    return path


def as_pdf(path: Path, picture: NDArray[np.uint8]) -> Path:
    return pdf_of(path.with_suffix(".pdf"), picture)


def as_png(path: Path, picture: NDArray[np.uint8]) -> Path:
    Image.fromarray(picture).save(path.with_suffix(".png"), dpi=(DPI, DPI))
    return path.with_suffix(".png")


def as_tiff8(path: Path, picture: NDArray[np.uint8]) -> Path:
    tifffile.imwrite(path.with_suffix(".tif"), picture, resolution=(DPI, DPI), resolutionunit="inch")
    return path.with_suffix(".tif")


def as_tiff16(path: Path, picture: NDArray[np.uint8]) -> Path:
    return as_tiff8(path, (picture.astype(np.uint16) * 257))  # type: ignore[arg-type]


@pytest.mark.parametrize("picture", [RAMP, COLOUR], ids=["grey", "rgb"])
@pytest.mark.parametrize("write", [as_pdf, as_png, as_tiff8, as_tiff16])
def test_every_kind_of_file_is_read_as_linear_light(tmp_path: Path, write, picture) -> None:  # type: ignore[no-untyped-def]
    (scan,) = read(write(tmp_path / "scan", picture))
    expected = srgb(picture)[None] if picture.ndim == 2 else np.moveaxis(srgb(picture), -1, 0)
    assert scan.light.shape == expected.shape
    assert scan.dpi == pytest.approx((DPI, DPI), rel=1e-3)
    np.testing.assert_allclose(scan.light, expected, atol=1e-5)
    np.testing.assert_array_equal(scan.clipped, expected == 1)


def test_a_jpeg_is_read_within_what_its_compression_loses(tmp_path: Path) -> None:
    path = tmp_path / "scan.jpg"
    Image.fromarray(RAMP).save(path, dpi=(DPI, DPI), quality=98)
    (scan,) = read(path)
    np.testing.assert_allclose(scan.light[0], srgb(RAMP), atol=0.03)


def test_a_file_of_several_pages_is_several_scans(tmp_path: Path) -> None:
    darker = RAMP // 2
    with tifffile.TiffWriter(tmp_path / "scans.tif") as tiff:
        for picture in (RAMP, darker):
            tiff.write(picture, resolution=(DPI, DPI), resolutionunit="inch")
    for path in (tmp_path / "scans.tif", pdf_of(tmp_path / "scans.pdf", RAMP, darker)):
        scans = read(path)
        assert [scan.name for scan in scans] == [f"{path.name}, page 1", f"{path.name}, page 2"]
        np.testing.assert_allclose(scans[1].light[0], srgb(darker), atol=1e-5)


def test_a_resolution_is_the_files_or_the_users_or_refused(tmp_path: Path) -> None:
    path = tmp_path / "scan.png"
    Image.fromarray(RAMP).save(path)
    with pytest.raises(ScanError, match=r"states no resolution; state it by --scan-dpi"):
        read(path)
    (scan,) = read(path, ScannerSettings(dpi=200))
    assert scan.dpi == (200, 200)
    with pytest.raises(RequestError, match="not a resolution of a scan"):
        ScannerSettings(dpi=3)


def test_a_stated_tone_has_its_curve_and_its_black_and_white(tmp_path: Path) -> None:
    path = as_png(tmp_path / "scan", RAMP)
    (scan,) = read(path, ScannerSettings(tone=Tone.parse("2.2:20:80")))
    share = np.clip((RAMP / 255 - 0.2) / 0.6, 0, 1)
    np.testing.assert_allclose(scan.light[0], share**2.2, atol=1e-5)
    np.testing.assert_array_equal(scan.clipped[0], RAMP >= 204)


@pytest.mark.parametrize("text", ["bright", "9", "nan", "2.2:50:40", "srgb:0", "linear:0:nan", "1:2:3:4"])
def test_what_is_no_tone_is_refused(text: str) -> None:
    with pytest.raises(RequestError, match="--tone"):
        Tone.parse(text)


def test_an_embedded_profile_converts_and_a_stated_tone_overrides_it(tmp_path: Path) -> None:
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    path = tmp_path / "scan.png"
    Image.fromarray(COLOUR).save(path, dpi=(DPI, DPI), icc_profile=profile)
    (scan,) = read(path)
    np.testing.assert_allclose(scan.light, np.moveaxis(srgb(COLOUR), -1, 0), atol=0.01)
    Image.fromarray(RAMP).save(path, dpi=(DPI, DPI), icc_profile=profile)
    with pytest.raises(ScanError, match="its ICC profile is of RGB, the scan is grey"):
        read(path)
    (scan,) = read(path, ScannerSettings(tone=Tone.parse("linear")))
    np.testing.assert_allclose(scan.light[0], RAMP / 255, atol=1e-5)
    Image.fromarray(RAMP).save(path, dpi=(DPI, DPI), icc_profile=b"nothing")
    with pytest.raises(ScanError, match="its ICC profile cannot be used"):
        read(path)


def test_what_is_no_scan_is_refused_in_one_line(tmp_path: Path) -> None:
    empty = pymupdf.open()
    empty.new_page()
    empty.save(tmp_path / "empty.pdf")
    whole = as_pdf(tmp_path / "whole", COLOUR).read_bytes()
    (tmp_path / "cut.pdf").write_bytes(whole[: len(whole) // 2])
    png = as_png(
        tmp_path / "whole", np.random.default_rng(1).integers(0, 256, (64, 64), np.uint8)
    ).read_bytes()
    (tmp_path / "cut.png").write_bytes(png[: len(png) // 2])
    (tmp_path / "scan.doc").write_bytes(b"text")
    (tmp_path / "none").mkdir()
    for name in ("empty.pdf", "cut.pdf", "cut.png", "scan.doc", "none", "missing.pdf"):
        with pytest.raises(ScanError) as refused:
            read(tmp_path / name)
        assert "\n" not in str(refused.value)
        assert name in str(refused.value)


def test_a_picture_that_would_need_more_memory_than_any_scan_is_refused(tmp_path: Path) -> None:
    document = pymupdf.open()
    page = document.new_page(width=72, height=72)
    stream = io.BytesIO()
    Image.new("1", (30_000, 30_000)).save(stream, "PNG")
    page.insert_image(page.rect, stream=stream.getvalue())
    document.save(tmp_path / "bomb.pdf")
    with pytest.raises(ScanError, match=r"900 megapixels"):
        read(tmp_path / "bomb.pdf")


def test_real_scans_are_read_at_their_own_pixels(shared: Path) -> None:
    path = shared / "real" / "exams" / "midterm_scan_100.pdf"
    if not path.is_file():
        pytest.skip("needs shared/real/exams")
    pages = scanned_pages(path)
    scan = pages[0].read(ScannerSettings())
    assert (len(pages), scan.light.shape, scan.dpi) == (6, (1, 3300, 2550), (300, 300))
    assert scan.clipped.mean() > 0.9  # the device makes paper plain white

"""One door for PDFs, images and folders of them."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.stand_ins import write_jpeg

from prooflight.errors import JobError, ProfileError, RequestError
from prooflight.pages import files
from prooflight.pages.job import JobSource, open_job, parse_pages
from prooflight.pages.layout.layout import Layout
from prooflight.pages.pdf.rip import PdfJob
from prooflight.pages.raster import Page, turned
from prooflight.pages.warnings import WHOLE_FILE
from prooflight.press.pages import job_source

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.press.artefact import Press

pymupdf = pytest.importorskip("pymupdf", reason="PDF needs the extra [pdf]")


def flat(ink: int, dpi: float = 200.0) -> Page:
    return Page(cmyk=np.full((6, 4, 4), ink, dtype=np.uint8), dpi=dpi, name="p0001", number=1)


@pytest.fixture
def folder(tmp_path: Path, write_pdf: Callable[..., Path]) -> Path:
    """p2.tif, p10.jpg and p9.pdf with two pages; and what is no page."""
    inside = tmp_path / "job"
    inside.mkdir()
    files.write_tiff(flat(2), inside / "p2.tif")
    write_jpeg(flat(10), inside / "p10.JPG")
    with pymupdf.open(write_pdf("0 0 0 0.6 k 0 0 100 100 re f")) as pdf:
        pdf.fullcopy_page(0)
        pdf.save(inside / "p9.pdf")
    (inside / "notes.txt").write_text("not a page")
    (inside / ".p1.tif.part.tif").write_text("half written")
    return inside


def test_a_folder_in_natural_order(folder: Path) -> None:
    with open_job(folder, dpi=72) as job:
        assert (len(job), job.name) == (4, "job")
        pages = [job.page(number) for number in range(1, 5)]
    assert [page.cmyk[0, 0, 3] for page in pages] == [2, 153, 153, 10]
    assert [page.dpi for page in pages] == [200.0, 72.0, 72.0, 200.0]
    assert [(page.name, page.number) for page in pages] == [(f"p000{n}", n) for n in range(1, 5)]


@pytest.mark.parametrize("number", [0, -1, 5])
def test_pages_that_are_not_there(folder: Path, number: int) -> None:
    with (
        open_job(folder, dpi=72) as job,
        pytest.raises(RequestError, match=f"no page {number}; the job has 4 pages"),
    ):
        job.page(number)


def test_a_single_file_is_a_job(folder: Path) -> None:
    with open_job(folder / "p2.tif", dpi=72) as job:
        assert (len(job), job.name, job.page(1).dpi) == (1, "p2", 200.0)
    with open_job(folder / "p9.pdf", dpi=36) as job:
        assert (len(job), job.page(2).cmyk.shape) == (2, (50, 50, 4))


def test_a_job_travels_to_another_process(folder: Path) -> None:
    with open_job(folder, dpi=72) as job:
        with pickle.loads(pickle.dumps(job)) as again:
            np.testing.assert_array_equal(again.page(2).cmyk, job.page(2).cmyk)
        source = pickle.loads(pickle.dumps(job.source))
    assert source == JobSource(path=folder, dpi=72)
    with source.open() as again:
        assert len(again) == 4


def test_an_empty_folder_and_an_odd_resolution(tmp_path: Path) -> None:
    with pytest.raises(JobError, match="holds no job"):
        open_job(tmp_path, dpi=72)
    with pytest.raises(RequestError, match="above 0"):
        open_job(tmp_path, dpi=0)


def encrypted(source: Path, path: Path) -> None:
    with pymupdf.open(source) as pdf:
        pdf.save(path, encryption=pymupdf.PDF_ENCRYPT_AES_256, user_pw="u", owner_pw="o")


def without_pages(source: Path, path: Path) -> None:
    path.write_bytes(source.read_bytes().replace(b"/Kids[3 0 R]/Count 1", b"/Kids[     ]/Count 0"))


BAD: dict[str, tuple[Callable[[Path, Path], object], str]] = {
    "encrypted": (encrypted, "encrypted"),
    "no pages": (without_pages, "no pages"),
    "no PDF": (lambda _, path: path.write_bytes(b"%!PS-Adobe-3.0\nshowpage\n"), "not a PDF"),
    "empty": (lambda _, path: path.write_bytes(b""), "not a PDF"),
    "header alone": (lambda _, path: path.write_bytes(b"%PDF-1.7\n"), "the PDF"),
    "noise": (
        lambda _, path: path.write_bytes(b"%PDF-1.7\n" + np.random.default_rng(1).bytes(5000)),
        "the PDF",
    ),
    "truncated": (lambda source, path: path.write_bytes(source.read_bytes()[:-200]), "truncated"),
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_pdfs_end_in_one_line(
    tmp_path: Path, write_pdf: Callable[..., Path], capfd: pytest.CaptureFixture[str], kind: str
) -> None:
    make, what = BAD[kind]
    path = tmp_path / "bad.pdf"
    make(write_pdf("0 0 0 1 k 0 0 50 50 re f"), path)
    with pytest.raises(JobError, match=what) as caught:
        open_job(path, dpi=72)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_what_mupdf_repairs_is_printed_and_said(
    write_pdf: Callable[..., Path], capfd: pytest.CaptureFixture[str]
) -> None:
    path = write_pdf("0 0 0 1 k 0 0 50 50 re f")
    path.write_bytes(path.read_bytes().replace(b"startxref\n", b"startxref\n9"))
    with open_job(path, dpi=72) as job:
        assert job.page(1).cmyk[75, 25, 3] == 255
        assert {(warning.page, warning.kind) for warning in job.warnings} == {(WHOLE_FILE, "renderer")}
    assert capfd.readouterr() == ("", "")


def test_a_page_too_large_is_refused_before_it_is_drawn(write_pdf: Callable[..., Path]) -> None:
    with PdfJob(write_pdf("", page="/MediaBox[0 0 14400 14400]")) as job:
        with pytest.raises(
            JobError, match="page 1: 120000 x 120000 pixels are 14400 megapixels; at most 400"
        ):
            job.page(1, 600)
        with pytest.raises(RequestError, match="above 0"):
            job.page(1, -1)
        with pytest.raises(RequestError, match="no page 2; it has pages 1 to 1"):
            job.page(2, 72)


def test_a_broken_output_intent_is_named(write_pdf: Callable[..., Path]) -> None:
    profile = b"\0" * 16 + b"CMYK" + b"\0" * 16 + b"acsp" + b"\0" * 100
    intent = "/OutputIntents[<</S/GTS_PDFX/DestOutputProfile 5 0 R>>]"
    more = [b"<</N 4/Length %d>>stream\n" % len(profile) + profile + b"\nendstream"]
    with (
        PdfJob(write_pdf("", catalogue=intent, more=more)) as job,
        pytest.raises(JobError, match="page 1: the profile of its output intent is damaged"),
    ):
        job.page(1, 72)


def test_profiles_that_cannot_be_used(tmp_path: Path, write_pdf: Callable[..., Path]) -> None:
    from PIL import ImageCms

    job, profile = write_pdf(""), tmp_path / "p.icc"
    rgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    hollow = rgb[:16] + b"CMYK" + rgb[20:]
    for data, what in (
        (b"", "not an ICC profile"),
        (rgb, "the profile is for RGB, not CMYK"),
        (hollow[:-1], f"{len(rgb) - 1} bytes where its header states {len(rgb)}"),
        (hollow, "cannot convert colours to CMYK"),
    ):
        profile.write_bytes(data)
        with pytest.raises(ProfileError, match=what) as caught:
            open_job(job, dpi=72, profile=profile)
        assert str(profile) in str(caught.value)
    with pytest.raises(FileNotFoundError):
        open_job(job, dpi=72, profile=tmp_path / "none.icc")


def test_a_missing_pymupdf_names_the_extra(
    monkeypatch: pytest.MonkeyPatch, write_pdf: Callable[..., Path]
) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "pymupdf", None)
    with pytest.raises(JobError, match=r'pip install "prooflight\[pdf\]"'):
        open_job(write_pdf(""), dpi=72)


def test_turned_clockwise() -> None:
    cmyk: NDArray[np.uint8] = np.arange(24, dtype=np.uint8).reshape(2, 3, 4)
    page = turned(Page(cmyk=cmyk, dpi=100, name="p0003", number=3))
    assert page.cmyk.shape == (3, 2, 4)
    assert page.cmyk.flags.c_contiguous
    np.testing.assert_array_equal(page.cmyk[0], cmyk[::-1, 0])  # the left edge, from below, is the top row
    assert (page.name, page.number, page.dpi) == ("p0003", 3, 100)


@given(st.lists(st.tuples(st.integers(1, 50), st.integers(0, 9)), min_size=1, max_size=6))
def test_page_lists(ranges: list[tuple[int, int]]) -> None:
    text = ",".join(f"{first}-{first + length}" if length else f" {first}" for first, length in ranges)
    wanted = [number for first, length in ranges for number in range(first, first + length + 1)]
    assert parse_pages(text, 60) == tuple(dict.fromkeys(wanted))


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "not a page"),
        ("1,,2", "not a page"),
        ("two", "not a page"),
        ("1.5", "not a page"),
        ("-3", "not a page"),
        ("4-2", "runs backwards; write 2-4"),
        ("0", "no page 0; the job has pages 1 to 24"),
        ("99", "no page 99"),
        ("20-99", "no page 99"),
        ("1-999999999999", "not a page"),
    ],
)
def test_page_lists_that_make_no_sense(text: str, what: str) -> None:
    with pytest.raises(RequestError, match=what):
        parse_pages(text, 24)


def test_pages_of_a_pdf_are_drawn_finer_than_their_raster(write_pdf: Callable[..., Path]) -> None:
    with open_job(write_pdf("0 0 0 1 k 0 0 49.5 100 re f"), dpi=72) as job:
        assert job.page(1).cmyk[50, [48, 49, 50], 3].tolist() == [255, 128, 0]


def test_pages_of_a_pdf_are_drawn_at_the_resolution_that_their_press_states(
    write_pdf: Callable[..., Path], press: Press
) -> None:
    pdf = write_pdf("0 0 0 1 k 0 0 49.6 100 re f")
    source = job_source(pdf, replace(press, rip_dpi=600.0))
    assert source.drawn_dpi == 600
    assert job_source(pdf, press).drawn_dpi is None
    with replace(source, dpi=72, drawn_dpi=72, light=None).open() as job:
        assert job.page(1).cmyk[50, [48, 49, 50], 3].tolist() == [255, 0, 0]
    with replace(source, dpi=72, drawn_dpi=1440, light=None).open() as job:
        assert job.page(1).cmyk[50, [48, 49, 50], 3].tolist() == [255, 153, 0]


def test_edges_of_a_pdf_lie_off_by_what_a_rip_rounds_and_those_of_a_raster_do_not(
    write_pdf: Callable[..., Path], tmp_path: Path
) -> None:
    pdf = write_pdf("0 0 0 1 k 0 0 49.6 100 re f")
    of_600 = 25.4 / 600 / np.sqrt(12)
    with (
        JobSource(path=pdf, dpi=72).open() as unknown,
        JobSource(path=pdf, dpi=72, drawn_dpi=1200).open() as job,
    ):
        assert unknown.page(1).edge_sd_mm == pytest.approx(of_600)
        assert job.page(1).edge_sd_mm == pytest.approx(of_600 / 2)
    files.write_tiff(flat(10), tmp_path / "p1.tif")
    with JobSource(path=tmp_path / "p1.tif", dpi=72).open() as rasters:
        assert rasters.page(1).edge_sd_mm == 0
    with JobSource(path=pdf, dpi=72, layout=Layout(sides=2)).open() as sheets:
        assert sheets.page(1).edge_sd_mm == pytest.approx(of_600)


def test_what_pages_say_of_places_is_asked_of_pages_and_not_of_sides(write_pdf: Callable[..., Path]) -> None:
    path = write_pdf("0 0 0 1 k 10 10 20 20 re f")
    with JobSource(path=path, dpi=100.0).open() as job:
        assert job.marks(1) is not None
    with (
        JobSource(path=path, dpi=100.0, layout=Layout(sides=2)).open() as laid,
        pytest.raises(RequestError, match="has no marked places; open the job without a layout"),
    ):
        laid.marks(1)

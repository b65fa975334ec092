"""The sample job: what goes in comes out of the RIP, and what is printed is consistent."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra.numpy import arrays

pymupdf = pytest.importorskip("pymupdf", reason="ripping a PDF needs the extra [pdf]")
pytest.importorskip("reportlab", reason="making the sample job needs the extra [demo]")
pytest.importorskip("skimage", reason="making the sample job needs the extra [demo]")

from prooflight.pages.pdf.rip import PdfJob  # noqa: E402
from prooflight.simulation.corpus.sample_job import inks, pictures  # noqa: E402
from prooflight.simulation.corpus.sample_job.sample_job import SampleJob, make_sample_job  # noqa: E402

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

GRID_DPI = 254.0  # 0.1 mm a pixel
CODE_128 = (  # widths of bar, space, bar, space, bar, space of each value from 0 to 105 (ISO/IEC 15417)
    "212222 222122 222221 121223 121322 131222 122213 122312 132212 221213 221312 231212 112232 122132 122231 113222 "
    "123122 123221 223211 221132 221231 213212 223112 312131 311222 321122 321221 312212 322112 322211 212123 212321 "
    "232121 111323 131123 131321 112313 132113 132311 211313 231113 231311 112133 112331 132131 113123 113321 133121 "
    "313121 211331 231131 213113 213311 213131 311123 311321 331121 312113 312311 332111 314111 221411 431111 111224 "
    "111422 121124 121421 141122 141221 112214 112412 122114 122411 142112 142211 241211 221114 413111 241112 134111 "
    "111242 121142 121241 114212 124112 124211 411212 421112 421211 212141 214121 412121 111143 111341 131141 114113 "
    "114311 411113 411311 113141 114131 311141 411131 211412 211214 211232"
)


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> SampleJob:
    return make_sample_job(tmp_path_factory.mktemp("job") / "sample.pdf")


@pytest.fixture(scope="module")
def ripped(job: SampleJob) -> dict[int, NDArray[np.uint8]]:
    """The invoices, CMYK."""
    with PdfJob(job.path) as pdf:
        return {number: pdf.page(number, GRID_DPI).cmyk for number, _ in invoice_pages(job)}


@pytest.fixture(scope="module")
def text(job: SampleJob) -> list[str]:
    """The words of each page, as a reader would copy them out."""
    with pymupdf.open(job.path) as document:
        return [page.get_text() for page in document]


@given(rgb=arrays(np.uint8, (4, 5, 3)))
def test_separation_keeps_limit_and_colour(rgb: NDArray[np.uint8]) -> None:
    cmyk = pictures.separate(rgb).astype(float) / 255
    total = cmyk.sum(axis=-1)
    assert (total <= pictures.TOTAL_INK_LIMIT + 1e-9).all()
    free = (
        total < pictures.TOTAL_INK_LIMIT - 4 / 255
    )  # where nothing was held back the multiplicative model holds
    back = (1 - cmyk[..., :3]) * (1 - cmyk[..., 3:])
    assert np.abs(back - rgb / 255.0)[free].max(initial=0.0) <= 1 / 255 + 1e-9  # one byte of rounding per ink


def test_separation_of_white_and_grey_order() -> None:
    greys = np.repeat(np.arange(256, dtype=np.uint8)[:, None, None], 3, axis=2)
    cmyk = pictures.separate(greys)[:, 0].astype(int)
    assert cmyk[255].tolist() == [0, 0, 0, 0]
    assert (np.diff(cmyk[:, 3]) <= 0).all()  # the lighter, the less black
    assert (np.ptp(cmyk[:, :3], axis=1) == 0).all()  # a grey stays a grey of equal inks


def test_job_is_as_described(job: SampleJob) -> None:
    assert job.page_count >= 24
    assert len(job.titles) == job.page_count
    with PdfJob(job.path) as pdf:
        assert len(pdf) == job.page_count
        assert pdf.warnings == ()
        for width, height in pdf.page_sizes_mm:
            assert (width, height) == pytest.approx((210.0, 297.0), abs=1e-3)
    assert job.path.stat().st_size < 25e6
    assert [path.name for path in job.path.parent.iterdir()] == [
        job.path.name
    ]  # no half-written file beside it


def test_seed_decides_the_bytes(job: SampleJob, tmp_path: Path) -> None:
    again = make_sample_job(tmp_path / "again.pdf", seed=1)
    other = make_sample_job(tmp_path / "other.pdf", seed=2)
    assert again.path.read_bytes() == job.path.read_bytes()
    assert other.path.read_bytes() != job.path.read_bytes()
    assert other.page_count == job.page_count


def test_everything_is_cmyk_or_the_spot_colour(job: SampleJob) -> None:
    """No grey or RGB operator in any content stream, and no image in another colour space."""
    foreign = re.compile(rb"(?<![\w/.])(?:rg|RG|g|G)(?![\w])")
    with pymupdf.open(job.path) as document:
        for page in document:
            assert not foreign.search(strings_removed(page.read_contents())), page.number + 1
            assert {image[5] for image in page.get_images(full=True)} <= {"DeviceCMYK"}
        spaces = [document.xref_object(xref) for xref in range(1, document.xref_length())]
    assert any(f"/Separation /{inks.SPOT_NAME.replace(' ', '#20')}" in space for space in spaces)
    assert not any("DeviceRGB" in space or "DeviceGray" in space for space in spaces)


def strings_removed(content: bytes) -> bytes:
    """A content stream without its text strings, whose bytes could look like operators."""
    return re.sub(rb"\((?:\\.|[^\\()])*\)", b"()", content, flags=re.DOTALL)


def test_fonts_are_embedded(job: SampleJob) -> None:
    with pymupdf.open(job.path) as document:
        for page in document:
            for xref, extension, _, name, *_ in page.get_fonts():
                assert extension == "ttf", f"page {page.number + 1}: {name} (object {xref}) is not embedded"


def test_nothing_stands_outside_the_page_or_on_other_words(job: SampleJob) -> None:
    """Every line of text lies on the page, and no two lines cover each other's letters."""
    everywhere = pymupdf.INFINITE_RECT()
    with pymupdf.open(job.path) as document:
        for page in document:
            boxes = [
                (pymupdf.Rect(span["bbox"]), span["size"], span["text"])
                for block in page.get_text("dict", clip=everywhere)["blocks"]
                for line in block.get("lines", ())
                for span in line["spans"]
                if span["text"].strip()
            ]
            bodies = [(letters(box, size), words) for box, size, words in boxes]
            for place, (body, words) in enumerate(bodies):
                assert page.rect.contains(body), f"page {page.number + 1}: {words!r} leaves the page"
                for other, others in bodies[place + 1 :]:
                    common = body & other
                    clash = not common.is_empty and common.width > 0.5 and common.height > 0.5
                    assert not clash, f"page {page.number + 1}: {words!r} stands on {others!r}"


def letters(box: Any, size_pt: float) -> Any:
    """From the x-height to the baseline: what of a line's box is surely ink."""
    baseline = box.y1 - 0.2 * size_pt
    return pymupdf.Rect(box.x0, baseline - 0.45 * size_pt, box.x1, baseline)


def test_contents_name_the_right_pages(job: SampleJob, text: list[str]) -> None:
    contents = job.titles.index("Contents and colophon")
    for title in ("What paper does with light", "Four inks", "A run of one", "Words of the trade"):
        numbers = re.search(rf"{title}\n.*\n(\d+)\n", text[contents])
        assert numbers is not None, title
        page = int(numbers.group(1))
        assert title in text[page - 1]
        assert text[page - 1].rstrip().endswith(str(page))  # the folio is the last thing set


def amount(words: str) -> int:
    """Pence of a printed amount."""
    return int(words.replace(",", "").replace(".", ""))


def invoice_pages(job: SampleJob) -> list[tuple[int, str]]:
    """Page and number of each invoice, from the titles."""
    prefix = "Invoice "
    found = [(n, t.removeprefix(prefix)) for n, t in enumerate(job.titles, 1) if t.startswith(prefix)]
    assert len(found) >= 6
    return found


def test_invoices_add_up_as_printed(job: SampleJob, text: list[str]) -> None:
    """From the words on the page, not from the figures behind them."""
    for page, number in invoice_pages(job):
        words = text[page - 1]
        lines = re.findall(r"^(\d+) × [\d.]+ k?g\n([\d,]+\.\d\d)\n([\d,]+\.\d\d)$", words, flags=re.MULTILINE)
        assert len(lines) >= 4
        for quantity, each, total in lines:
            assert int(quantity) * amount(each) == amount(total)
        goods, carriage, vat = (
            amount(re.search(rf"^{name}\n([\d,]+\.\d\d)$", words, flags=re.MULTILINE).group(1))  # type: ignore[union-attr]
            for name in ("Goods", "Carriage", "VAT 20 %")
        )
        assert goods == sum(amount(total) for _, _, total in lines)
        assert abs(100 * vat - 20 * (goods + carriage)) <= 50  # to the nearest penny
        paid = re.findall(r"£ ([\d,]+\.\d\d)", words)
        assert [amount(words) for words in paid] == [goods + carriage + vat] * 2  # table and slip
        assert words.count(number) >= 3


def test_invoices_differ_in_name_and_number(job: SampleJob, text: list[str]) -> None:
    pages = invoice_pages(job)
    assert len({number for _, number in pages}) == len(pages)
    assert len({text[page - 1] for page, _ in pages}) == len(pages)


def test_square_code_says_the_invoice_number(job: SampleJob, ripped: dict[int, NDArray[np.uint8]]) -> None:
    for page, number in invoice_pages(job):
        grey = 255 - ripped[page][2380:, :800, 3]
        said, _, _ = cv2.QRCodeDetector().detectAndDecode(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR))
        assert said == number


def test_linear_code_says_the_invoice_number(job: SampleJob, ripped: dict[int, NDArray[np.uint8]]) -> None:
    for page, number in invoice_pages(job):
        assert read_code_128(bar_line(ripped[page])) == number


def bar_line(page: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """One row of pixels through the bars, found as the row that changes most often right of the slip's text."""
    black = page[2380:, 1150:, 3] > 127
    return np.asarray(black[np.argmax(np.abs(np.diff(black.astype(np.int8), axis=1)).sum(axis=1))])


def read_code_128(line: NDArray[np.bool_]) -> str:
    """Decode a row of bars (ISO/IEC 15417): subsets B and C, checksum included."""
    edges = np.flatnonzero(np.diff(line.astype(np.int8), prepend=0, append=0))
    widths = np.diff(edges)
    module = (edges[-1] - edges[0]) / (11 * ((len(widths) - 7) // 6) + 13)
    runs = np.rint(widths / module).astype(int)
    known = CODE_128.split()
    values = [known.index("".join(map(str, runs[place : place + 6]))) for place in range(0, len(runs) - 7, 6)]
    start, *symbols, check = values
    assert (start + sum(place * value for place, value in enumerate(symbols, 1))) % 103 == check
    words, subset = "", {104: "B", 105: "C"}[start]
    for value in symbols:
        if (subset, value) in {("B", 99), ("C", 100)}:
            subset = "C" if subset == "B" else "B"
        else:
            words += f"{value:02d}" if subset == "C" else chr(value + 32)
    return words

"""Designs: the same from the same seed, different from one another, and like what they say they are."""

from __future__ import annotations

import pickle
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reportlab.pdfgen.canvas import Canvas
from scipy import stats

from prooflight.errors import RequestError
from prooflight.pages.raster import MM_PER_INCH, Page
from prooflight.simulation.corpus.corpus import (
    BLACK_ALONE,
    IN_BLACK,
    IN_COLOUR,
    SIZES_MM,
    Corpus,
    design_page,
)
from prooflight.simulation.corpus.designs.design_style import DesignStyle
from prooflight.simulation.corpus.designs.faces import OutlineFace
from prooflight.simulation.corpus.designs.inks import BLACK, TOTAL_INK_MAX, Separation
from prooflight.simulation.corpus.designs.setting import Style, broken, cut, width_em
from prooflight.simulation.corpus.designs.sheet import MM_PER_PT, Sheet
from prooflight_studies.corpus.sheet import (
    THUMBNAIL_PX,
    corpus_results,
    draw_distributions,
    page_figures,
    summary,
    summary_of,
    table,
    write_contact_sheet,
)
from prooflight_studies.harness.folder import Folder
from prooflight_studies.harness.page import page_text, plain

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.simulation.corpus.corpus import Layout

SEED = 7
DESIGNS = 50
TILE_MM = 24.0
COARSE_DPI = 60.0


@pytest.fixture(scope="module")
def designs() -> list[Page]:
    """Coarse: two tiles that differ at this resolution differ at any finer one."""
    return [design_page(SEED, index, dpi=COARSE_DPI) for index in range(DESIGNS)]


def test_black_of_four_inks_takes_the_place_of_black_alone(designs: list[Page]) -> None:
    """Where four inks are printed and nowhere else; nothing else changes, and with a share of 0 nothing at all."""
    for index, page in enumerate(designs[:6]):
        rich = design_page(SEED, index, dpi=COARSE_DPI, black_of_four=1.0)
        alone = (page.cmyk == BLACK).all(axis=2)
        np.testing.assert_array_equal(rich.cmyk[~alone], page.cmyk[~alone])
        if page.cmyk[..., :3].any():
            assert len(np.unique(rich.cmyk[alone], axis=0)) == min(alone.any(), 1)
            assert (rich.cmyk[alone].min(initial=255) if alone.any() else 255) > 0.5 * 255
        else:
            np.testing.assert_array_equal(rich.cmyk, page.cmyk)
    some = [
        not np.array_equal(design_page(SEED, index, dpi=COARSE_DPI, black_of_four=0.5).cmyk, page.cmyk)
        for index, page in enumerate(designs[:12])
    ]
    assert 0 < sum(some) < 12  # of about 8 in colour; each falls or not by its own seed


def test_a_corpus_goes_by_the_name_that_it_always_had() -> None:
    """Rows of studies are kept under it."""
    assert repr(Corpus(seed=1, dpi=200.0)) == "Corpus(seed=1, dpi=200.0)"
    assert (
        repr(Corpus(seed=1, dpi=200.0, black_of_four=0.28)) == "Corpus(seed=1, dpi=200.0, black_of_four=0.28)"
    )


@pytest.mark.parametrize("share", [-0.1, 1.1, float("nan")])
def test_a_share_that_is_none_is_refused(share: float) -> None:
    with pytest.raises(RequestError, match="share of 0 to 1"):
        design_page(SEED, 0, dpi=COARSE_DPI, black_of_four=share)


@pytest.mark.parametrize("index", [0, 5, 41])
def test_same_seed_same_page(index: int) -> None:
    first, again = (design_page(SEED, index, dpi=100.0) for _ in range(2))
    np.testing.assert_array_equal(first.cmyk, again.cmyk)
    assert (first.name, first.number) == (f"d{index + 1:05d}", index + 1)
    assert not np.array_equal(first.cmyk, design_page(SEED + 1, index, dpi=100.0).cmyk)


def _contents(page: Page) -> set[bytes]:
    """Tiles that hold more than level or upright bars of solid ink."""
    side = round(TILE_MM * page.dpi / MM_PER_INCH)
    found = set()
    for top in range(0, page.cmyk.shape[0] - side + 1, side):
        for left in range(0, page.cmyk.shape[1] - side + 1, side):
            tile = page.cmyk[top : top + side, left : left + side]
            if (tile != tile[:1]).any() and (tile != tile[:, :1]).any():
                found.add(tile.tobytes())
    return found


def test_designs_share_no_content(designs: list[Page]) -> None:
    seen: set[bytes] = set()
    for page in designs:
        tiles = _contents(page)
        assert not tiles & seen, page.name
        seen |= tiles
    assert (
        len(seen) > 20 * DESIGNS
    )  # the test has looked at something: most of an A4 page's 88 tiles hold content


def test_tiles_find_content_that_is_shared(designs: list[Page]) -> None:
    assert _contents(designs[0]) & _contents(designs[0])


def test_share_in_black(designs: list[Page]) -> None:
    """The inks are a design's first draw, so that many can be counted without drawing them."""
    drawn = [bool(np.random.default_rng([SEED, index]).random() < BLACK_ALONE) for index in range(2000)]
    assert [not page.cmyk[..., :3].any() for page in designs] == drawn[:DESIGNS]
    # alpha = 0.1 %, two-sided, over the one sample that the seed gives
    assert stats.binomtest(sum(drawn[:200]), 200, 0.30).pvalue > 1e-3
    assert stats.binomtest(sum(drawn), 2000, 0.30).pvalue > 1e-3


@pytest.mark.parametrize("index", [0, 3, 9, 20, 33])
def test_layout_is_the_same_at_two_resolutions(index: int) -> None:
    maps = []
    for dpi in (100.0, 250.0):
        page = design_page(SEED, index, dpi=dpi)
        size = (round(page.width_mm), round(page.height_mm))
        maps.append(cv2.resize(page.cmyk, size, interpolation=cv2.INTER_AREA).sum(axis=2, dtype=np.float32))
        assert any(
            abs(page.width_mm - width) <= page.pixel_mm / 2
            and abs(page.height_mm - height) <= page.pixel_mm / 2
            for width, height in SIZES_MM
        )
    assert maps[0].shape == maps[1].shape
    # A map has 1 mm a pixel. Content lies within half a pixel of either raster, the page's own edge too: 0.25 mm.
    (across, along), _ = cv2.phaseCorrelate(maps[0], maps[1])
    assert max(abs(across), abs(along)) < 0.25
    assert np.corrcoef(maps[0].ravel(), maps[1].ravel())[0, 1] > 0.9


@pytest.mark.parametrize("black_alone", [True, False])
@pytest.mark.parametrize("layout", dict.fromkeys([*IN_BLACK, *IN_COLOUR]), ids=lambda layout: layout.__name__)
def test_every_kind_fits_the_smallest_page(layout: Layout, black_alone: bool) -> None:
    rng = np.random.default_rng([SEED, 1])
    width_mm, height_mm = min(SIZES_MM)
    sheet = Sheet(width_mm=width_mm, height_mm=height_mm, dpi=50.0)
    layout(sheet, rng, DesignStyle.draw(rng, black_alone=black_alone))
    assert sheet.cmyk.any()
    assert not (black_alone and sheet.cmyk[..., :3].any())


def test_corpus_travels_to_other_processes() -> None:
    corpus = pickle.loads(pickle.dumps(Corpus(seed=SEED, dpi=40.0)))
    np.testing.assert_array_equal(corpus.page(3).cmyk, design_page(SEED, 3, dpi=40.0).cmyk)


def test_requests_for_what_there_is_not() -> None:
    with pytest.raises(RequestError, match="no design -1; count from 0"):
        design_page(SEED, -1, dpi=100.0)
    with pytest.raises(RequestError, match="a resolution of 0 dpi; give a dpi above 0"):
        design_page(SEED, 0, dpi=0)


def test_folder_of_pdfs(tmp_path: Path) -> None:
    pytest.importorskip("pymupdf")
    for name, pages in (("a.pdf", 2), ("b.pdf", 1)):
        canvas = Canvas(str(tmp_path / name), pagesize=(144, 72))
        for number in range(pages):
            canvas.setFillColorCMYK(0, 0, 0, 1)
            canvas.rect(0, 0, 36 * (number + 1 + (name == "b.pdf") * 2), 72, stroke=0, fill=1)
            canvas.showPage()
        canvas.save()
    folder = pickle.loads(pickle.dumps(Folder(path=tmp_path, dpi=72.0)))
    assert len(folder) == 3
    for index in range(3):
        page = folder.page(index)
        assert (page.name, page.number, page.cmyk.shape) == (f"d{index + 1:05d}", index + 1, (72, 144, 4))
        assert page.cmyk[..., 3].mean() / 255 == pytest.approx((index + 1) / 4)
    for index in (-1, 3):
        with pytest.raises(RequestError, match=rf"no design {index}; give 0 to 2"):
            folder.page(index)


def test_figures_of_a_known_page() -> None:
    """Left half paper, then a quarter black, then a quarter of half cyan and full black, at the camera's own pitch."""
    cmyk = np.zeros((40, 80, 4), np.uint8)
    cmyk[:, 40:, 3] = 255
    cmyk[:, 60:, 0] = 51
    figures = page_figures(Page(cmyk=cmyk, dpi=MM_PER_INCH / 0.1054, name="known", number=1))
    assert figures.white == pytest.approx(0.5)
    assert (figures.cyan, figures.black) == (pytest.approx(0.05), pytest.approx(0.5))
    assert figures.total_ink == pytest.approx(0.55)
    assert figures.black_alone == pytest.approx(0.5)
    assert figures.edges == pytest.approx(2 / 80)  # a column on each side of the one great step


def test_page_of_results_names_its_pictures(tmp_path: Path) -> None:
    summaries = [summary_of(Corpus(seed=SEED, dpi=50.0), index) for index in (1, 2, 4)]
    figures = table(summary.figures for summary in summaries)
    sheet = tmp_path / "corpus-1.jpg"
    write_contact_sheet(sheet, [summary.thumbnail for summary in summaries], columns=2)
    assert cv2.imread(str(sheet)).shape == (2 * THUMBNAIL_PX[1], 2 * THUMBNAIL_PX[0], 3)
    draw_distributions(tmp_path / "corpus-figures.png", figures, figures)
    found = corpus_results(
        figures, figures, seed=SEED, dpi=50.0, times={50.0: [0.5, 0.1]}, sheets=[sheet.name]
    )
    text = page_text({"study": "corpus", **plain(found)})
    assert "(corpus-1.jpg)" in text
    assert "(corpus-figures.png)" in text
    assert (tmp_path / "corpus-figures.png").stat().st_size > 1000
    assert "| 50 dpi | 2 | 0.300 s | 0.50 s |" in text
    white = summary(figures)["white"]
    assert isinstance(white, list)
    assert f"| white | {white[0]:.1%} / **{white[1]:.1%}** / {white[2]:.1%}".replace("%", " %") in text
    assert "| 0.00 |" in text  # the same pages on both sides


colours = st.tuples(*[st.floats(0, 1)] * 3)


@given(colours, st.floats(0.5, 0.95), st.floats(0.1, 0.45))
def test_separation_keeps_to_its_inks(
    colour: tuple[float, float, float], replaced: float, grey: float
) -> None:
    black = Separation(black_alone=True, replaced=replaced, from_grey=grey)
    assert black.ink(*colour)[:3] == (0, 0, 0)
    four = Separation(black_alone=False, replaced=replaced, from_grey=grey)
    assert sum(four.ink(*colour)) <= 255 * TOTAL_INK_MAX + 2  # four roundings
    assert four.ink(1, 1, 1) == (0, 0, 0, 0)
    darker = [part / 2 for part in colour]
    assert sum(four.ink(*darker)) >= sum(four.ink(*colour)) - 2 or sum(four.ink(*colour)) > 250


def test_black_type_prints_over_and_other_type_knocks_out() -> None:
    tint, face = (0, 90, 40, 0), OutlineFace("DejaVuSans")
    for ink, under in ((BLACK, (0, 90, 40)), ((200, 0, 0, 0), (200, 0, 0))):
        sheet = Sheet(width_mm=20, height_mm=10, dpi=200)
        sheet.rect(0, 0, 20, 10, tint)
        sheet.draw_text(3, 8, "Ag", face, 20, ink)
        inked = (sheet.cmyk != tint).any(axis=2)
        assert inked.sum() > 200
        np.testing.assert_array_equal(sheet.cmyk[inked], np.tile([*under, ink[3]], (inked.sum(), 1)))


@pytest.mark.parametrize("letter", ["χ", "Σ", "a"])  # FreeType's own renderer overflows on the first two
def test_smallest_type_is_drawn(letter: str) -> None:
    glyph = OutlineFace("DejaVuSans-Bold").glyph(letter, 3.0)
    assert glyph.mask.any()
    assert max(glyph.mask.shape) <= 6


@given(st.lists(st.text("abcdefgh", min_size=1, max_size=9), min_size=1, max_size=40), st.floats(20, 80))
def test_lines_hold_every_word_and_no_more_than_fits(words: list[str], width_mm: float) -> None:
    style = Style(face=OutlineFace("DejaVuSerif"), size_pt=10.0)
    lines = broken(words, style, width_mm)
    assert [word for line in lines for word in line.words] == words
    for line in lines:
        length = width_em(" ".join(line.words), style.face) * style.size_pt * MM_PER_PT
        assert length <= width_mm + 1e-9 or len(line.words) == 1


@given(st.text("abcdefgh ", max_size=30), st.floats(0, 40))
def test_cut_is_the_longest_beginning_that_fits(text: str, width_mm: float) -> None:
    face = OutlineFace("DejaVuSans")
    kept = cut(text, face, 8.0, width_mm)
    em = 8.0 * MM_PER_PT
    assert text.startswith(kept)
    assert width_em(kept, face) * em <= width_mm + 1e-9
    assert kept == text or width_em(text[: len(kept) + 1], face) * em > width_mm - 1e-9

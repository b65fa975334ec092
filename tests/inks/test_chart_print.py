from pathlib import Path

import numpy as np
import pymupdf
import pytest
import tifffile
from hypothesis import given
from hypothesis import strategies as st

from prooflight.errors import ChartError, RequestError
from prooflight.inks.cgats import read_tables
from prooflight.inks.chart_layout import Layout, place_recipes, read_recipe_file, write_recipes
from prooflight.inks.chart_print import ChartFiles, make_chart, painted, raster
from prooflight.pages.files import read_image

SMALL = Layout(width_mm=90.0, height_mm=100.0, margin_mm=5.0, mark_mm=3.0, patch_mm=6.0, gap_mm=0.5)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> ChartFiles:
    folder = tmp_path_factory.mktemp("made") / "new"
    return make_chart(folder, 150, rng=np.random.default_rng(0), layout=SMALL)


@pytest.mark.parametrize(
    "layout", [Layout(), SMALL, Layout(patch_mm=5.0, gap_mm=0.1, width_mm=297.0, height_mm=420.0)]
)
@pytest.mark.parametrize("page", [1, 2, 255])
def test_nothing_overlaps_and_all_lies_on_the_page(layout: Layout, page: int) -> None:
    taken = np.zeros((round(layout.height_mm * 10), round(layout.width_mm * 10)), dtype=np.int64)

    def take(box: tuple[float, float, float, float]) -> None:
        x, y, width, height = (round(edge * 10) for edge in box)
        assert x >= round(layout.margin_mm * 10)
        assert y >= round(layout.margin_mm * 10)
        assert x + width <= taken.shape[1] - round(layout.margin_mm * 10)
        assert y + height <= taken.shape[0] - round(layout.margin_mm * 10)
        taken[y : y + height, x : x + width] += 1

    for box in layout.mark_boxes():
        take(box)
    for box, black in layout.black_and_white(page)[8:]:
        assert black
        take(box)
    for row in range(1, layout.rows + 1):
        for column in range(1, layout.columns + 1):
            take(layout.patch_box(row, column))
    assert taken.max() == 1


def test_the_page_number_can_be_read_back() -> None:
    for page in range(1, 256):
        boxes = SMALL.code_boxes(page)
        left, side = boxes[0][0], boxes[0][2]
        places = [round((box[0] - left) / side) for box in boxes]
        assert places[0] == 0
        assert places[-1] == 10
        assert sum(1 << (8 - place) for place in places[1:-1]) == page


def test_every_recipe_has_one_place(recipes_100: np.ndarray) -> None:
    placed = place_recipes(recipes_100, SMALL, np.random.default_rng(3))
    assert len(np.unique(placed.place, axis=0)) == 100
    assert placed.place.min() == 1
    assert placed.place[:, 1].max() <= SMALL.rows
    assert placed.place[:, 2].max() <= SMALL.columns
    np.testing.assert_array_equal(np.unique(placed.cmyk, axis=0), np.unique(recipes_100, axis=0))
    assert (placed.cmyk != recipes_100).any()


def test_the_tiff_holds_every_patch_where_the_recipe_file_says(files: ChartFiles) -> None:
    placed = read_recipe_file(files.recipes)
    assert placed.layout == SMALL
    assert len(placed.cmyk) == 150
    assert placed.pages == len(files.tiffs) == -(-150 // SMALL.patches_per_page) > 1
    for (page, row, column), recipe in zip(placed.place.tolist(), placed.cmyk, strict=True):
        (sheet,) = read_image(files.tiffs[page - 1])
        assert sheet.dpi == pytest.approx(254)
        assert sheet.width_mm == pytest.approx(90)
        x, y, width, height = (round(edge * 10) for edge in SMALL.patch_box(row, column))
        np.testing.assert_array_equal(
            sheet.cmyk[y : y + height, x : x + width],
            np.broadcast_to(np.round(recipe * 255), (height, width, 4)),
        )
        if (page, row, column) == (2, 1, 1):
            break


def test_marks_stand_in_the_corners_of_the_tiff(files: ChartFiles) -> None:
    black = tifffile.imread(files.tiffs[0])[..., 3]
    for x, y, side, _ in SMALL.mark_boxes():
        mark = black[round(y * 10) : round((y + side) * 10), round(x * 10) : round((x + side) * 10)]
        assert (mark[:10] == 255).all()
        assert (mark[10:20, 10:20] == 0).all()
        assert (mark == 255).mean() == pytest.approx(8 / 9)


def test_the_pdf_paints_the_same_inks_in_the_same_places(files: ChartFiles) -> None:
    placed = read_recipe_file(files.recipes)
    with pymupdf.open(files.pdf) as document:
        assert document.page_count == placed.pages
        assert document[0].rect.width == pytest.approx(90 * 72 / 25.4, abs=0.01)
        drawings = document[0].get_drawings()
        pixels = document[0].get_pixmap(dpi=254, colorspace=pymupdf.csCMYK)
    boxes = [box for box, _ in painted(placed, 1)]
    assert len(drawings) == len(boxes)
    for drawing, box in zip(drawings, boxes, strict=True):
        corner = [edge * 25.4 / 72 for edge in (drawing["rect"].x0, drawing["rect"].y0)]
        np.testing.assert_allclose(corner, box[:2], atol=0.02)
    drawn = np.frombuffer(pixels.samples, dtype=np.uint8).reshape(pixels.height, pixels.width, -1)[..., :4]
    for (page, row, column), recipe in zip(placed.place.tolist(), placed.cmyk, strict=True):
        if page == 1:
            x, y = (round((edge + 3) * 10) for edge in SMALL.patch_box(row, column)[:2])
            np.testing.assert_allclose(drawn[y, x], recipe * 255, atol=1)


def test_the_same_seed_makes_the_same_files(files: ChartFiles, tmp_path: Path) -> None:
    again = make_chart(tmp_path, 150, rng=np.random.default_rng(0), layout=SMALL)
    assert again.pdf.read_bytes() == files.pdf.read_bytes()
    assert again.recipes.read_bytes() == files.recipes.read_bytes()
    np.testing.assert_array_equal(tifffile.imread(again.tiffs[1]), tifffile.imread(files.tiffs[1]))
    other = make_chart(tmp_path, 150, rng=np.random.default_rng(1), layout=SMALL)
    assert other.recipes.read_bytes() != files.recipes.read_bytes()
    assert not list(tmp_path.glob("*.partial"))


@given(st.integers(0, 10_000))
def test_the_recipe_file_keeps_everything(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    rng = np.random.default_rng(seed)
    cmyk = rng.integers(0, 256, size=(int(rng.integers(1, 200)), 4)) / 255
    placed = place_recipes(cmyk, SMALL, rng)
    path = tmp_path_factory.getbasetemp() / "recipes.txt"
    write_recipes(path, placed)
    again = read_recipe_file(path)
    assert again.layout == placed.layout
    np.testing.assert_array_equal(again.place, placed.place)
    np.testing.assert_array_equal(again.cmyk, placed.cmyk)


def test_its_keywords_are_declared_as_cgats_wants(files: ChartFiles) -> None:
    keywords = read_tables(files.recipes)[0].keywords
    for at, (name, _) in enumerate(keywords):
        if name.startswith("PROOFLIGHT_"):
            assert keywords[at - 1] == ("KEYWORD", name)


def test_requests_that_cannot_be_met(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for patches in (15, 100_000):
        with pytest.raises(RequestError, match=f"a chart of {patches} patches"):
            make_chart(tmp_path / "x", patches, rng=rng)
    assert not (tmp_path / "x").exists()
    with pytest.raises(RequestError, match="at least 5 mm"):
        Layout(patch_mm=4.9)
    with pytest.raises(RequestError, match=r"multiple of 0\.1"):
        Layout(gap_mm=0.25)
    with pytest.raises(RequestError, match="no room"):
        Layout(width_mm=60.0)
    tiny = Layout(width_mm=80.0, height_mm=60.0, margin_mm=5.0, mark_mm=3.0, patch_mm=20.0, gap_mm=5.0)
    with pytest.raises(RequestError, match="need 334 pages"):
        place_recipes(np.zeros((tiny.patches_per_page * 334, 4)), tiny, rng)


def test_recipe_files_of_others_are_refused(tmp_path: Path, files: ChartFiles) -> None:
    text = files.recipes.read_text()
    for before, after, message in (
        ('PROOFLIGHT_LAYOUT\t"1"', 'PROOFLIGHT_LAYOUT\t"2"', "do not state the positions of patches"),
        ('PROOFLIGHT_GAP_MM\t"0.5"', 'PROOFLIGHT_GAP_MM\t"wide"', "do not state the positions of patches"),
        ("COLUMN\t", "COLUMNS\t", "the column COLUMN is missing"),
        ("\n1\t1\t1\t1\t", "\n1\tA\t1\t1\t", "not numbers"),
        ('PROOFLIGHT_GAP_MM\t"0.5"', 'PROOFLIGHT_GAP_MM\t"0.25"', "recipes.txt: chart layout: gap_mm = 0.25"),
        (
            'PROOFLIGHT_GAP_MM\t"0.5"',
            'PROOFLIGHT_GAP_MM\t"1e300"',
            "recipes.txt: chart layout: gap_mm = 1e.300",
        ),
        ("\n1\t1\t1\t1\t", "\n1\t1\t1\t1e9\t", "there is no row 1, column 1e.09 on a page 1"),
        ("\n1\t1\t1\t1\t", "\n1\t0\t1\t1\t", "there is no row 1, column 1 on a page 0"),
        ("\n1\t1\t1\t1\t", "\n1\t1\t1\t1.5\t", "there is no row 1, column 1.5 on a page 1"),
        ("\n1\t1\t1\t1\t", "\n1\t1\t1\t2\t", "another patch is at the same position"),
        ("\n1\t1\t1\t1\t", "\n1\t1\t1\t1\t-", "C is -"),
    ):
        assert before in text
        path = tmp_path / "recipes.txt"
        path.write_text(text.replace(before, after))
        with pytest.raises(ChartError, match=message):
            read_recipe_file(path)


def test_raster_has_ten_pixels_a_millimetre(recipes_100: np.ndarray) -> None:
    placed = place_recipes(recipes_100, SMALL, np.random.default_rng(0))
    page = raster(placed, 1)
    assert page.shape == (1000, 900, 4)
    assert page.dtype == np.uint8

"""The study on real pairs: its measures, its tuning, and a few pairs of the data set where it is there."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image
from tests.stand_ins import others

from prooflight.errors import RequestError, ScanError
from prooflight_studies.golden.pairs import (
    CUT_PIXELS,
    GoldenPair,
    halves,
    matched,
    overlap,
    read_pairs,
    set_off,
    shifted,
    transformed,
    turned,
    warped,
)
from prooflight_studies.golden.study import Outcome, Setting, analysed, figures, judged, tuned

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight_studies.golden.pairs import Field

SETTING = Setting(edge_pixels=2.0, joining_pixels=4, least_volume=6.0, margin_pixels=10)


def outcome(found: int, false: int, marked: int) -> Outcome:
    box = (0, 0, 10, 10)
    return Outcome(
        name="pair",
        boxes=(box,) * (found + false),
        pairs={at: (at, 0.8) for at in range(found)},
        marked=(box,) * marked,
        kinds=(1,) * marked,
    )


def test_overlap_of_boxes() -> None:
    assert overlap((0, 0, 4, 4), (0, 0, 4, 4)) == 1
    assert overlap((0, 0, 4, 4), (2, 0, 6, 4)) == pytest.approx(8 / 24)
    assert overlap((0, 0, 4, 4), (4, 0, 8, 4)) == 0


def test_each_box_counts_once_and_the_best_overlap_first() -> None:
    marked = [(0, 0, 10, 10)]
    found = [(0, 0, 10, 6), (0, 0, 10, 9), (50, 50, 60, 60)]
    assert matched(found, marked) == {1: (0, pytest.approx(0.9))}


def test_figures_add_up_over_images() -> None:
    rows = [outcome(4, 1, 5), outcome(5, 0, 5)]
    made = figures(rows, SETTING, method="golden", tuned_on="even", rng=np.random.default_rng(0))
    assert (made.marked, made.found_percent, made.false_per_image) == (10, 90.0, 0.5)
    assert made.by_kind == {1: (10, 9, pytest.approx(0.8))}
    # two images, drawn with replacement: a quarter of the draws have either one twice
    assert made.found_95_percent == (80.0, 100.0)
    assert made.false_95_per_image == (0.0, 1.0)


def test_no_false_region_in_thirty_images_may_still_be_one_in_ten() -> None:
    made = figures(
        [outcome(5, 0, 5)] * 30, SETTING, method="golden", tuned_on="even", rng=np.random.default_rng(0)
    )
    assert made.false_most_per_image == pytest.approx(-np.log(0.05) / 30)  # Poisson: exp(-30 rate) = 0.05
    assert made.found_least_percent == pytest.approx(100 * 0.05 ** (1 / 150))  # binomial: share^150 = 0.05


def drawn_pair(name: str, seed: int) -> GoldenPair:
    """A board of bars with two dark specks, marked with a margin of 9 pixels."""
    rng = np.random.default_rng(seed)
    golden = np.full((1, 160, 160), 255, np.float32)
    for at in range(10, 150, 30):
        golden[:, at : at + 9, 5:100] = 0
    scan, boxes = golden.copy(), []
    for left in (115, 140):
        top, side = int(rng.integers(20, 120)), int(rng.integers(5, 9))
        scan[:, top : top + side, left : left + side] = 0
        boxes.append((left - 9, top - 9, left + side + 9, top + side + 9))
    return GoldenPair(name=name, golden=golden, scan=scan, marked=tuple(boxes), kinds=(5, 5))


def test_tuning_finds_the_margin_that_the_markers_left() -> None:
    pairs = [drawn_pair(f"pair{seed}", seed) for seed in range(3)]
    looked = analysed(pairs, "difference, opened")
    setting = tuned(looked)
    assert setting.margin_pixels == 9
    said = [judged(*one, setting) for one in looked]
    assert [(one.hits, one.false) for one in said] == [(2, 0)] * 3


# --- known transforms ---


def test_a_golden_is_moved_and_its_scan_and_marks_stay() -> None:
    pair = drawn_pair("pair", 1)
    across = 5.0

    def right(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
        return np.stack([np.full(shape, across, np.float32), np.zeros(shape, np.float32)])

    moved = transformed(pair, right, np.random.default_rng(0))
    inner = slice(CUT_PIXELS, -CUT_PIXELS)
    np.testing.assert_array_equal(moved.scan, pair.scan[:, inner, inner])
    np.testing.assert_array_equal(moved.golden, np.roll(pair.golden, 5, axis=2)[:, inner, inner])
    whole = [box for box in pair.marked if max(box[2:]) <= 160 - CUT_PIXELS and min(box[:2]) >= CUT_PIXELS]
    assert moved.marked == tuple(tuple(side - CUT_PIXELS for side in box) for box in whole)
    assert len(moved.marked) + len(moved.cut) == len(pair.marked)


@pytest.mark.parametrize(
    ("field", "most"), [(shifted(12), 12), (warped(3), 3), (set_off(2), 2), (turned(0.5), 1.42)]
)
def test_fields_move_by_no_more_than_they_say(field: Field, most: float) -> None:
    rng = np.random.default_rng(3)
    reached = [
        float(np.hypot(*field((160, 280), rng)).max()) for _ in range(5)
    ]  # turned: 0.0087 of 161 pixels
    assert max(reached) <= most * 1.001
    assert max(reached) > 0.5 * most


def test_what_is_found_on_a_mark_that_is_cut_is_neither_right_nor_false() -> None:
    pair = drawn_pair("pair", 2)
    (looked,) = analysed([pair])
    whole = judged(*looked, SETTING)
    assert (whole.hits, whole.false) == (2, 0)
    without = replace(pair, marked=pair.marked[:1], kinds=(5,))
    assert judged(without, looked[1], SETTING).false == 1
    cut = judged(replace(without, cut=pair.marked[1:]), looked[1], SETTING)
    assert (cut.hits, cut.false) == (1, 0)


def test_a_pair_that_does_not_fit_finds_nothing() -> None:
    pair = drawn_pair("pair", 3)
    seen = dict.fromkeys(analysed([pair])[0][1])
    said = judged(pair, seen, SETTING)
    assert (said.unfit, said.hits, said.false) == (True, 0, 0)


# --- files ---


def pair_files(folder: Path, marks: str, *, width: int = 20) -> Path:
    for which, across in (("temp", 20), ("test", width)):
        Image.fromarray(np.zeros((20, across), np.uint8)).save(folder / f"a_{which}.jpg")
    (folder / "a.txt").write_text(marks)
    return folder


def test_pairs_are_read_by_name(tmp_path: Path) -> None:
    (pair,) = read_pairs(pair_files(tmp_path, "1 2 10 12 3\n"))
    assert (pair.name, pair.marked, pair.kinds) == ("a", ((1, 2, 10, 12),), (3,))
    assert pair.golden.shape == pair.scan.shape == (1, 20, 20)


@pytest.mark.parametrize("marks", ["1 2 3 4\n", "1 2 3 4 9\n", "a b c d 1\n"])
def test_a_list_that_is_none(tmp_path: Path, marks: str) -> None:
    with pytest.raises(ScanError, match="not a list of marked defects"):
        read_pairs(pair_files(tmp_path, marks))


@pytest.mark.parametrize("marks", ["3 2 1 4 1\n", "1 2 30 4 1\n", "1 2 3 " + "9" * 5000 + " 1\n"])
def test_marks_off_their_scan(tmp_path: Path, marks: str) -> None:
    with pytest.raises(ScanError, match="line 1"):
        read_pairs(pair_files(tmp_path, marks))


def test_scans_of_different_sizes(tmp_path: Path) -> None:
    with pytest.raises(ScanError, match="give scans of one size"):
        read_pairs(pair_files(tmp_path, "1 2 3 4 1\n", width=24))


def test_a_folder_without_pairs(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match="holds no pairs"):
        read_pairs(tmp_path)


# --- pairs in files ---


@pytest.fixture(params=[None, *others("golden pairs")], ids=lambda path: path.stem if path else "drawn")
def pairs_folder(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A folder of pairs, drawn here or of the data set."""
    if request.param is None:
        for seed in range(6):
            drawn = drawn_pair(f"pair{seed}", seed)
            for which, values in (("temp", drawn.golden), ("test", drawn.scan)):
                Image.fromarray(values[0].astype(np.uint8)).save(
                    tmp_path / f"{drawn.name}_{which}.jpg", quality=95
                )
            marks = [(*box, kind) for box, kind in zip(drawn.marked, drawn.kinds, strict=True)]
            (tmp_path / f"{drawn.name}.txt").write_text(
                "".join(f"{' '.join(map(str, mark))}\n" for mark in marks)
            )
    return request.param or tmp_path


def test_every_defect_of_a_few_pairs_is_found_and_nothing_else(pairs_folder: Path) -> None:
    tuning, _ = halves(read_pairs(pairs_folder))
    said = [judged(*one, SETTING) for one in analysed(tuning[:3])]
    assert len(said) == 3
    assert sum(one.hits for one in said) == sum(len(one.kinds) for one in said)
    assert sum(one.false for one in said) == 0

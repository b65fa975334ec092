"""The study on real pairs: its measures, its tuning, and a few pairs of the data set where it is there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image
from tests.stand_ins import others

from prooflight.errors import RequestError, ScanError
from prooflight_studies.golden.figures import Outcome, Setting, figures
from prooflight_studies.golden.pairs import GoldenPair, halves, matched, overlap, read_pairs
from prooflight_studies.golden.study import differences, judged, tuned

if TYPE_CHECKING:
    from pathlib import Path

SETTING = Setting(edge_pixels=2.0, joining_pixels=4, least_volume=6.0, margin_pixels=10)


def outcome(found: int, false: int, marked: int) -> Outcome:
    box = (0, 0, 10, 10)
    return Outcome(
        name="pair",
        found=(box,) * (found + false),
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
    seen = {pair.name: differences(pair, "difference, opened") for pair in pairs}
    setting = tuned(pairs, seen)
    assert setting.margin_pixels == 9
    said = [judged(pair, seen[pair.name], setting) for pair in pairs]
    assert [(one.hits, one.false) for one in said] == [(2, 0)] * 3


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
    said = [judged(pair, differences(pair, "golden"), SETTING) for pair in tuning[:3]]
    assert len(said) == 3
    assert sum(one.hits for one in said) == sum(len(one.kinds) for one in said)
    assert sum(one.false for one in said) == 0

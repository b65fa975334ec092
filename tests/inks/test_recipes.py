from itertools import product
from pathlib import Path

import numpy as np
import pytest

from prooflight.errors import RequestError
from prooflight.inks.recipes import choose_recipes, printable_recipes, read_recipes

SOLIDS = np.array(list(product((0.0, 1.0), repeat=4)))


def test_printable_recipes_are_whole_levels_without_repeats() -> None:
    recipes = printable_recipes()
    levels = recipes * 255
    np.testing.assert_allclose(levels, np.round(levels), atol=1e-9)
    assert len(np.unique(np.round(levels), axis=0)) == len(recipes) > 1338
    assert recipes.min() == 0
    assert recipes.max() == 1
    assert {tuple(solid) for solid in SOLIDS} <= {tuple(recipe) for recipe in recipes}


def test_the_ink_limit_holds() -> None:
    limited = printable_recipes(280.0)
    assert 0 < len(limited) < len(printable_recipes())
    assert 100 * limited.sum(axis=1).max() <= 280.2  # one level of 255 may round up


def test_solids_come_first_the_rest_fills_space() -> None:
    candidates = printable_recipes()
    order = choose_recipes(candidates, 60)
    assert len(set(order.tolist())) == 60
    assert {tuple(recipe) for recipe in candidates[order[:16]]} == {tuple(solid) for solid in SOLIDS}
    assert not candidates[order[0]].any()  # paper before all
    assert candidates[order[16]].max() < 1  # then the middle, not another edge

    def farthest(chosen: np.ndarray) -> float:
        return float(np.linalg.norm(candidates[:, None] - candidates[chosen], axis=2).min(axis=1).max())

    rng = np.random.default_rng(0)
    at_random = np.concatenate([order[:16], rng.permutation(len(candidates))[:44]])
    assert farthest(order) < farthest(at_random)


def test_each_step_is_the_one_that_lowers_the_variance_most() -> None:
    candidates = np.random.default_rng(1).uniform(0.1, 0.9, size=(40, 4))
    distance = np.linalg.norm(candidates[:, None] - candidates, axis=2) * 5**0.5
    prior = (1 + distance + distance**2 / 3) * np.exp(-distance)

    def variance_left(known: list[int]) -> float:
        inside = prior[np.ix_(known, known)] + 1e-6 * np.eye(len(known))
        return float(np.trace(prior - prior[:, known] @ np.linalg.solve(inside, prior[known])))

    order = choose_recipes(candidates, 6).tolist()
    for step in range(6):
        others = [at for at in range(40) if at not in order[:step]]
        best = min(others, key=lambda at: variance_left([*order[:step], at]))
        assert order[step] == best


def test_longer_lists_begin_like_shorter_ones_and_end(recipes_100: np.ndarray) -> None:
    np.testing.assert_array_equal(choose_recipes(recipes_100, 40), choose_recipes(recipes_100, 60)[:40])
    assert sorted(choose_recipes(recipes_100, 100)) == list(range(100))
    with pytest.raises(ValueError, match="101 recipes wanted of 100"):
        choose_recipes(recipes_100, 101)


@pytest.mark.parametrize(
    "text",
    [
        "C,M,Y,K\n0,0,0,0\n100,50,0.5,20\n",
        "\ufeffc, m, y, k\r\n0, 0, 0, 0\r\n\r\n100, 50, 0.5, 20\r\n",
        "C;M;Y;K\n0;0;0;0\n100;50;0,5;20\n",
        "name\tK\tY\tM\tC\nwhite\t0\t0\t0\t0\nblue\t20\t0,5\t50\t100\n",
        '"CMYK_C","CMYK_M","CMYK_Y","CMYK_K"\n"0","0","0","0"\n"100","50","0.5","20"',
    ],
)
def test_recipes_from_csv(tmp_path: Path, text: str) -> None:
    path = tmp_path / "q.csv"
    path.write_text(text, encoding="utf-8", newline="")
    np.testing.assert_allclose(read_recipes(path), [[0, 0, 0, 0], [1, 0.5, 0.005, 0.2]], rtol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        ("\n \n", "the file is empty"),
        ("0,0,0,0\n1,2,3,4\n", "the first line is '0,0,0,0'"),
        ("C,M,Y\n1,2,3\n", "the first line is 'C,M,Y'"),
        ("C,M,Y,K\n", "there are no recipes below the header"),
        ("C,M,Y,K\n1,2,3\n", "line 2 has 3 values for 4 columns"),
        ("C,M,Y,K\n1,2,3,4\n\n1,2,x,4\n", "line 4: Y is x"),
        ("C,M,Y,K\n1,2,nan,4\n", "line 2: Y is nan"),
        ("C,M,Y,K\n1,2,,4\n", "line 2: Y is empty"),
        ("C,M,Y,K\n0,0,0,255\n", "line 2: K is 255"),
        ("C,M,Y,K\n0,-1,0,5\n", "line 2: M is -1"),
        ("C,M,Y,K\n0,1,0,0.5\n", "no ink goes beyond 1 %; the recipes look like 0..1"),
        ('C,M,Y,K\n1,2,3,"4\n5,6,7,8\n', "line 2 cannot be read (unexpected end of data)"),
        ("C,M,Y,K\n0,5,20,30,40\n", "line 2 has 5 values for 4 columns"),
        ("C,M,Y,K\n1,2,3,1e999\n", "line 2: K is 1e999"),
        ("C,M,Y,K\n1,2,3," + "[" * 100_000, "line 2: K is [[["),
        ("C,M,Y,K\n1,2,3," + "4" * 200_000, "line 2 cannot be read (field larger than field limit"),
        ("x" * 100_000 + "\n1\n", "the first line is 'xxx"),
        ("C,M,Y,K\n" + "1,2,3,4\n" * 100_001, "there are 100001 recipes"),
        ("C,M,Y,K\n" + "\n" * 8_000_001, "is larger than 8 MB"),
        ("C,M,Y,K\n1,2,3,4\x00\n", "is binary, not text"),
    ],
)
def test_csv_that_cannot_be_used(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "q.csv"
    path.write_text(text)
    with pytest.raises(RequestError) as caught:
        read_recipes(path)
    assert str(caught.value).startswith(f"{path}: {message}")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


def test_recipes_in_utf_16_and_latin_1(tmp_path: Path) -> None:
    path = tmp_path / "q.csv"
    for encoding in ("utf-16", "latin-1"):
        path.write_bytes("name\tC\tM\tY\tK\nGrün\t100\t0\t50\t0\n".encode(encoding))
        np.testing.assert_allclose(read_recipes(path), [[1, 0, 0.5, 0]])

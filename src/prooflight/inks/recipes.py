"""Choice of the recipes to print, and recipes that a user requests in a CSV file."""

from __future__ import annotations

import csv
from itertools import product
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INK_LETTERS, INKS
from prooflight.errors import RequestError
from prooflight.files.given import GivenFiles, shortly
from prooflight.inks.cgats import number

# Levels [%] of C, M and Y under each K: black hides them, so fewer are needed. The pattern is the field's
# (ISO 12642-2 has such a lattice); single inks get finer steps below.
_LATTICE: Final = {
    0: (0, 10, 20, 30, 40, 55, 70, 85, 100),
    20: (0, 10, 20, 40, 55, 70, 100),
    40: (0, 10, 20, 40, 70, 100),
    60: (0, 10, 20, 40, 70, 100),
    80: (0, 20, 40, 70, 100),
    100: (0, 40, 100),
}
_RAMP: Final = (2, 3, 5, 7, 15, 25, 50, 60, 75, 80, 90, 95, 98)
# Ink fraction; of 0.5, 1 and 2 it makes no difference to the accuracy reached, within 10 %
_LENGTH: Final = 1.0
RECIPE_FILES: Final = GivenFiles(
    error=RequestError, remedy="give a CSV file of recipes, header C,M,Y,K, in per cent", largest_mb=8
)
MOST_RECIPES: Final = 100_000
"""Greatest number of recipes in a file: all their spectra are held in memory at once."""
_NUGGET: Final = 1e-6  # variance of a measured recipe; only keeps divisions safe


def printable_recipes(ink_limit_percent: float = 400.0) -> NDArray[np.float64]:
    """Return the candidate recipes, (m, 4) ink fractions that 8 bits hold exactly, total ink up to the limit."""
    lattice = [(*cmy, black) for black, levels in _LATTICE.items() for cmy in product(levels, repeat=3)]
    ramps = [tuple(level if ink == at else 0 for ink in range(INKS)) for at in range(INKS) for level in _RAMP]
    levels = np.unique(np.round(np.array(lattice + ramps) * 2.55).astype(np.int64), axis=0)
    return levels[levels.sum(axis=1) <= ink_limit_percent * 2.55 + 0.5] / 255.0


def choose_recipes(candidates: NDArray[np.float64], number_wanted: int) -> NDArray[np.int64]:
    """Return the indices of the most informative recipes of all candidates, best first; (m, 4) -> (number_wanted,).

    First the solids and overprints that are among them, then one by one the recipe that lowers most the mean
    variance of a Gaussian process over all candidates (Matern 5/2, length 1: smooth, nothing else assumed).
    The choice uses no measurement. ValueError if more are wanted than there are.
    """
    if number_wanted > len(candidates):
        message = f"{number_wanted} recipes wanted of {len(candidates)}"
        raise ValueError(message)
    solids = [np.flatnonzero((candidates == solid).all(axis=1)) for solid in product((0.0, 1.0), repeat=INKS)]
    first = [
        int(found[0]) for found in sorted(solids, key=lambda found: candidates[found].sum()) if found.size
    ]
    process = _Process(candidates, number_wanted)
    for step in range(number_wanted):
        process.learn(first[step] if step < len(first) else process.most_informative())
    return np.array(process.chosen, dtype=np.int64)


class _Process:
    """Gaussian process over the candidates, conditioned on one after the other."""

    def __init__(self, candidates: NDArray[np.float64], steps: int) -> None:
        squared = (candidates**2).sum(axis=1)
        distance = (
            np.sqrt(np.maximum(squared[:, None] + squared - 2 * candidates @ candidates.T, 0.0)) * 5**0.5
        )
        distance /= _LENGTH
        self.prior = (1 + distance + distance**2 / 3) * np.exp(-distance)
        self.variance = np.ones(len(candidates)) + _NUGGET
        self.squares = (self.prior**2).sum(axis=0)  # of each column of the covariance as it stands
        self.factors = np.empty((len(candidates), steps))
        self.chosen: list[int] = []

    def most_informative(self) -> int:
        """Return the recipe whose measurement lowers the summed variance most."""
        gain = self.squares / self.variance
        gain[self.chosen] = -np.inf
        return int(gain.argmax())

    def learn(self, recipe: int) -> None:
        """Condition on a recipe: the covariance loses the outer product of one factor."""
        earlier = self.factors[:, : len(self.chosen)]
        factor = self.prior[:, recipe] - earlier @ earlier[recipe]
        factor /= np.sqrt(factor[recipe] + _NUGGET)
        covariance_factor = self.prior @ factor - earlier @ (earlier.T @ factor)
        self.squares += factor**2 * (factor @ factor) - 2 * factor * covariance_factor
        self.variance -= factor**2
        self.factors[:, len(self.chosen)] = factor
        self.chosen.append(recipe)


def read_recipes(path: Path) -> NDArray[np.float64]:
    """Read the recipes of a CSV file with header C,M,Y,K (any order), per cent -> (n, 4) ink fractions.

    Cells are separated by comma, semicolon or tab; with the latter two decimals may have a comma.
    RequestError: no such header, no rows, a cell that is not a number from 0 to 100, or nothing above 1 %
    (recipes as fractions).
    """
    text = RECIPE_FILES.read_text(path, any_encoding=True)
    lines = [(at, line) for at, line in enumerate(text.split("\n"), start=1) if line.strip(" ,;\t")]
    if len(lines) > MOST_RECIPES + 1:
        what = f"there are {len(lines) - 1} recipes"
        raise RequestError(path, what, remedy=f"give at most {MOST_RECIPES} in a file")
    header = lines[0][1] if lines else ""
    separator = next((mark for mark in (";", "\t") if mark in header), ",")
    rows = [(at, _cells(path, at, line, separator)) for at, line in lines]
    names = [name.upper().removeprefix("CMYK_") for name in rows[0][1]] if rows else []
    if sorted(name for name in names if name in INK_LETTERS) != sorted(INK_LETTERS):
        what = f"the first line is {shortly(header)!r}" if header else "the file is empty"
        raise RequestError(path, what, remedy="the first line must be C,M,Y,K, then recipes in per cent")
    if len(rows) == 1:
        what = "there are no recipes below the header"
        raise RequestError(path, what, remedy="give one recipe a line, in per cent")
    percent = np.array([_recipe(path, at, cells, names) for at, cells in rows[1:]])
    if 0 < percent.max() <= 1:
        what = f"no ink goes beyond {percent.max():g} %; the recipes look like 0..1"
        raise RequestError(path, what, remedy="give per cent, 0..100")
    return percent / 100.0


def _cells(path: Path, at: int, line: str, separator: str) -> list[str]:
    """Return the cells of one line; quotes do not go on over lines."""
    try:
        (cells,) = csv.reader([line], delimiter=separator, strict=True)
    except csv.Error as error:
        what = f"line {at} cannot be read ({error})"
        raise RequestError(path, what, remedy="close every quote on its line") from None
    return [cell.strip() for cell in cells]


def _recipe(path: Path, line: int, cells: list[str], names: list[str]) -> list[float]:
    if len(cells) < len(names) or any(cells[len(names) :]):
        what = f"line {line} has {len(cells)} values for {len(names)} columns"
        raise RequestError(path, what, remedy="give one number each for C, M, Y and K")
    values = []
    for ink in INK_LETTERS:
        cell = cells[names.index(ink)]
        value = number(cell)
        if not 0 <= value <= 100:
            what = f"line {line}: {ink} is {shortly(cell) or 'empty'}"
            raise RequestError(path, what, remedy="give a number from 0 to 100")
        values.append(value)
    return values

"""Defects that recur at a constant distance along the paper path, at a stated false-alarm rate.

The null hypothesis is that every mark lies anywhere on its own sheet, independently of the others. Two marks
define a comb for every whole number of turns between them. Each other mark m then hits a tooth by chance with
a probability of at most q_m = 2 d_m ceil(L / P) / L: tolerance d_m, length of a sheet L, distance P. The number
of hits is a sum of independent trials with mean mu = sum q_m, of which Chernoff's bound says
P(K >= k) <= exp(k - mu) (mu / k)^k for k > mu (Chernoff 1952; Mitzenmacher and Upfal, Probability and Computing,
theorem 4.4). The bound times the number of combs that were tried is the chance of a false alarm of the run
(Boole's inequality). A comb of a fraction of P has the same hits and a larger mu, so that the least chance is
that of the distance itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight_line.causes.marks import Mark

FALSE_ALARM_RATE: Final = 0.01
"""Chance that a run without a recurring defect has a repeat. assumed: one run in a hundred, as the detector's."""
DISTANCES_MM: Final = (20.0, 20_000.0)
"""Distances that are tried: the circumferences that a press file may state."""
REACH_SDS: Final = 3.0
"""Tolerance of a tooth, in standard deviations."""
COLUMN_MM: Final = 1.5
"""Greatest distance across between marks of one defect. assumed: the web weaves by less."""
MOST_MARKS: Final = 32
"""Marks of a column that are compared at a time, which bounds the time that a column takes."""
LEAST_MARKS: Final = 4
ALIKE: Final = 0.8
"""Share of a comb's marks that must be at one place of their sheets for that place to be the better account.
assumed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Repeat:
    """Marks that recur."""

    marks: tuple[Mark, ...]
    distance_mm: float | None
    """Distance along the paper path; None: the marks only have the same place on their sheets."""
    sd_mm: float
    """Standard deviation of the distance."""
    on_page: bool
    """Whether the marks have the same place on their sheets, so that the sheets' own distance accounts for them."""
    false_alarm_rate: float
    """Upper bound of the chance that marks anywhere on their sheets look like this."""

    @property
    def x_mm(self) -> float:
        """Middle of the marks across the page."""
        return float(np.mean([mark.across_mm for mark in self.marks]))


@dataclass(frozen=True, slots=True)
class _Hits:
    chance: float
    hit: NDArray[np.bool_]
    distance_mm: float | None = None
    start_mm: float = 0.0


def repeats_of(
    marks: Sequence[Mark],
    *,
    sheet_mm: float,
    sd_mm: float,
    false_alarm_rate: float = FALSE_ALARM_RATE,
) -> list[Repeat]:
    """Return all repeats of a run, the surest of each column.

    Parameters
    ----------
    sheet_mm
        Length of a sheet along the paper path, over which a mark may be anywhere by chance. [mm]
    sd_mm
        Standard deviation of a mark's place along the paper path. [mm]
    false_alarm_rate
        Chance, per run, that marks without a common cause are reported. [-]
    """
    left = sorted(marks, key=lambda mark: mark.along_mm)
    repeats: list[Repeat] = []
    columns = _columns(left)
    trials = sum(_trials(_along(column)) + len(column) for column in columns)
    while columns:
        tried = [(_best(column, sheet_mm=sheet_mm, sd_mm=sd_mm), column) for column in columns]
        best, column = min(tried, key=lambda one: one[0].chance)
        chance = best.chance * trials
        if chance > false_alarm_rate:
            break
        repeat = _repeat(best, column, left, chance=chance, sd_mm=sd_mm)
        same = next((at for at, one in enumerate(repeats) if _alike(one, repeat)), None)
        if same is None:
            repeats.append(repeat)
        else:  # marks of the same part that are further from its teeth
            repeats[same] = replace(repeats[same], marks=(*repeats[same].marks, *repeat.marks))
        taken = set(map(id, repeat.marks))
        left = [mark for mark in left if id(mark) not in taken]
        columns = _columns(left)
    return repeats


def _alike(one: Repeat, other: Repeat) -> bool:
    """Return whether two repeats are of one column and distance."""
    if one.distance_mm is None or other.distance_mm is None or abs(one.x_mm - other.x_mm) > COLUMN_MM:
        return False
    return abs(one.distance_mm - other.distance_mm) <= REACH_SDS * np.hypot(one.sd_mm, other.sd_mm)


def _columns(marks: Sequence[Mark]) -> list[list[Mark]]:
    """Return the columns of the web with enough marks, each twice ``COLUMN_MM`` wide and half in the next.

    Long columns come in parts of ``MOST_MARKS``, in the order of the marks.
    """
    place = np.floor(np.array([mark.across_mm for mark in marks]) / COLUMN_MM).astype(np.intp)
    groups: dict[tuple[int, ...], None] = {}
    for at in np.unique([place, place - 1]):
        group = np.flatnonzero((place == at) | (place == at + 1))
        for start in range(0, group.size, MOST_MARKS):
            part = group[max(min(start, group.size - MOST_MARKS), 0) :][:MOST_MARKS]
            if part.size >= LEAST_MARKS:
                groups.setdefault(tuple(part.tolist()))
    return [[marks[at] for at in group] for group in groups]


def _along(marks: Sequence[Mark]) -> NDArray[np.float64]:
    return np.array([mark.along_mm for mark in marks])


def _pairs(along: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return first and second mark of each pair: one of the first third and one of the last, so that combs
    reach over all marks.
    """
    third = -(-along.size // 3)
    first, second = np.meshgrid(np.arange(third), np.arange(along.size - third, along.size), indexing="ij")
    return first.ravel(), second.ravel()


def _turns(along: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Return pairs and numbers of turns between them, one entry for each comb."""
    first, second = _pairs(along)
    span = along[second] - along[first]
    most = (span / DISTANCES_MM[0]).astype(np.intp)
    least = np.maximum(np.ceil(span / DISTANCES_MM[1]).astype(np.intp), 1)
    counts = np.maximum(most - least + 1, 0)
    pair = np.repeat(np.arange(first.size), counts)
    begun = np.repeat(np.cumsum(counts) - counts, counts)
    return first[pair], second[pair], np.arange(pair.size) - begun + least[pair]


def _trials(along: NDArray[np.float64]) -> int:
    return int(_turns(along)[0].size)


def _best(column: Sequence[Mark], *, sheet_mm: float, sd_mm: float) -> _Hits:
    """Return the comb, or the place on the page, that the marks of a column hit with the least chance."""
    along = _along(column)
    comb = _best_comb(along, sheet_mm=sheet_mm, sd_mm=sd_mm)
    place = _best_place(column, sheet_mm=sheet_mm, sd_mm=sd_mm)
    if place.hit.sum() >= ALIKE * comb.hit.sum() and place.chance < 1:
        return _Hits(min(place.chance, comb.chance), place.hit, comb.distance_mm, comb.start_mm)
    return comb


def _best_comb(along: NDArray[np.float64], *, sheet_mm: float, sd_mm: float) -> _Hits:
    first, second, turns = _turns(along)
    if not turns.size:
        return _Hits(1.0, np.zeros(along.size, bool))
    start = along[first, None]
    share = (along - start) / (along[second] - along[first])[:, None]
    distance = ((along[second] - along[first]) / turns)[:, None]
    # The comb passes through two marks; a third is off by its own error and by theirs, carried to its place.
    reach = REACH_SDS * sd_mm * np.sqrt(1 + (1 - share) ** 2 + share**2)
    off = along - start
    off -= np.rint(off / distance) * distance
    hit = np.abs(off) <= reach
    chance = np.minimum(2 * reach * np.ceil(sheet_mm / distance) / sheet_mm, 1.0)
    own = np.arange(along.size)
    of_pair = (own == first[:, None]) | (own == second[:, None])
    hits, mean = (hit & ~of_pair).sum(axis=1), np.where(of_pair, 0, chance).sum(axis=1)
    bound = _log_bound(hits, mean)
    at = int(np.argmin(bound))
    best = hit[at] | of_pair[at]
    return _Hits(float(np.exp(bound[at])), best, float(distance[at, 0]), float(start[at, 0]))


def _best_place(column: Sequence[Mark], *, sheet_mm: float, sd_mm: float) -> _Hits:
    """Return the place on the page that most marks have, one a sheet."""
    down, sheets = np.array([mark.y_mm for mark in column]), np.array([mark.sheet for mark in column])
    reach = REACH_SDS * sd_mm * np.sqrt(2)
    hit = np.abs(down - down[:, None]) <= reach
    others = np.array([np.unique(sheets[own]).size - 1 for own in hit])
    mean = (np.unique(sheets).size - 1) * min(2 * reach / sheet_mm * len(column) / np.unique(sheets).size, 1)
    bound = _log_bound(others, np.full(others.size, mean))
    at = int(np.argmin(bound))
    return _Hits(float(np.exp(bound[at])), hit[at])


def _log_bound(hits: NDArray[np.intp], mean: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the logarithm of Chernoff's bound of so many hits or more."""
    count, mean = np.maximum(hits, 1), np.maximum(mean, 1e-12)
    return np.where(hits > mean, count - mean + count * np.log(mean / count), 0.0)


def _repeat(
    best: _Hits, column: Sequence[Mark], marks: Sequence[Mark], *, chance: float, sd_mm: float
) -> Repeat:
    """Fit the distance to a comb's marks, and take in the marks of the whole run that it reaches."""
    own = [mark for mark, hit in zip(column, best.hit, strict=True) if hit]
    across = float(np.mean([mark.across_mm for mark in own]))
    near = [mark for mark in marks if abs(mark.across_mm - across) <= COLUMN_MM]
    on_page = _on_page(own, sd_mm)
    if on_page:
        down = float(np.median([mark.y_mm for mark in own]))
        reach = REACH_SDS * sd_mm * np.sqrt(2)
        own = [mark for mark in near if abs(mark.y_mm - down) <= reach]
    distance, start, sd = best.distance_mm, best.start_mm, np.inf
    if distance is not None:
        for _ in range(3):  # the marks that the comb reaches make it surer, and it then reaches further
            start, distance, sd, middle = _fitted(own, start, distance, sd_mm)
            if on_page:
                break
            own = [mark for mark in near if _reached(mark, start, distance, sd, middle, sd_mm)] or own
    return Repeat(
        marks=tuple(own),
        distance_mm=distance,
        sd_mm=sd,
        on_page=on_page,
        false_alarm_rate=chance,
    )


def _on_page(marks: Sequence[Mark], sd_mm: float) -> bool:
    """Return whether marks of several sheets have one place on them."""
    down = np.array([mark.y_mm for mark in marks])
    several = len({mark.sheet for mark in marks}) >= LEAST_MARKS - 1
    return several and bool(np.abs(down - np.median(down)).max() <= REACH_SDS * sd_mm * np.sqrt(2))


def _fitted(
    marks: Sequence[Mark], start_mm: float, distance_mm: float, sd_mm: float
) -> tuple[float, float, float, float]:
    """Return start, distance, its standard deviation, and the mean number of turns, by least squares."""
    along = _along(marks)
    turns = np.rint((along - start_mm) / distance_mm)
    middle = float(turns.mean())
    spread = float(((turns - middle) ** 2).sum())
    if spread == 0:
        return start_mm, distance_mm, np.inf, middle
    slope = float(((turns - middle) * (along - along.mean())).sum() / spread)
    return float(along.mean() - slope * middle), slope, sd_mm / np.sqrt(spread), middle


def _reached(
    mark: Mark, start_mm: float, distance_mm: float, sd_of_distance_mm: float, middle: float, sd_mm: float
) -> bool:
    turn = round((mark.along_mm - start_mm) / distance_mm)
    reach = REACH_SDS * float(np.hypot(sd_mm, (turn - middle) * sd_of_distance_mm))
    return abs(mark.along_mm - start_mm - turn * distance_mm) <= min(reach, distance_mm / 4)

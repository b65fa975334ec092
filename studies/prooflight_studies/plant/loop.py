"""A simulated press that drifts, with corrections applied as they are offered, and without."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.verdict import Verdict
from prooflight.rng import stream
from prooflight_line.causes.corrections import corrections_of
from prooflight_line.journal.records import PageRecord
from prooflight_line.run.monitor.corrections import LEAST_SHEETS

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

CHANNELS: Final = {"gain-black": (0.07, 0.015), "register-cyan-x": (0.20, 0.048)}
"""Tolerance, as the monitor has it, and standard deviation from print to print (``worlds.toml``)."""
SHEETS: Final = 600
DELAY: Final = 6
"""Sheets between the press unit and the camera: a correction shows on sheets after these. assumed: 2 m of path."""
WALK: Final = 0.02
"""Standard deviation of the drift from one sheet to the next, in tolerances. assumed: half a tolerance in 600."""
SLOPE: Final = 2.5
"""Greatest drift over the run, in tolerances. assumed."""
STEPS: Final = 2
"""Steps of a run, each of up to 1.5 tolerances: changes of speed, of paper, of a cartridge. assumed."""
STEP: Final = 1.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Loop:
    """Figures of many runs under one rule."""

    rule: str
    damping: float
    runs: int
    waste: float
    """Share of sheets beyond a tolerance."""
    corrections: float
    """Corrections a run."""
    oscillating: int
    """Runs that oscillate."""
    worse: int
    """Runs with more waste than without corrections."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopRun:
    """One run: deviations of each channel in tolerances, (channels, sheets), and all offsets applied."""

    deviation: NDArray[np.float64]
    offsets: dict[str, list[float]]

    @property
    def waste(self) -> float:
        """Share of sheets of which a channel is beyond its tolerance."""
        return float((np.abs(self.deviation) > 1).any(axis=0).mean())

    @property
    def oscillates(self) -> bool:
        """Whether a channel changes sides more often than it is disturbed: by its steps and by its drift."""
        return any(swings(own) > STEPS + 1 for own in self.deviation)


def disturbances(seed: int, run: int) -> tuple[NDArray[np.float64], np.random.Generator]:
    """Return what the press would do by itself, (channels, sheets) in tolerances, and the generator of its prints."""
    rng = stream(seed, "plant-loop", run)
    shape = len(CHANNELS), SHEETS
    drifts = np.cumsum(WALK * rng.standard_normal(shape), axis=1)
    drifts += rng.uniform(-SLOPE, SLOPE, (len(CHANNELS), 1)) * np.linspace(0, 1, SHEETS)
    for own in drifts:
        for at in rng.integers(0, SHEETS, STEPS):
            own[at:] += rng.uniform(-STEP, STEP)
    return drifts, rng


def loop_run(
    seed: int,
    run: int,
    *,
    damping: float | None,
    every: int | None = None,
    response: tuple[float, float] = (1.0, 1.0),
) -> LoopRun:
    """Run a press; damping: of the corrections; None: there are none.

    every: sheets after which corrections are applied by the latest sheets, whatever was applied before: the rule that
    forgets the delay. None: the product's rule, by sheets that were printed after the last correction.
    response: share of the deviation of density and of register that the journal states.
    """
    free, rng = disturbances(seed, run)
    noise = rng.standard_normal(free.shape)
    names, tolerances = list(CHANNELS), np.array([[tolerance] for tolerance, _ in CHANNELS.values()])
    spread = np.array([[sd] for _, sd in CHANNELS.values()])
    offset = np.zeros((len(names), SHEETS + DELAY + 1))
    offsets: dict[str, list[float]] = {name: [] for name in names}
    deviation, rows, since = np.empty_like(free), list[PageRecord](), 0
    wait = every or LEAST_SHEETS
    due = wait
    for sheet in range(SHEETS):
        deviation[:, sheet] = free[:, sheet] + offset[:, sheet]
        stated = np.array(response)[:, None] * deviation[:, [sheet]]
        measured = (stated * tolerances + spread * noise[:, [sheet]])[:, 0]
        rows.append(_row(sheet, dict(zip(names, measured.tolist(), strict=True))))
        if damping is None or sheet < due:
            continue
        given = corrections_of(rows[-40:], since_sheet=0 if every else since, damping=min(damping, 1.0))
        applied = [one for one in given if one.offset]
        for one in applied:
            amount = one.offset * damping / min(damping, 1.0)
            at = names.index(one.channel.name)
            offset[at, sheet + DELAY :] += amount / CHANNELS[one.channel.name][0]
            offsets[one.channel.name].append(amount)
        if applied:
            since = sheet + DELAY
        due = (sheet if every or not applied else since) + wait
    return LoopRun(deviation=deviation, offsets=offsets)


def loops(
    seed: int,
    runs: int,
    *,
    response: tuple[float, float] = (1.0, 1.0),
    progress: Callable[[str], None] = lambda _step: None,
) -> list[Loop]:
    """Return the figures without corrections, with those of the product, and with rules that are known to be wrong.

    response: as in ``loop_run``, of the product's rule; the others see deviations in full.
    """
    full, fewer = (1.0, 1.0), max(runs // 5, 1)
    rules: list[tuple[str, float | None, int | None, tuple[float, float], int]] = [
        ("no corrections", None, None, full, runs),
        ("as offered", 0.5, None, response, runs),
        ("as offered, if deviations were recorded in full", 0.5, None, full, fewer),
        ("the same, undamped", 1.0, None, full, fewer),
        ("the same, every 3 sheets without waiting", 1.0, 3, full, fewer),
    ]
    figures, open_waste = [], list[float]()
    for rule, damping, every, share, count in rules:
        progress(f"closed loop: {rule}, {count} runs")
        done = [loop_run(seed, run, damping=damping, every=every, response=share) for run in range(count)]
        waste = [one.waste for one in done]
        open_waste = open_waste or waste
        figures.append(
            Loop(
                rule=rule,
                damping=damping or 0.0,
                runs=count,
                waste=float(np.mean(waste)),
                corrections=float(np.mean([sum(map(len, one.offsets.values())) for one in done])),
                oscillating=sum(one.oscillates for one in done),
                worse=sum(own > other for own, other in zip(waste, open_waste, strict=False)),
            )
        )
    return figures


def swings(deviation: NDArray[np.float64]) -> int:
    """Count how often a channel (sheets,) goes from beyond one tolerance to beyond the other.

    >>> swings(np.array([0.0, 1.2, 1.3, -0.5, -1.1, 0.0, -1.4, 1.5]))
    2
    """
    beyond = np.sign(deviation[np.abs(deviation) > 1])
    return int((np.diff(beyond) != 0).sum())


_GOOD: Final = Verdict(page="p", verdict="good")


def _row(sheet: int, amounts: dict[str, float]) -> PageRecord:
    return PageRecord(
        sheet=sheet,
        job_page=sheet,
        verdict=_GOOD,
        late=False,
        first_line=sheet,
        time_s=0.2 * sheet,
        nuisance=amounts,
    )

"""What the ink study finds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from prooflight.inks.selection import Score


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelRow:
    """One model on the whole chart."""

    model: str
    score: Score
    fit_cpu_s: float
    predict_17_cpu_s: float
    """CPU time for 17^4 = 83,521 recipes."""
    predict_33_cpu_s: float
    """CPU time for 33^4 = 1,185,921 recipes."""
    lowest: float
    highest: float
    """Reflectance on the 17^4 grid. [-]"""
    rise: float
    """Greatest rise of any band from one grid node to the next with more of one ink. [-]"""
    beyond_limit_delta_e00: float
    """Largest error on recipes beyond 300 % ink when none of them was learned from."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LearningRow:
    """One model taught by some well-chosen patches, judged on all others."""

    model: str
    patches: int
    noise_delta_e00: float
    median_delta_e00: float
    p95_delta_e00: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SpreadRow:
    """Are the standard deviations right? Errors on unseen recipes over their predicted standard deviation."""

    patches: int
    rms: float
    within_1: float
    within_2: float


@dataclass(frozen=True, slots=True, kw_only=True)
class InkStudy:
    """Everything the result page shows."""

    chart: str
    digest: str
    patches: int
    recipes: int
    folds: int
    measured_rise: float
    """Greatest rise between measured recipes that differ in more of one ink alone. [-]"""
    models: tuple[ModelRow, ...]
    learning: tuple[LearningRow, ...]
    noise_median_delta_e00: float
    """Median of the added noise; its mean is ``LearningRow.noise_delta_e00``."""
    spread: tuple[SpreadRow, ...]

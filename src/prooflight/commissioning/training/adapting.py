"""Adaptation of the ranking to a press: shift and scale of its statistics, from its own good pages.

Properties of one press alone (a cloudy paper, a lamp that ripples, looser register) move some statistics and
leave the others. Each statistic is standardised again by the press's good pages, so that their usual
deviations count for nothing and all others as before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.commissioning.training.learn import LEAST_SCALE, Pages, certain_score, shift_and_scale
from prooflight.detectors.false_alarm_rate import GoodScores, ReferenceScores
from prooflight.detectors.matched_filter.calibrated import CalibratedDetector, GoodPages

if TYPE_CHECKING:
    from prooflight.detectors.matched_filter.model import DetectorModel

LEAST_EXACT: Final = 0.1
"""``LEAST_SCALE`` where good prints are exact: there hardly anything scatters. (assumed)"""
LEAST_REAL: Final = 0.7
"""``LEAST_SCALE`` of a press that is trained on real pages. (chosen of 0.5 to 1, decision 23)

Where its own noise drowns a statistic (cloudy paper), the greatest of many places scatters less than
elsewhere, and the full scale would make the press careful.
"""
FOLDS: Final = 5


def adapted(model: DetectorModel, good: Pages, *, real: bool = False) -> DetectorModel:
    """Return the model with shift and scale of every statistic by this press's good pages (``shift_and_scale``).

    Of pages of several worlds (``Pages.press``) they cover each world's (``covering``). real: they are real pages, so
    that a press's scale may also be smaller than others'.
    """
    plain = replace(model, shift=np.zeros_like(model.shift), scale=np.ones_like(model.scale))
    deviations = plain.deviations(good.values, good.page_features)
    least = LEAST_REAL if real else LEAST_SCALE
    if model.residual_variance.exact:
        least = LEAST_EXACT
    worlds = [good.press == world for world in np.unique(good.press)] or [np.zeros(0, bool)]
    shift, scale = covering([shift_and_scale(deviations[world], least_scale=least) for world in worlds])
    return replace(model, shift=shift, scale=scale)


def covering(
    worlds: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the shift and scale that cover several worlds: their mean, and the rms about it in the worst one.

    So statistics deviate by no more than 1 (rms) in any world. worlds: shift and scale of each, (statistics,); those of
    one world are returned as they are.
    """
    if len(worlds) == 1:
        return worlds[0]
    shifts, scales = (np.stack(part) for part in zip(*worlds, strict=True))
    shift = shifts.mean(axis=0)
    return shift, np.hypot(scales, shifts - shift).max(axis=0)


def fit_for(
    model: DetectorModel,
    references: ReferenceScores,
    good: Pages,
    another: NDArray[np.bool_],
    *,
    false_alarm_rate: float,
    misprint_rate: float,
    real: bool = False,
    glyphs: NDArray[np.float64] | None = None,
) -> CalibratedDetector:
    """Adapt a ranking to the press of these good pages, with the false-alarm rate that they and the others allow.

    Of simulated pages each design counts once, of real ones each page: copies of a design count, but none is
    scored by a model that was adapted by another copy. Pages of several worlds (``Pages.press``) are compared with the
    others world by world, and the greatest threshold applies, so that each world keeps the rate.

    model: not adapted to any press, or to this one by other pages; references: its scores of the pages that
    trained it. another: whether a scan showed another page. glyphs: score of each page's glyphs
    (``ScoredPage.score``); None: they were not scored.
    """
    scores = own_scores(model, good, another, real=real)
    design = np.arange(scores.size) if real else good.design
    worlds = [good.press == world for world in np.unique(good.press)]
    deciding = (
        [GoodScores.of(scores[world], design[world]) for world in worlds] if len(worlds) > 1 else [None]
    )
    by_world = partial(
        CalibratedDetector.calibrated,
        adapted(model, good, real=real),
        GoodScores.of(scores, design),
        references=references,
        pages=GoodPages(
            values=good.values,
            page_features=good.page_features,
            glyphs=np.zeros(0) if glyphs is None else glyphs,
        ),
        false_alarm_rate=false_alarm_rate,
        misprint_rate=misprint_rate,
        real=scores.size if real else 0,
    )
    return max((by_world(deciding=one) for one in deciding), key=lambda detector: detector.threshold)


def own_scores(
    model: DetectorModel, good: Pages, another: NDArray[np.bool_], *, real: bool = False
) -> NDArray[np.float64]:
    """Return cross-validated scores of a press's good pages, (pages,), in ``FOLDS`` parts by design."""
    turn = np.unique(good.design, return_inverse=True)[1] % FOLDS
    scores = np.empty(len(turn))
    for index in range(FOLDS):
        mine = turn == index
        if mine.any():
            others = adapted(model, good.rows(~mine), real=real)
            scores[mine] = certain_score(others, good.rows(mine), another[mine])
    return scores

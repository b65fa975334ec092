"""What good pages and misprints teach, on statistics drawn from known distributions."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.commissioning.training.adapting import adapted
from prooflight.commissioning.training.learn import (
    LEAST_PLACES,
    Pages,
    fitted_forest,
    learn_model,
    learn_scatter,
    widest,
)
from prooflight.detectors.matched_filter.model import DetectorModel
from prooflight.detectors.matched_filter.statistics.local_evidence import (
    MODES,
    SCATTER_SHAPES,
    SIZES,
    Scatter,
    assumed_light,
)
from prooflight.detectors.print_prior import PrintPrior

if TYPE_CHECKING:
    from numpy.typing import NDArray

NAMES = ["box/add-C+/8", "box/add-C-/8", "streak/void/1/full", "ghost/C/0", "place/skew"]


def drawn(designs: int, seed: int, *, copies: int = 2, times: float = 6.0) -> Pages:
    """Statistics that grow with the first number of a page's features; of misprints one is so many times as great."""
    rng = np.random.default_rng(seed)
    design = np.repeat(np.arange(designs), copies)
    page_features = np.repeat(rng.standard_normal((designs, 3)), copies, axis=0)
    bad = np.arange(design.size) % copies == 1
    values = np.exp(page_features[:, :1] + 0.2 * rng.standard_normal((design.size, len(NAMES))))
    values[np.flatnonzero(bad), rng.integers(len(NAMES), size=bad.sum())] *= times
    kind = np.where(bad, "misprint", "")
    return Pages(
        values=values.astype(np.float32),
        page_features=page_features,
        design=design,
        kind=kind,
        press=np.zeros(design.size, np.int64),
    )


def area_under_roc(score: np.ndarray, bad: np.ndarray) -> float:
    """The probability that a misprint scores higher than a good page; ties count half."""
    higher = np.sign(score[bad][:, None] - score[~bad])
    return float((higher.mean() + 1) / 2)


@pytest.fixture(scope="module")
def found() -> DetectorModel:
    rng = np.random.default_rng(2)
    return learn_model(drawn(300, 1), names=NAMES, scatter=Scatter.white(), rng=rng, trees=40)


def test_a_page_is_judged_against_pages_like_it(found: DetectorModel) -> None:
    pages = drawn(400, 5)
    plain = pages.values.max(axis=1)
    evidence = found.guard(found.family_evidence(found.deviations(pages.values, pages.page_features)))
    ranked = found.score(pages.values, pages.page_features)
    assert area_under_roc(evidence, pages.bad) > 0.97 > area_under_roc(plain, pages.bad)
    assert area_under_roc(ranked, pages.bad) > 0.94


def test_family_evidence_is_a_p_value_on_other_good_pages(found: DetectorModel) -> None:
    pages = drawn(2000, 6)
    good = pages.rows(~pages.bad)
    evidence = found.family_evidence(found.deviations(good.values, good.page_features))
    for p in (0.1, 0.02):
        share = (evidence > -np.log10(p)).mean(axis=0)
        # 300 learning pages: a share of p is known to about sqrt(p / 300), three of which are allowed
        assert (np.abs(share - p) < 3 * np.sqrt(p / 300) + 0.02).all()


def test_no_page_is_better_for_being_further_out_whatever_misprints_looked_like(found: DetectorModel) -> None:
    pages = drawn(400, 10)
    good = pages.rows(~pages.bad)
    scores = []
    for times in (1e2, 1e3, 1e4):
        values = good.values[:50].copy()
        values[:, :4] *= times
        scores.append(found.score(values, good.page_features[:50]))
    everyday = found.score(good.values, good.page_features)
    assert (scores[0] > np.quantile(everyday, 0.995)).all()
    assert (np.diff(scores, axis=0) >= 0).all()


def test_it_comes_back_from_its_arrays_and_facts(found: DetectorModel) -> None:
    again = DetectorModel.from_parts(found.arrays(), found.facts())
    pages = drawn(20, 9)
    assert np.array_equal(
        again.score(pages.values, pages.page_features), found.score(pages.values, pages.page_features)
    )


def scatter_draws(count: int) -> dict[str, NDArray[np.float64]]:
    """Of nothing, in the shapes of every draw."""
    return {name: np.full((*shape, count, 3), np.nan) for name, shape in SCATTER_SHAPES.items()}


def test_scatter_tells_noise_from_edges_and_tolerance() -> None:
    rng = np.random.default_rng(4)
    power = 10 ** rng.uniform(0, 4, 60_000)
    edges = power * rng.uniform(0, 1, power.size)
    variance = 1.5 * (power - edges) + 6 * edges + 1e-3 * power**2
    samples = scatter_draws(power.size)
    samples["boxes"][MODES.index("add-C"), 2] = np.stack(
        [rng.standard_normal(power.size) * np.sqrt(variance), power, edges], axis=-1
    )
    scatter = learn_scatter(samples)
    # A class's greatest half per cent is left out, which takes 5 % off a normal variance.
    assert scatter.boxes[MODES.index("add-C"), 2] == pytest.approx([1.5, 6, 1e-3], rel=0.3)
    assert scatter.boxes[MODES.index("add-C"), 3].tolist() == [1, 1, 0]  # nothing was drawn
    assert scatter.light.tolist() == assumed_light(PrintPrior()).tolist()


def light_draws(sd: float, rng: np.random.Generator, *, of_edges: float = 0.0) -> NDArray[np.float64]:
    """4000 boxes in which all light moves by ``sd``, and noise of what they know of it: to 0.1 % and better."""
    power = 10 ** rng.uniform(6, 7, 4000)
    own = power * sd * rng.standard_normal(4000) + np.sqrt(power) * rng.standard_normal(4000)
    return np.stack([own, power, of_edges * power], axis=-1)


def test_what_moves_all_light_alike_is_learned_away_from_edges() -> None:
    """Seed 6: of 4000 boxes a standard deviation is known to 1.1 %; a size each."""
    rng, samples = np.random.default_rng(6), scatter_draws(4000)
    light = samples["boxes"][MODES.index("light")]
    light[0] = light_draws(0.02, rng)
    light[1] = light_draws(0.006, rng)
    light[1, ::2] = light_draws(0.5, rng, of_edges=0.9)[::2]  # what edges do is left out
    light[2] = light_draws(0.0005, rng)
    light[3, : LEAST_PLACES - 1] = light_draws(0.02, rng)[: LEAST_PLACES - 1]
    found = learn_scatter(samples).light
    assert found[:2] == pytest.approx([0.02, 0.006], rel=0.06)
    assert found[2:].tolist() == assumed_light(PrintPrior())[2:].tolist()  # hardly anything, few draws, none
    assert found.size == len(SIZES)


def test_boxes_that_know_little_of_the_light_say_little_of_how_it_moves() -> None:
    """Half of them are noise of 0.1, which is not what the light does."""
    rng, samples = np.random.default_rng(7), scatter_draws(4000)
    drawn_ = light_draws(0.01, rng)
    power = np.full(2000, 100.0)
    drawn_[::2] = np.stack([np.sqrt(power) * rng.standard_normal(2000), power, 0 * power], axis=-1)
    samples["boxes"][MODES.index("light"), 5] = drawn_
    assert learn_scatter(samples).light[5] == pytest.approx(0.01, rel=0.06)


def test_the_widest_scatter_covers_each() -> None:
    quiet, loud = Scatter.white(), Scatter.white()
    loud.boxes[0, 0] = 4.0, 0.5, 0.1
    loud.light[2] *= 3
    both = widest([quiet, loud])
    assert both.boxes[0, 0].tolist() == [4.0, 1.0, 0.1]
    assert both.light[2] == loud.light[2]
    np.testing.assert_array_equal(both.streaks, quiet.streaks)


def test_each_press_is_compared_with_its_own_good_pages() -> None:
    """Two presses, one out in every statistic by twice what misprints are: that is no evidence of a misprint.

    Seed 11. As if of one press, what is out is what good pages of the other do.
    """
    first, second = drawn(300, 1, times=2), drawn(300, 2, times=2)
    out = replace(second, values=second.values * 4)
    scores = []
    for number in (1, 0):
        both = first.joined(replace(out, press=np.full(600, number)))
        taught = learn_model(
            both, names=NAMES, scatter=Scatter.white(), rng=np.random.default_rng(11), trees=40
        )
        pages = drawn(400, 5, times=2)
        score = adapted(taught, pages.rows(~pages.bad)).score(pages.values, pages.page_features)
        scores.append(area_under_roc(score, pages.bad))
    own, mixed = scores
    assert own > 0.9
    assert mixed < 0.6


def test_a_forest_ranks_what_no_single_column_can() -> None:
    rng = np.random.default_rng(3)
    x = rng.standard_normal((1500, 6))
    bad = x[:, 0] * x[:, 1] > 0
    forest = fitted_forest(x[:1000], bad[:1000], np.ones(1000), rng=rng, trees=80, column_share=1.0)
    assert area_under_roc(forest.score(x[1000:]), bad[1000:]) > 0.9

from __future__ import annotations

import importlib.util
import itertools
import json
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import special
from tests.detectors.paper.windows import window_means

from prooflight.detectors.paper.bayes import BayesDetector, BayesianNetwork, window_statistics, window_unit
from prooflight.detectors.paper.evidence import INTERVALS, Evidence

LABELS = np.array(["correct", "global", "local"])
RATE = 0.01


def pages(rng: np.random.Generator, count: int = 300, sensors: int = 2) -> tuple[np.ndarray, list[str]]:
    """Statistics (count, 3 sensors) whose means differ by type, and their labels."""
    kinds = rng.integers(3, size=count)
    centre = np.array([[0.0] * 3 * sensors, [2.0] * 3 * sensors, [0.0, -2.0, 1.0] * sensors])
    return rng.normal(centre[kinds], 1.0), LABELS[kinds].tolist()


def test_counts_and_smoothing_in_closed_form() -> None:
    # one statistic, two bins parted at 5: correct 3 below and 1 above; misprints 0 below and 2 above
    statistics = np.array([[1.0], [2.0], [3.0], [9.0], [8.0], [9.0]])
    labels = ["correct"] * 4 + ["misprint"] * 2
    network = BayesianNetwork.learn(statistics, labels, misprint_rate=0.2, bins=2, binning="equal-width")
    np.testing.assert_allclose(network.edges, [[5.0]])
    np.testing.assert_allclose(np.exp(network.log_likelihood[:, 0]), [[4 / 6, 2 / 6], [1 / 4, 3 / 4]])
    above = 0.2 * 3 / 4 / (0.2 * 3 / 4 + 0.8 * 2 / 6)
    below = 0.2 * 1 / 4 / (0.2 * 1 / 4 + 0.8 * 4 / 6)
    np.testing.assert_allclose(
        network.posterior(np.array([[7.0], [5.0], [1e9], [-1e9]])), [above] * 3 + [below]
    )


def test_quantile_bins_hold_equally_many_learning_pages() -> None:
    statistics, labels = pages(np.random.default_rng(1), 320)
    network = BayesianNetwork.learn(statistics, labels, misprint_rate=RATE, bins=16)
    for edges, column in zip(network.edges, statistics.T, strict=True):
        counts = np.bincount(np.searchsorted(edges, column, side="right"), minlength=16)
        assert counts.min() >= 19
        assert counts.max() <= 21


def by_enumeration(network: BayesianNetwork, place: np.ndarray) -> float:
    """P(misprint | bins) from the joint distribution of all variables, written out."""
    types = len(network.types)
    prior = np.append(1 - network.misprint_rate, network.misprint_rate * np.exp(network.log_type_share))
    conditional = np.exp(network.log_likelihood)
    bins = conditional.shape[2]
    joint = np.zeros((types, *[bins] * place.size))
    for kind in range(types):
        for cell in itertools.product(range(bins), repeat=place.size):
            joint[(kind, *cell)] = prior[kind] * np.prod(
                [conditional[kind, n, at] for n, at in enumerate(cell)]
            )
    assert joint.sum() == pytest.approx(1)
    seen = joint[(slice(None), *place)]
    return float(seen[1:].sum() / seen.sum())


@pytest.mark.parametrize("one_type", [False, True])
def test_posterior_is_that_of_the_joint_distribution_written_out(one_type: bool) -> None:
    rng = np.random.default_rng(3)
    statistics, labels = pages(rng, 200, sensors=1)
    if one_type:
        labels = ["correct" if label == "correct" else "misprint" for label in labels]
    network = BayesianNetwork.learn(statistics, labels, misprint_rate=RATE, bins=4)
    for values in statistics[:30]:
        place = np.array(
            [np.searchsorted(edges, v, side="right") for edges, v in zip(network.edges, values, strict=True)]
        )
        assert network.posterior(values) == pytest.approx(by_enumeration(network, place), rel=1e-9)


def test_posterior_is_pgmpys() -> None:
    if importlib.util.find_spec("pgmpy") is None:
        pytest.skip("needs pgmpy, a referee that the package itself does not use")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of pgmpy's own making
        from pgmpy.factors.discrete import TabularCPD
        from pgmpy.inference import VariableElimination
        from pgmpy.models import DiscreteBayesianNetwork

        statistics, labels = pages(np.random.default_rng(5))
        network = BayesianNetwork.learn(statistics, labels, misprint_rate=RATE, bins=8)
        count = statistics.shape[1]
        # the paper's figure: M <- Mt -> f; as factors, P(M) and P(Mt | M) with "correct" certain where M is false
        of_type = np.zeros((3, 2))
        of_type[0, 0] = 1
        of_type[1:, 1] = np.exp(network.log_type_share)
        names = [f"f{n}" for n in range(count)]
        referee = DiscreteBayesianNetwork([("M", "Mt"), *(("Mt", name) for name in names)])
        referee.add_cpds(
            TabularCPD("M", 2, [[1 - RATE], [RATE]]),
            TabularCPD("Mt", 3, of_type, evidence=["M"], evidence_card=[2]),
            *(
                TabularCPD(
                    name, 8, np.exp(network.log_likelihood[:, n]).T, evidence=["Mt"], evidence_card=[3]
                )
                for n, name in enumerate(names)
            ),
        )
        inference = VariableElimination(referee)
        for values in statistics[:40]:
            seen = {
                name: int(np.searchsorted(network.edges[n], values[n], side="right"))
                for n, name in enumerate(names)
            }
            told = inference.query(["M"], evidence=seen, show_progress=False).values[1]
            assert network.posterior(values) == pytest.approx(told, rel=1e-6)


def test_nothing_learned_leaves_the_misprint_rate() -> None:
    statistics = np.zeros((6, 2))  # nothing to tell pages apart by
    network = BayesianNetwork.learn(
        statistics, ["correct", "global", "local"] * 2, misprint_rate=0.03, bins=4
    )
    assert network.posterior(np.zeros(2)) == pytest.approx(0.03)


@given(
    seed=st.integers(0, 1000), bins=st.integers(2, 24), binning=st.sampled_from(["quantile", "equal-width"])
)
def test_posteriors_are_probabilities_and_follow_the_pages(seed: int, bins: int, binning: str) -> None:
    rng = np.random.default_rng(seed)
    statistics, labels = pages(rng, 60)
    before = statistics.copy()
    network = BayesianNetwork.learn(
        statistics,
        labels,
        misprint_rate=RATE,
        bins=bins,
        binning=binning,  # type: ignore[arg-type]
    )
    told = network.posterior(statistics)
    assert ((told > 0) & (told < 1)).all()
    order = rng.permutation(len(statistics))
    np.testing.assert_array_equal(network.posterior(statistics[order]), told[order])
    # nor does the order in which pages are learned matter
    again = BayesianNetwork.learn(
        statistics[order],
        [labels[n] for n in order],
        misprint_rate=RATE,
        bins=bins,
        binning=binning,  # type: ignore[arg-type]
    )
    np.testing.assert_allclose(again.posterior(statistics), told, rtol=1e-12)
    np.testing.assert_array_equal(statistics, before)


@pytest.mark.parametrize("reading", ["signed", "absolute"])
@pytest.mark.parametrize("binning", ["quantile", "equal-width"])
@given(power=st.integers(-3, 3), seed=st.integers(0, 100))
def test_a_sigma_wrong_by_any_factor_changes_no_verdict_after_learning(
    reading: str, binning: str, power: int, seed: int
) -> None:
    """Equation 4. Powers of two, so that rounding cannot push a page over an edge; the unit is learned as well."""
    rng = np.random.default_rng(seed)
    z = rng.standard_normal((30, 2, 24, 16)).astype(np.float32)
    z[15:, :, :8] += rng.uniform(-0.5, 0.5, (15, 1, 1, 1)).astype(np.float32)
    labels = ["correct"] * 15 + ["misprint"] * 15

    def verdicts(errors: np.ndarray) -> np.ndarray:
        means = window_means(errors, side=4)
        unit = window_unit(means[:15]).mean(axis=0)
        statistics = window_statistics(means, reading=reading, unit=unit).reshape(30, -1)  # type: ignore[arg-type]
        network = BayesianNetwork.learn(
            statistics,
            labels,
            misprint_rate=0.3,
            bins=4,
            binning=binning,  # type: ignore[arg-type]
        )
        return network.posterior(statistics)

    np.testing.assert_allclose(verdicts(z * np.float32(2.0**power)), verdicts(z), rtol=1e-12)


def test_it_survives_its_own_parts() -> None:
    statistics, labels = pages(np.random.default_rng(2))
    network = BayesianNetwork.learn(statistics, labels, misprint_rate=RATE)
    detector = BayesDetector(network=network, threshold=0.1, unit=np.ones(1), reading="absolute")
    again = BayesDetector.from_parts(detector.arrays(), json.loads(json.dumps(detector.facts())))
    assert again.network.types == network.types == ("correct", "global", "local")
    assert again.facts() == detector.facts()
    np.testing.assert_array_equal(again.network.posterior(statistics), network.posterior(statistics))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"labels": ["correct"] * 4}, "misprints"),
        ({"labels": ["global"] * 4}, "correct pages"),
        ({"labels": ["correct", "global"]}, "label a page"),
        ({"statistics": np.array([[0.0], [1.0], [np.nan], [2.0]])}, "finite"),
        ({"bins": 1}, "bins"),
        ({"misprint_rate": 1.0}, "misprint_rate"),
    ],
)
def test_what_cannot_be_learned_is_said(change: dict[str, object], message: str) -> None:
    good: dict[str, object] = {
        "statistics": np.arange(4.0)[:, None],
        "labels": ["correct", "correct", "global", "local"],
        "misprint_rate": RATE,
    }
    with pytest.raises(ValueError, match=message):
        BayesianNetwork.learn(**(good | change))  # type: ignore[arg-type]


def test_other_statistics_than_learned_are_refused() -> None:
    statistics, labels = pages(np.random.default_rng(2), sensors=2)
    network = BayesianNetwork.learn(statistics, labels, misprint_rate=RATE)
    with pytest.raises(ValueError, match="learned from 6 statistics, got 3"):
        network.posterior(statistics[:, :3])


def test_as_a_detector_it_tells_good_prints_from_shifted_ones() -> None:
    rng = np.random.default_rng(4)
    z = rng.standard_normal((60, 1, 80, 80)).astype(np.float32)
    z[30:, :, 20:60] -= 0.4  # darker than expected
    means = window_means(z, side=8)
    labels = ["correct"] * 30 + ["misprint"] * 30
    network = BayesianNetwork.learn(
        window_statistics(means).reshape(60, 3), labels, misprint_rate=RATE, bins=8
    )
    detector = BayesDetector(network=network, threshold=0.1, unit=np.ones(1))
    for page, label in zip(means, labels, strict=True):
        found = Evidence(
            tile_histogram=np.ones((1, 1, 1, INTERVALS), np.int64),
            naive_histogram=np.ones((1, INTERVALS), np.int64),
            block_z=page,
        )
        told = detector.decide(found)
        assert told.misprint is (label == "misprint")
        assert told.misprint is (told.probability > 0.1)
        assert told.score == pytest.approx(float(special.logit(told.probability)))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_in_no_bin_is_no_good_page(value: float) -> None:
    statistics, labels = pages(np.random.default_rng(2), sensors=1)
    network = BayesianNetwork.learn(statistics, labels, misprint_rate=RATE, bins=8)
    detector = BayesDetector(network=network, threshold=0.1, unit=np.ones(1))
    block_z = np.zeros((1, 10, 10), np.float32)
    block_z[0, 3, 4] = value
    found = Evidence(
        tile_histogram=np.ones((1, 1, 1, INTERVALS), np.int64),
        naive_histogram=np.ones((1, INTERVALS), np.int64),
        block_z=block_z,
    )
    assert detector.decide(found).verdict_name == "not-inspected"


def test_a_quantile_edge_is_a_value_that_was_seen_and_belongs_to_the_bin_above() -> None:
    """Half of four values lies below any number between 1 and 2: the edge is 2, whatever the scale between them."""
    statistics = np.array([[0.0], [1.0], [2.0], [10.0]])
    labels = ["correct", "correct", "misprint", "misprint"]
    network = BayesianNetwork.learn(statistics, labels, misprint_rate=0.5, bins=2)
    assert network.edges.tolist() == [[2.0]]
    below, above = network.posterior(np.array([[np.nextafter(2, 0)], [2.0]]))
    assert (below, above) == pytest.approx((0.25, 0.75))


def test_a_pages_score_and_threshold_are_log_odds() -> None:
    """Three statistics of two bins each, parted at 0, each 3 to 1 for a misprint above; one misprint in five."""
    of_bin = np.log([[0.75, 0.25], [0.25, 0.75]])
    network = BayesianNetwork(
        types=("correct", "misprint"),
        edges=np.zeros((3, 1)),
        log_likelihood=np.repeat(of_bin[:, None], 3, axis=1),
        log_type_share=np.zeros(1),
        misprint_rate=0.2,
        binning="quantile",
    )
    found = Evidence(
        tile_histogram=np.ones((1, 1, 1, INTERVALS), np.int64),
        naive_histogram=np.ones((1, INTERVALS), np.int64),
        block_z=np.full((1, 10, 10), 0.5, np.float32),  # mean and least 0.5, all below 0.675
    )
    odds = 3**3 * 0.2 / 0.8
    for threshold, alarms in ((0.1, True), (0.87, True), (0.88, False)):
        told = BayesDetector(network=network, threshold=threshold, unit=np.ones(1)).decide(found)
        assert told.score == pytest.approx(np.log(odds))
        assert told.probability == pytest.approx(odds / (1 + odds))  # 0.871
        assert told.threshold == pytest.approx(np.log(threshold / (1 - threshold)))
        assert told.misprint is alarms

"""What holds for every detector: it changes nothing that it is given, and a page's verdict is the page's own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.properties.squares import SENSORS, pages

from prooflight.detectors.paper.bayes import BayesDetector, BayesianNetwork, window_statistics
from prooflight.detectors.paper.chi_square import ChiSquare
from prooflight.detectors.paper.evidence import Evidence, gather

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.detectors.paper.evidence import EvidenceDetector


def evidence_of(page: tuple[np.ndarray, np.ndarray, np.ndarray]) -> Evidence:
    evidence = gather(*page, top_codes_dn=[4095] * SENSORS, seed=1, threads=1)
    for name in ("tile_histogram", "block_z"):
        getattr(evidence, name).setflags(write=False)
    return evidence


@pytest.fixture(scope="module")
def network() -> BayesianNetwork:
    learned = [evidence_of(page) for page in pages(99, 16)]
    statistics = np.stack([window_statistics(one.block_z).ravel() for one in learned])
    labels = ["correct" if number % 2 == 0 else "misprint" for number in range(16)]
    return BayesianNetwork.learn(statistics, labels, misprint_rate=0.1, bins=4)


@pytest.fixture(scope="module", params=["chi-square", "chi-square of the page", "bayes"])
def detector(request: pytest.FixtureRequest, network: BayesianNetwork) -> EvidenceDetector:
    made: dict[str, Callable[[], EvidenceDetector]] = {
        "chi-square": lambda: ChiSquare(good_pages_per_false_alarm=100, misprint_rate=0.01),
        "chi-square of the page": lambda: ChiSquare(
            good_pages_per_false_alarm=100, misprint_rate=0.01, tiles=False
        ),
        "bayes": lambda: BayesDetector(network=network, threshold=0.5, unit=np.ones(SENSORS)),
    }
    return made[request.param]()


@settings(max_examples=8)
@given(seed=st.integers(0, 1000), order=st.permutations(range(5)))
def test_permuting_pages_permutes_verdicts_and_changes_no_input(
    detector: EvidenceDetector, seed: int, order: list[int]
) -> None:
    evidence = [evidence_of(page) for page in pages(seed)]
    told = [detector.decide(one) for one in evidence]
    assert [detector.decide(evidence[place]) for place in order] == [told[place] for place in order]

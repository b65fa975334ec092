"""The study sets the digits of the paper beside those of Prooflight."""

import pytest
from tests.paper.printed_tables import ALPHAS, ROWS, values

from prooflight.detectors.cost import RunningCosts
from prooflight_studies.harness.operating import bill
from prooflight_studies.paper.results import ALPHAS as STUDIED_ALPHAS
from prooflight_studies.paper.results import PRINTED


def test_the_study_sets_the_same_digits_beside_ours() -> None:
    studied = {title: printed for title, (_, printed) in PRINTED.items()}
    assert list(studied.values()) == list(ROWS.values())
    assert pytest.approx(ALPHAS) == STUDIED_ALPHAS


def test_section_5_2_with_its_own_numbers_saves_two_thirds_of_what_misprints_cost() -> None:
    told = bill(RunningCosts(), values("T1: 1 sensor")[2])
    assert told.without == pytest.approx(10.0)  # 100 misprints of 10,000 pages at 0.1 cent
    assert told.with_system / told.without == pytest.approx(0.334, abs=0.002)

"""The study sets the digits of the paper beside those of Prooflight."""

import numpy as np
import pytest

from prooflight.detectors.cost import RunningCosts
from prooflight_studies.harness.operating import bill
from prooflight_studies.paper.results import ALPHAS as STUDIED_ALPHAS
from prooflight_studies.paper.results import PRINTED

ALPHAS = (0.001, 0.01, 0.1, 1.0, 10.0, 100.0)


ROWS = {
    "T1: 1 sensor": ("3.4e-4", "0.0034", "0.0338", "0.1366", "0.3821", "1.0000"),
    "T2: 2 sensors": ("2e-5", "0.0002", "0.0020", "0.0204", "0.1562", "0.7809"),
    "T3: one misprint type modelled": ("6.7e-5", "6.7e-4", "0.0067", "0.0404", "0.3025", "1.0000"),
    "T4: 100 % noise": ("7.2e-5", "7.2e-4", "0.0072", "0.0545", "0.1802", "0.7760"),
    "T4: 200 % noise": ("1.1e-4", "0.0011", "0.0112", "0.0939", "0.4711", "0.8403"),
    "T4: 300 % noise": ("1.4e-4", "0.0014", "0.0137", "0.0869", "0.6157", "1.0000"),
    "T4: 400 % noise": ("3.3e-4", "0.0033", "0.0326", "0.2811", "0.9730", "1.0000"),
}


def values(row: str) -> np.ndarray:
    return np.array([float(text) for text in ROWS[row]])


def test_the_study_sets_the_same_digits_beside_ours() -> None:
    studied = {title: printed for title, (_, printed) in PRINTED.items()}
    assert list(studied.values()) == list(ROWS.values())
    assert pytest.approx(ALPHAS) == STUDIED_ALPHAS


def test_section_5_2_with_its_own_numbers_saves_two_thirds_of_what_misprints_cost() -> None:
    told = bill(RunningCosts(), values("T1: 1 sensor")[2])
    assert told.without == pytest.approx(10.0)  # 100 misprints of 10,000 pages at 0.1 cent
    assert told.with_system / told.without == pytest.approx(0.334, abs=0.002)

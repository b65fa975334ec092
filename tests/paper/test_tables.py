"""The paper's Tables 1 to 4 as printed, what the arithmetic of equations 6 and 7 asks of them, and their slips.

c is the least of F + alpha M over thresholds. A lower envelope of straight lines in alpha rises, is concave, and never
lies above always stopping (1) or never stopping (alpha). Printed digits obey that to half of the last one.
"""

from itertools import pairwise

import numpy as np
import pytest
from tests.paper.printed_tables import ALPHAS, ROWS, values

from prooflight.detectors.cost import RunningCosts
from prooflight.press.press_file import PressFile

A4_HEIGHT_MM = 297.0


def half_digits(row: str) -> np.ndarray:
    """Half of each value's last printed digit."""

    def last_digit(text: str) -> float:
        mantissa, _, exponent = text.partition("e")
        return 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))

    return np.array([last_digit(text) / 2 for text in ROWS[row]])


@pytest.mark.parametrize("row", ROWS)
def test_cost_rises_with_alpha(row: str) -> None:
    assert (np.diff(values(row)) > 0).all()


@pytest.mark.parametrize("row", ROWS)
def test_no_row_costs_more_than_always_or_never_stopping(row: str) -> None:
    assert (values(row) <= np.minimum(1.0, ALPHAS)).all()


@pytest.mark.parametrize("row", ROWS)
def test_cost_is_concave_in_alpha_as_far_as_the_digits_tell(row: str) -> None:
    c, error, alpha = values(row), half_digits(row), np.array(ALPHAS)
    run = np.diff(alpha)
    slope = np.diff(c) / run
    doubt = (error[1:] + error[:-1]) / run
    assert (slope[1:] - doubt[1:] <= slope[:-1] + doubt[:-1]).all()


@pytest.mark.parametrize("row", ROWS)
def test_up_to_alpha_0_1_cost_is_the_miss_rate_times_alpha(row: str) -> None:
    """c exactly linear: no false alarm was observed on 300 test pages, so F < 3 / 300 is all they say."""
    c, error, alpha = values(row)[:3], half_digits(row)[:3], np.array(ALPHAS)[:3]
    highest, lowest = ((c + error) / alpha).min(), ((c - error) / alpha).max()
    assert lowest <= highest  # one miss rate fits all three columns


def test_two_sensors_cost_less_than_one_in_every_column() -> None:
    assert (values("T2: 2 sensors") < values("T1: 1 sensor")).all()


def test_modelling_all_misprint_types_costs_less_than_one_of_them() -> None:
    assert (values("T2: 2 sensors") < values("T3: one misprint type modelled")).all()


def test_more_noise_costs_more_except_for_the_known_slip() -> None:
    inversions = []
    for percent, (less, more) in zip((200, 300, 400), pairwise(list(ROWS)[3:]), strict=True):
        for alpha, lower, higher in zip(ALPHAS, values(less), values(more), strict=True):
            if higher < lower:
                inversions.append((percent, alpha))
    assert inversions == [(300, 1.0)]  # slip: the 300 % row beats the 200 % row at alpha = 1


def test_slip_the_100_percent_row_is_not_table_2s_two_sensors() -> None:
    assert (values("T4: 100 % noise") != values("T2: 2 sensors")).all()
    # and not by rounding: they differ by a factor of 3.6 where no false alarm was seen
    assert values("T4: 100 % noise")[2] / values("T2: 2 sensors")[2] == pytest.approx(3.6, abs=0.1)


def test_slip_section_5_2_alpha_is_0_101_and_not_0_001() -> None:
    costs = RunningCosts(misprint_rate=0.01, false_alarm_cents=0.01, missed_misprint_cents=0.1)
    assert costs.alpha == pytest.approx(0.101, abs=5e-4)
    cents = {
        alpha: 10_000 * costs.cents_per_page(c)
        for alpha, c in zip(ALPHAS, values("T1: 1 sensor"), strict=True)
    }
    # the stated 3.4 cents for 10,000 pages come from the 0.1 column, and from no other
    assert cents[0.1] == pytest.approx(3.4, rel=0.02)
    for alpha in ALPHAS:
        if alpha != 0.1:
            assert cents[alpha] != pytest.approx(3.4, rel=0.5)


def test_slip_2770_lines_a_second_carry_one_page_a_second_and_not_five(prototype: PressFile) -> None:
    camera = prototype.camera()
    (sensor,) = camera.sensors
    pages_per_s = sensor.line_rate_hz * camera.pixel_pitch_mm / A4_HEIGHT_MM
    assert pages_per_s == pytest.approx(0.98, abs=0.01)
    # at five pages a second the page moves five pixels a line, and TDI smears stages x |ratio - 1|
    assert sensor.tdi_stages * abs(5 - 1) == 384
    # square pixels at that speed need five times the lines
    assert 5 * A4_HEIGHT_MM / camera.pixel_pitch_mm == pytest.approx(14_000, rel=0.01)

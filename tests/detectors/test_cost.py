import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.detectors.cost import RunningCosts

RATES = st.floats(1e-4, 0.999)
CENTS = st.floats(1e-4, 1e4)
SHARES = st.floats(0, 1)


def test_section_5_2_as_its_own_numbers_have_it() -> None:
    paper = RunningCosts()
    assert (paper.misprint_rate, paper.false_alarm_cents, paper.missed_misprint_cents) == (0.01, 0.01, 0.1)
    assert paper.alpha == pytest.approx(0.101, abs=5e-4)  # erratum: the paper prints 0.001
    assert 10_000 * paper.cents_per_page(0.0338) == pytest.approx(3.4, rel=0.02)


@given(rate=RATES, false_alarm=CENTS, miss=CENTS, f=SHARES, m=SHARES)
def test_equation_7_times_its_factor_is_equation_6(
    rate: float, false_alarm: float, miss: float, f: float, m: float
) -> None:
    costs = RunningCosts(misprint_rate=rate, false_alarm_cents=false_alarm, missed_misprint_cents=miss)
    spelt_out = (1 - rate) * false_alarm * f + rate * miss * m
    assert costs.cents_per_page(costs.normalised(false_alarms=f, misses=m)) == pytest.approx(
        spelt_out, rel=1e-9, abs=1e-300
    )


def test_always_alarming_costs_1_and_never_alarming_alpha() -> None:
    costs = RunningCosts(misprint_rate=0.3, false_alarm_cents=2, missed_misprint_cents=5)
    assert costs.normalised(false_alarms=1, misses=0) == 1
    assert costs.normalised(false_alarms=0, misses=1) == costs.alpha


@given(rate=RATES, false_alarm=CENTS, miss=CENTS, probability=SHARES)
def test_stopping_pays_where_its_expected_cost_is_the_lower(
    rate: float, false_alarm: float, miss: float, probability: float
) -> None:
    costs = RunningCosts(misprint_rate=rate, false_alarm_cents=false_alarm, missed_misprint_cents=miss)
    stop, let_pass = (1 - probability) * false_alarm, probability * miss
    assert costs.stopping_pays(probability) == (stop < let_pass)


@given(rate=RATES, false_alarm=CENTS, miss=CENTS)
def test_without_evidence_stopping_pays_when_misses_cost_more_than_false_alarms_altogether(
    rate: float, false_alarm: float, miss: float
) -> None:
    costs = RunningCosts(misprint_rate=rate, false_alarm_cents=false_alarm, missed_misprint_cents=miss)
    if abs(costs.alpha - 1) > 1e-9:
        assert costs.stopping_pays(rate) == (costs.alpha > 1)


@pytest.mark.parametrize("rate", [0.0, 1.0, -0.1, 1.1, float("nan")])
def test_the_misprint_rate_lies_between_0_and_1(rate: float) -> None:
    with pytest.raises(ValueError, match="misprint_rate must be between 0 and 1"):
        RunningCosts(misprint_rate=rate)


@pytest.mark.parametrize("field", ["false_alarm_cents", "missed_misprint_cents"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
def test_costs_are_above_0(field: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{field} must be above 0"):
        RunningCosts(**{field: value})


@given(rate=RATES, false_alarm=CENTS, miss=CENTS)
def test_from_the_stopping_probability_on_stopping_costs_less(
    rate: float, false_alarm: float, miss: float
) -> None:
    costs = RunningCosts(misprint_rate=rate, false_alarm_cents=false_alarm, missed_misprint_cents=miss)
    even = costs.stopping_probability
    expected = costs.expected_cents(even)
    assert expected["stop"] == pytest.approx(expected["accept"], rel=1e-6)
    assert not costs.stopping_pays(even * 0.999)
    assert costs.stopping_pays(1 - (1 - even) * 0.999)


def test_the_papers_costs_stop_at_one_in_eleven() -> None:
    assert RunningCosts().stopping_probability == pytest.approx(1 / 11)
    assert RunningCosts().expected_cents(0.25) == pytest.approx({"accept": 0.025, "stop": 0.0075})


def test_where_both_cost_the_same_the_press_goes_on() -> None:
    costs = RunningCosts(false_alarm_cents=1.0, missed_misprint_cents=1.0)
    assert not costs.stopping_pays(0.5)

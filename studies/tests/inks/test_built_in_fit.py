"""The built-in inks meet the aims of coated paper, and are what the fit gives."""

from pathlib import Path

import numpy as np
import pytest
from tests.stand_ins import others

from prooflight.inks.built_in import COEFFICIENTS, built_in_inks
from prooflight.spectra import delta_e00, lab
from prooflight_studies.ink.built_in_fit import COATED_AIMS, aim_differences, fit_built_in

MODEL = built_in_inks()


@pytest.mark.parametrize("aim", COATED_AIMS)
def test_solids_and_overprints_meet_the_coated_aims(aim: str) -> None:
    recipe, wanted = COATED_AIMS[aim]
    assert delta_e00(lab(MODEL.reflectance(np.array(recipe))), wanted) <= 4.0


def test_the_coefficients_are_what_the_fit_gives() -> None:
    # Another processor may stop the fit elsewhere in its flat valley, so colours are compared, not
    # coefficients; 0.3 is a third of a just noticeable difference.
    again = fit_built_in()
    assert max(aim_differences(again).values()) <= 4.0
    for aim, difference in aim_differences(dict(COEFFICIENTS)).items():
        assert difference == pytest.approx(aim_differences(again)[aim], abs=0.3), aim


@pytest.mark.parametrize("table", others("characterisation data")[:1])
def test_aims_and_tints_against_the_characterisation_data(table: Path) -> None:
    rows = [line.split() for line in table.read_text(encoding="latin-1").splitlines()]
    data = {}
    for row in rows:
        if len(row) == 11 and row[0].isdigit():
            data[tuple(float(value) for value in row[1:5])] = np.array([float(value) for value in row[8:11]])
    for recipe, wanted in COATED_AIMS.values():
        np.testing.assert_allclose(data[tuple(100.0 * ink for ink in recipe)], wanted, atol=0.005)
    single = [recipe for recipe in data if sum(ink > 0 for ink in recipe) == 1]
    predicted = lab(MODEL.reflectance(np.array(single) / 100))
    difference = delta_e00(predicted, [data[recipe] for recipe in single])
    # Fitted to solids only: 1.6 is what tvi alone gives, without it the median is 4.4.
    assert np.median(difference) < 2.5

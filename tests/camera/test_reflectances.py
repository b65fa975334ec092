"""Reflectances from JSON, good and bad."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from prooflight.camera.reflectances import parse_reflectances
from prooflight.errors import RequestError
from prooflight.spectra import WAVE_NM


def test_values_on_the_grid_come_through_unchanged() -> None:
    values = np.random.default_rng(1).random((3, 36))
    text = json.dumps({"wave_nm": WAVE_NM.tolist(), "reflectance": values.tolist()})
    np.testing.assert_array_equal(parse_reflectances(text, where="R.json"), values)


def test_other_wavelengths_are_interpolated_linearly() -> None:
    text = json.dumps({"wave_nm": [360, 555, 900], "reflectance": [[0.0, 1.0, 0.0], [1, 1, 1]]})
    got = parse_reflectances(text, where="R.json")
    want = np.where(WAVE_NM < 555, (WAVE_NM - 360) / 195, (900 - WAVE_NM) / 345)
    np.testing.assert_allclose(got, [want, np.ones(36)], rtol=1e-12)


GOOD: dict[str, Any] = {"wave_nm": [380, 730], "reflectance": [[0.5, 0.5]]}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is not JSON"),
        ("{", "is not JSON"),
        ("[1, 2]", "holds list"),
        ("{}", "holds dict"),
        (json.dumps({"wave_nm": [380, 730]}), "holds wave_nm"),
        (json.dumps(GOOD | {"name": "x"}), "and nothing else"),
        (json.dumps(GOOD | {"reflectance": [0.5, 0.5]}), "reflectance: is not 2-dimensional"),
        (json.dumps(GOOD | {"reflectance": []}), "reflectance: is not 2-dimensional"),
        (json.dumps(GOOD | {"reflectance": [[]]}), "reflectance: is not 2-dimensional"),
        (json.dumps(GOOD | {"reflectance": [[0.5, 0.5], [0.5]]}), "lists of different lengths"),
        (json.dumps(GOOD | {"reflectance": [["a", "b"]]}), "of numbers only"),
        (json.dumps(GOOD | {"reflectance": [[True, False]]}), "of numbers only"),
        (json.dumps(GOOD | {"reflectance": [[None, 1]]}), "of numbers only"),
        (json.dumps(GOOD | {"reflectance": [[0.5, float("nan")]]}), "not finite"),
        (json.dumps(GOOD | {"reflectance": [[0.5, float("inf")]]}), "not finite"),
        (json.dumps(GOOD | {"reflectance": [[0.1, 0.2, 0.3]]}), "3 values a patch, but 2 wavelengths"),
        (json.dumps(GOOD | {"reflectance": [[0.5, -0.1]]}), "-0.1 is not a reflectance factor"),
        (json.dumps(GOOD | {"reflectance": [[50, 85]]}), "85 is not a reflectance factor"),
        (json.dumps(GOOD | {"wave_nm": [730, 380]}), "must increase"),
        (json.dumps(GOOD | {"wave_nm": [400, 700]}), "380..730 nm is needed"),
        (json.dumps(GOOD | {"wave_nm": 380}), "wave_nm: is not 1-dimensional"),
        ("[" * 100_000, "is not JSON"),
        (
            '{"wave_nm": [380, ' + "9" * 100_000 + '], "reflectance": [[0.5, 0.5]]}',
            "wave_nm: holds a value that is not",
        ),
        ('{"wave_nm": [380, 730], "reflectance": [[0, 0]], "reflectance": [[1, 1]]}', "appears twice"),
        (json.dumps(GOOD | {"reflectance": [[True, 0.5]]}), "of numbers only"),
        (json.dumps(GOOD | {"reflectance": [[0.5, 0.5]] * 100_001}), "100001 colours"),
        (json.dumps(GOOD | {"wave_nm": [-1e308, 1e308]}), "-1e+308 nm is not a wavelength"),
        (json.dumps(GOOD | {"k" * 100_000: 1}), "kkk..."),
    ],
)
def test_anything_else_is_one_clear_line(text: str, says: str) -> None:
    with pytest.raises(RequestError) as refusal:
        parse_reflectances(text, where="R.json")
    line = str(refusal.value)
    assert line.startswith("R.json: ")
    assert says in line
    assert "\n" not in line

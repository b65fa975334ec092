"""A press artefact makes its inks again."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.commissioning.inks import inks_of, packed
from prooflight.errors import PressError
from prooflight.inks.chart import Chart
from prooflight.inks.ink_model import InkModel
from prooflight.inks.reflectance import LogLinear
from prooflight.inks.selection import MODELS
from prooflight.press.artefact import Press
from prooflight.spectra import WAVE_NM

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.press.press_file import PressFile

RECIPES = np.random.default_rng(5).random((40, 4))


def test_the_built_in_inks_come_back_from_a_file(press: Press, prototype: PressFile, tmp_path: Path) -> None:
    path = tmp_path / "a.press"
    press.save(path)
    again = inks_of(Press.load(path))
    assert again.name == prototype.inks().name == "built-in"
    np.testing.assert_array_equal(again.reflectance(RECIPES), prototype.inks().reflectance(RECIPES))


@pytest.mark.parametrize("model", list(MODELS))
def test_inks_of_a_chart_come_back_from_a_file(
    press: Press, prototype: PressFile, tmp_path: Path, model: str
) -> None:
    cmyk = np.random.default_rng(6).random((60, 4))
    cmyk[:16] = np.indices((2, 2, 2, 2)).reshape(4, -1).T
    chart = Chart(
        where="chart.txt",
        keywords=(),
        cmyk_percent=100 * cmyk,
        wave_nm=WAVE_NM,
        measured=prototype.inks().reflectance(cmyk),
        scale=1.0,
    )
    inks = InkModel.fit(chart, model)
    arrays, facts = packed(inks)
    path = tmp_path / "a.press"
    replace(press, ink_arrays=arrays, ink_facts=facts).save(path)
    again = inks_of(Press.load(path))
    assert isinstance(again, InkModel)
    assert (again.name, again.score, again.why, again.chart_digest) == (
        inks.name,
        inks.score,
        inks.why,
        inks.chart_digest,
    )
    np.testing.assert_array_equal(again.reflectance(RECIPES), inks.reflectance(RECIPES))
    np.testing.assert_array_equal(again.spread.of_root(RECIPES), inks.spread.of_root(RECIPES))
    if model == "neighbours":
        _assert_wrong_values_are_refused(replace(press, ink_arrays=arrays, ink_facts=facts))


def _assert_wrong_values_are_refused(press: Press) -> None:
    for name, value in (
        ("model.cmyk", np.nan),
        ("model.measured", np.inf),
        ("spread.reach", 0.0),
        ("spread.squared", -1.0),
    ):
        array = press.ink_arrays[name].copy()
        array.reshape(-1)[7] = value
        with pytest.raises(PressError, match=name):
            replace(press, ink_arrays={**press.ink_arrays, name: array}).check()
    score = press.ink_facts["score"].replace(": ", ": -", 1)
    with pytest.raises(PressError, match=r"ink_facts\.score"):
        replace(press, ink_facts={**press.ink_facts, "score": score}).check()


def test_the_digest_covers_the_inks_and_a_press_travels_with_them(press: Press) -> None:
    darker = {name: 0.9 * array for name, array in press.ink_arrays.items()}
    others = [replace(press, ink_arrays=darker), replace(press, ink_facts={}), replace(press, clipped=())]
    assert len({press.digest, *(other.digest for other in others)}) == len(others) + 1
    assert pickle.loads(pickle.dumps(press)).digest == press.digest


@pytest.mark.parametrize(("facts", "what"), [({}, "no inks"), ({"model": "alchemy"}, "alchemy")])
def test_a_press_without_known_inks_says_so(press: Press, facts: dict[str, str], what: str) -> None:
    with pytest.raises(PressError, match=what) as refusal:
        inks_of(replace(press, ink_facts=facts))
    assert "press build" in str(refusal.value)


def test_inks_that_cannot_be_packed_are_refused() -> None:
    class Grey:
        name = "grey"

        def reflectance(self, cmyk: np.ndarray) -> np.ndarray:
            return np.repeat(1 - cmyk.max(axis=-1, keepdims=True), 36, axis=-1)

    with pytest.raises(TypeError, match="Grey"):
        packed(Grey())


def test_the_built_in_presss_own_coefficients_travel(press: Press, prototype: PressFile) -> None:
    inks = prototype.inks()
    assert isinstance(inks, LogLinear)
    arrays, facts = packed(replace(inks, paper=0.5 * inks.paper))
    again = inks_of(replace(press, ink_arrays=arrays, ink_facts=facts))
    np.testing.assert_allclose(again.reflectance(np.zeros(4)), 0.5 * inks.reflectance(np.zeros(4)))

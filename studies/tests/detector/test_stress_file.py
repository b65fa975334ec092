"""The file of nuisances and misprints for judging: what it must hold, and what is said of one that does not."""

from __future__ import annotations

import pickle
from typing import TYPE_CHECKING

import pytest

from prooflight.errors import RequestError
from prooflight_studies.stress.marks import MARKS
from prooflight_studies.stress.nuisances import NUISANCES
from prooflight_studies.stress.rows import load_stress

if TYPE_CHECKING:
    from pathlib import Path

AMOUNTS = {
    "nuisance": {
        "formation_half": 'rms_percent = 0.7\ngrain_mm = 1.5\nwhere = "sheet"',
        "formation_one": 'rms_percent = 1.1\ngrain_mm = 1.5\nwhere = "sheet"',
        "light_ripple": "amplitude_percent = 0.6\nperiod_lines = 31.3",
        "web_wobble": "amplitude_mm = 0.2\nperiod_mm = 17.0",
        "show_through": "amplitude_percent = 2.5\nblur_mm = 0.8",
        "dust": "columns = 3\nloss_percent = 4.0",
        "looser_press": "times = 1.1",
        "much_looser_press": "times = 1.7",
        "patchy_tables": "times = 2.2",
        "ageing_lamp": "tilt_percent = 5.0",
        "dead_column": "columns = 1\nloss_percent = 40.0",
    },
    "misprint": {
        "hair": "width_mm = 0.2\nlength_mm = 15.0\nink_percent = 60.0",
        "scratch": "width_mm = 0.4\nlength_mm = 30.0\nloss_percent = 70.0",
        "cast": "amount_percent = 9.0",
        "text_exchanged": "window_mm = [30.0, 5.0]",
        "glyph_exchanged": "window_mm = [3.0, 4.0]",
        "mottle": "rms_percent = 8.0\ngrain_mm = 2.5",
        "digit": "sizes_pt = [7.0, 9.0]",
    },
}
"""Of no press: what a stress file may state."""
WHOLE = "schema = 1\n" + "".join(
    f'[{of}.{name}]\nwhat = "words"\n{amounts}\n'
    for of, tables in AMOUNTS.items()
    for name, amounts in tables.items()
)


@pytest.fixture
def given(tmp_path: Path) -> Path:
    path = tmp_path / "stress.toml"
    path.write_text(WHOLE, encoding="utf-8")
    return path


def test_every_table_is_read(given: Path) -> None:
    stress = load_stress(given)
    assert list(stress.nuisances) == list(NUISANCES)
    assert list(stress.marks) == list(MARKS)
    assert stress.nuisance("web_wobble").model_dump() == {
        "what": "words",
        "amplitude_mm": 0.2,
        "period_mm": 17.0,
    }
    assert stress.mark("digit").model_dump()["sizes_pt"] == (7.0, 9.0)
    again = pickle.loads(pickle.dumps(stress))
    assert again == stress


def test_the_file_that_judges_is_one(shared: Path) -> None:
    path = shared / "stress.toml"
    if not path.is_file():
        pytest.skip("needs shared/stress.toml beside the repository")
    assert len(load_stress(path).nuisances) == len(NUISANCES)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("schema = 1", "schema = 2", r"stress\.toml: schema must be 1, not 2; "),
        ("schema = 1\n", "", "schema must be 1, not None"),
        ("schema = 1", "schema = 1\nworld = 3", "world is not known here"),
        ("schema = 1", "schema =", "is not TOML"),
        ("[misprint.", "[error.", "error is not known here"),
        ("columns = 3\n", "", r"nuisance\.dust\.columns is missing"),
        ("columns = 3", "columns = 2.5", r"nuisance\.dust\.columns must be a valid integer"),
        ("columns = 3", "columns = 3\nrows = 1", r"nuisance\.dust\.rows is not known here"),
        ("times = 1.7", 'times = "1.7"', r"nuisance\.much_looser_press\.times must be a valid number"),
        ("tilt_percent = 5.0", "tilt_percent = nan", r"nuisance\.ageing_lamp\.tilt_percent"),
        ("rms_percent = 8.0", "rms_percent = -8.0", r"misprint\.mottle\.rms_percent must be greater"),
        ("window_mm = [3.0, 4.0]", "window_mm = [3.0]", r"misprint\.glyph_exchanged\.window_mm"),
        ("[misprint.hair]", "[misprint.feather]", r"misprint\.feather is not known here"),
        ('where = "sheet"', 'where = "camera"', r"nuisance\.formation_half\.where"),
    ],
)
def test_a_wrong_file_is_one_clear_line(given: Path, old: str, new: str, why: str) -> None:
    assert old in WHOLE
    given.write_text(WHOLE.replace(old, new), encoding="utf-8")
    with pytest.raises(RequestError, match=why) as raised:
        load_stress(given)
    assert "\n" not in str(raised.value)


def test_a_table_that_is_missing_is_named(given: Path) -> None:
    given.write_text(WHOLE[: WHOLE.index("[misprint.digit]")], encoding="utf-8")
    with pytest.raises(RequestError, match=r"misprint\.digit is missing"):
        load_stress(given)


def test_a_name_that_is_none_is_refused(given: Path) -> None:
    with pytest.raises(RequestError, match="nuisance: there is no 'rain'; choose from formation_half, "):
        load_stress(given).nuisance("rain")
    with pytest.raises(RequestError, match="misprint: there is no 'blot'; choose from hair, "):
        load_stress(given).mark("blot")

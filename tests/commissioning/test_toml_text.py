from __future__ import annotations

import datetime
import tomllib
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.commissioning.toml_text import toml_text, toml_value
from prooflight.press.press_file import PressFile

TEXT = st.text(st.characters(exclude_categories=["Cs"]))
SINGLE = st.booleans() | st.integers(-(2**62), 2**62) | st.floats(allow_nan=False) | TEXT
VALUE = st.recursive(
    SINGLE, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXT, inner, max_size=3), max_leaves=6
)


@given(st.dictionaries(TEXT, VALUE, max_size=5))
def test_what_is_written_is_read_back(tree: dict[str, Any]) -> None:
    assert tomllib.loads(toml_text(tree)) == tree


def test_the_prototype_survives(prototype: PressFile) -> None:
    tree = tomllib.loads(prototype.text)
    text = toml_text(tree)
    assert tomllib.loads(text) == tree
    assert "[[sensor]]" in text


def test_dates_have_no_place_in_a_press_file() -> None:
    with pytest.raises(TypeError, match="date has no place"):
        toml_value(datetime.date(2020, 1, 1))

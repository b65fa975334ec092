from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.simulation.worlds import Amounts, amount, gate, worlds, worlds_digest, worlds_text

RESULTS = Path(__file__).resolve().parents[2] / "docs" / "results"

GEOMETRIC = [
    (entry["kind"], field)
    for entry in worlds()["misprint"]
    for field, spec in entry.items()
    if isinstance(spec, dict) and "at_0" in spec and spec.get("scale") != "linear"
]
LINEAR = [
    (entry["kind"], field)
    for entry in worlds()["misprint"]
    for field, spec in entry.items()
    if isinstance(spec, dict) and spec.get("scale") == "linear"
]


def ends(kind: str, field: str) -> tuple[float, float]:
    (entry,) = (entry for entry in worlds()["misprint"] if entry["kind"] == kind)
    return entry[field]["at_0"], entry[field]["at_1"]


def test_the_packages_copy_is_the_file_that_published_figures_name() -> None:
    assert worlds_digest() == hashlib.sha256(worlds_text()).hexdigest()
    pages = {page.stem: page.read_text(encoding="utf-8") for page in RESULTS.rglob("*.md")}
    named = {
        name: re.findall(r"worlds\.toml\W+(?:SHA-256\W+)?([0-9a-f]{12,64})", text)
        for name, text in pages.items()
    }
    assert sum(map(bool, named.values())) >= 5
    assert all(worlds_digest().startswith(digest) for digests in named.values() for digest in digests)


@pytest.mark.parametrize(
    ("variation", "exact"),
    [
        ({}, False),
        ({"all_times": 0.0}, True),
        ({"all_times": 0.0, "camera": {"sigma_error": [0.7, 1.4]}}, True),
        ({"all_times": 0.0, "page": {"skew_deg": 0.01}}, False),
        ({"all_times": 0.0, "paper": {"specks_per_page": 0.5}}, False),
    ],
)
def test_a_press_is_exact_where_nothing_but_noise_varies(variation: dict[str, Any], exact: bool) -> None:
    assert Amounts.stated(variation).exact == exact


def test_there_are_twelve_kinds_each_once() -> None:
    kinds = [entry["kind"] for entry in worlds()["misprint"]]
    assert len(kinds) == len(set(kinds)) == 12


def test_both_ways_of_growing_occur() -> None:
    assert ("missing-plane", "ink_left_percent") in LINEAR
    assert ("streak", "width_mm") in GEOMETRIC


@pytest.mark.parametrize(("kind", "field"), GEOMETRIC + LINEAR)
def test_amounts_run_between_their_ends(kind: str, field: str) -> None:
    at_0, at_1 = ends(kind, field)
    assert amount(kind, field, 0.0) == pytest.approx(at_0)
    assert amount(kind, field, 1.0) == pytest.approx(at_1)


@pytest.mark.parametrize(("kind", "field"), GEOMETRIC)
def test_half_way_a_geometric_amount_is_the_geometric_mean(kind: str, field: str) -> None:
    at_0, at_1 = ends(kind, field)
    assert amount(kind, field, 0.5) == pytest.approx((at_0 * at_1) ** 0.5)


@pytest.mark.parametrize(("kind", "field"), LINEAR)
def test_half_way_a_linear_amount_is_the_mean(kind: str, field: str) -> None:
    at_0, at_1 = ends(kind, field)
    assert amount(kind, field, 0.5) == pytest.approx((at_0 + at_1) / 2)


@given(st.floats(0, 1), st.floats(0, 1))
def test_equal_steps_of_severity_are_equal_ratios(one: float, other: float) -> None:
    ratio = amount("streak", "width_mm", one) / amount("streak", "width_mm", other)
    assert ratio == pytest.approx((2.0 / 0.15) ** (one - other))


def test_the_gate_is_the_files() -> None:
    assert (gate().blurred_peak_percent, gate().rms_percent) == (1.2, 0.4)

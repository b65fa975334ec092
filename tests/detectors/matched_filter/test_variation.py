"""How much good prints vary: amounts come back from pages that were drawn with them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from prooflight.detectors.matched_filter.fit.nuisance import FitLayout
from prooflight.detectors.matched_filter.variation import (
    AMOUNTS,
    UNTOLD,
    _of_fit,
    _of_place,
    _shared,
    learned_amounts,
)
from prooflight.detectors.print_prior import PrintPrior
from prooflight.press.blocks import VARIATION
from prooflight.scans.placement import Placement

PAGES = 600
GAIN = next(index for index, names in enumerate(AMOUNTS) if "ink.gain_print_percent" in names)


@pytest.mark.parametrize("times", [1.0, 2.0])
@pytest.mark.parametrize("share", [0.4, 0.8, 0.99])
def test_what_the_prior_drew_in_is_undone(times: float, share: float) -> None:
    """Gains of ``times`` the prior, fitted with it; seed 3, 600 pages, 4 inks: within 10 %, three deviations."""
    rng, prior, layout = np.random.default_rng(3), PrintPrior(), FitLayout(sensors=1, colours=1)
    rows = np.zeros((PAGES, len(AMOUNTS), 2))
    for row in rows:
        told, pulls = np.full(layout.size, share), np.zeros(layout.size)
        noise = rng.standard_normal(4) * np.sqrt((1 - share) / share)
        amounts = share * (times * rng.standard_normal(4) + noise)
        layout.parts(pulls).gain[:, 0] = amounts / np.sqrt(share)
        fit = SimpleNamespace(
            prior=prior, white=np.zeros(1), shape=np.zeros((1, 1)), determined_share=told, pulls=pulls
        )
        colours = SimpleNamespace(root=np.ones((1, 1)), centres=np.zeros((1, 4)))
        found = _of_fit(
            SimpleNamespace(colours=colours),  # type: ignore[arg-type]
            SimpleNamespace(fit=fit, noise=np.ones(1)),  # type: ignore[arg-type]
        )
        row[GAIN] = found["ink.gain_session_percent"]
    (learned,) = learned_amounts(rows)
    assert learned.names == AMOUNTS[GAIN]
    assert learned.value == pytest.approx(100 * times * prior.gain, rel=0.1)
    assert learned.low < learned.value < learned.high
    assert learned.pages == PAGES


def test_planes_scatter_about_their_own_mean() -> None:
    """Registration finds planes off their weighted mean; seed 4, 600 pages of 8 numbers: within 10 %."""
    rng, parts = np.random.default_rng(4), np.array([[0.5, 0.3, 0.2, 0.0]] * 2)
    rows = np.zeros((PAGES, len(AMOUNTS), 2))
    for row in rows:
        planes = 0.048 * rng.standard_normal((4, 2))
        found: dict[str, Any] = {"located": True, "placement": Placement(), "plane_parts": parts}
        found["planes_mm"] = planes - np.einsum("ai,ia->a", parts, planes)
        told = _of_place(SimpleNamespace(registration=SimpleNamespace(**found)))  # type: ignore[arg-type]
        row[[names == ("register.plane_um",) for names in AMOUNTS]] = told["register.plane_um"]
    (learned,) = learned_amounts(rows)
    assert learned.value == pytest.approx(48, rel=0.1)


def test_halves_share_what_is_no_noise() -> None:
    """Seed 5, 40,000 places: variances within 5 %, some four deviations of a median absolute deviation's square."""
    rng = np.random.default_rng(5)
    common, one, other = rng.standard_normal((3, 40_000))
    assert _shared(2 * common + one, 2 * common + other) == pytest.approx(4, rel=0.05)


def test_one_page_in_a_hundred_that_is_far_out_tells_little() -> None:
    rng = np.random.default_rng(6)
    rows = np.zeros((PAGES, len(AMOUNTS), 2))
    rows[:, 0] = np.stack([rng.standard_normal(PAGES) ** 2, np.ones(PAGES)], axis=1)
    before = learned_amounts(rows)[0].value
    rows[::100, 0, 0] = 1e6
    assert learned_amounts(rows)[0].value < 1.1 * before


def test_every_amount_is_estimated_or_said_not_to_be() -> None:
    known = [name for names in AMOUNTS for name in names] + list(UNTOLD)
    assert sorted(known) == sorted(f"{block}.{name}" for block, names in VARIATION.items() for name in names)

"""The world ``measured`` draws what ``measured.toml`` says (seeds fixed; tolerances: five standard errors)."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.commissioning.training.simulated_days import DESIGNS_A_DAY, PressDay, good_prior, worlds_of
from prooflight.commissioning.training.train import Plan
from prooflight.errors import RequestError
from prooflight.pages.raster import Page
from prooflight.rng import stream
from prooflight.simulation.captures import SimulatedDay
from prooflight.simulation.corpus.corpus import Corpus
from prooflight.simulation.fast import fast_mean_variance
from prooflight.simulation.prints import Print
from prooflight.simulation.scans import simulate
from prooflight.simulation.session import Session, session_of
from prooflight.simulation.worlds import (
    Amounts,
    amounts_of,
    measured_digest,
    measured_text,
    stated_amounts,
    world_named,
    worlds,
    worlds_digest,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.press.artefact import Press

DAYS = 120
A4 = Page(cmyk=np.zeros((297, 210, 4), np.uint8), dpi=25.4, name="p0001", number=1)
CARD = replace(A4, cmyk=np.zeros((20, 30, 4), np.uint8))
INDEPENDENT = 30
"""Places of a page that are as good as independent: 297 x 210 mm in lengths of 40 mm, and zones of 30 mm; assumed."""


@pytest.fixture(scope="module")
def days(press: Press) -> list[Session]:
    return [Session.draw(Amounts.stated(world="measured"), press, stream(n, "session")) for n in range(DAYS)]


def sheet(day: Session, press: Press, number: int, seed: int, page: Page = CARD) -> Print:
    return Print.draw(day, press, page, np.random.default_rng([seed, number]), sheet=number)


def of_solid_and_tint(print_: Print) -> tuple[np.ndarray, np.ndarray]:
    """Relative change of ink of a solid and of a mid-tint, (4, rows, columns) each."""
    assert print_.fields is not None
    gain = print_.fields.gain.astype(np.float64)
    return gain, gain + 2 * print_.fields.dot_gain


def test_places_of_a_sheet_vary_as_stated_and_stay_on_every_sheet(days: list[Session], press: Press) -> None:
    stays = [], []
    own = [], []
    for n, day in enumerate(days[:16]):
        pair = [of_solid_and_tint(sheet(day, press, number, n, A4)) for number in (0, 5000)]
        for kind in (0, 1):
            one, other = pair[0][kind], pair[1][kind]
            stays[kind].append((one * other).mean(axis=(1, 2)))  # what two sheets share
            own[kind].append(((one - other) ** 2).mean(axis=(1, 2)) / 2)
    error = 5 / np.sqrt(2 * 16 * 4 * INDEPENDENT)
    assert np.sqrt(np.mean(stays[0])) == pytest.approx(0.020, rel=error)
    assert np.sqrt(np.mean(stays[1])) == pytest.approx(0.008, rel=error)
    assert np.sqrt(np.mean(own[0])) == pytest.approx(0.008, rel=error)
    assert np.sqrt(np.mean(own[1])) == pytest.approx(0.005, rel=error)


def test_sheets_vary_little_and_drift_slowly(days: list[Session], press: Press) -> None:
    numbers = (0, 5, 5000)
    ink = np.array(
        [[sheet(day, press, n, seed).ink_gain for n in numbers] for seed, day in enumerate(days)]
    )  # (days, sheets, inks)
    draws = ink[:, 0].size
    assert ink[:, 0].std() == pytest.approx(0.0017, rel=5 / np.sqrt(2 * draws))
    near, far = (np.corrcoef(ink[:, 0].ravel(), ink[:, k].ravel())[0, 1] for k in (1, 2))
    # Half of the variance drifts, smooth over 50 sheets: exp(-(5/50)^2) of it is left after five.
    assert near == pytest.approx(0.5 * np.exp(-0.01), abs=5 / np.sqrt(draws))
    assert far == pytest.approx(0, abs=5 / np.sqrt(draws))


def test_paper_is_white_within_a_twentieth_of_a_per_cent(days: list[Session], press: Press) -> None:
    white = np.array([sheet(day, press, 1, n).white[0] for n, day in enumerate(days)])
    assert white.mean() == pytest.approx(1, abs=5 * 0.0005 / np.sqrt(DAYS))
    assert white.std() == pytest.approx(0.0005, rel=5 / np.sqrt(2 * DAYS))


def test_a_field_of_gain_is_a_gain_where_it_is(press: Press, make_page: Callable[..., Page]) -> None:
    """A field that is the same everywhere prints what a gain of the whole page prints; one of a half, half of it."""
    page = replace(make_page(1, width_mm=20, height_mm=16, dpi=press.dpi), dpi=press.dpi)
    day = Session.draw(Amounts.stated(world="measured"), press, stream(1, "session")).printing(None, press)
    print_ = Print.draw(day, press, page, np.random.default_rng(1), sheet=0)
    assert print_.fields is not None
    bare = replace(print_, ink_tilt=np.zeros((4, 2)), fields=None)
    even = replace(
        bare,
        fields=replace(
            print_.fields,
            gain=np.full_like(print_.fields.gain, 0.02),
            dot_gain=np.full_like(print_.fields.dot_gain, -0.006),
        ),
    )
    whole = replace(bare, ink_gain=bare.ink_gain + 0.02, dot_gain=bare.dot_gain - 0.006)
    of_field, of_page = (fast_mean_variance(page, press, day, one).expected_dn for one in (even, whole))
    np.testing.assert_allclose(of_field, of_page, rtol=2e-5)
    assert np.abs(of_page - fast_mean_variance(page, press, day, bare).expected_dn).max() > 1


def test_the_frozen_worlds_are_as_they_were(press: Press) -> None:
    stated, measured = Amounts.stated(), Amounts.stated(world="measured")
    assert stated.sheet is None
    assert stated.screen is None
    assert stated.ink.gain_print_percent == worlds()["press"]["ink"]["gain_print_percent"]
    assert (measured.page, measured.register, measured.lamp, measured.camera) == (
        stated.page,
        stated.register,
        stated.lamp,
        stated.camera,
    )
    assert measured_digest() == hashlib.sha256(measured_text()).hexdigest() != worlds_digest()
    print_ = Print.draw(session_of(press, 1, "press"), press, A4, np.random.default_rng(1))  # type: ignore[arg-type]
    assert print_.fields is None


def test_a_press_file_s_factor_scales_this_world_too() -> None:
    calm = Amounts.stated({"all_times": 0.5}, "measured")
    assert calm.sheet is not None
    assert calm.sheet.solid_percent == pytest.approx(1.0)
    assert calm.sheet.place_mm == 40.0
    assert calm.ink.gain_print_percent == pytest.approx(0.085)


def test_a_user_s_prints_are_screened(press: Press, make_page: Callable[..., Page]) -> None:
    page = make_page(1, width_mm=20, height_mm=16, dpi=press.dpi)
    tint = replace(page, cmyk=np.full_like(page.cmyk, 80))
    seen = {
        world: simulate(tint, press, world=world, seed=3).dn.astype(np.float64)
        for world in ("press", "measured")
    }
    rows, columns = press.geometry.on_page(20, 16)
    middle = np.s_[0, rows.start + 30 : rows.stop - 30, columns.start + 30 : columns.stop - 30]
    assert seen["measured"].shape == seen["press"].shape
    # Dots of 175 lines an inch beat with pixels of 0.105 mm: rows of pixels differ from their neighbours by far more.
    beat = {world: np.diff(dn[middle].mean(axis=0)).std() for world, dn in seen.items()}
    assert beat["measured"] > 1.5 * beat["press"]


def test_a_day_of_studies_may_be_of_this_world(press: Press) -> None:
    day = SimulatedDay.begin("measured", press, stream(1, "session"))
    assert day.session is not None
    assert day.session.sheets is not None


def test_a_press_that_states_this_world_varies_so_in_its_own(press: Press) -> None:
    stated = replace(press, variation={"world": "measured", "ink": {"gain_print_percent": 0.5}})
    amounts = amounts_of(stated)
    assert amounts.sheet == Amounts.stated(world="measured").sheet
    assert amounts.screen is None  # the press file says how a press screens
    assert amounts.ink.gain_print_percent == 0.5  # a single amount stands as given
    assert good_prior(stated).gain < good_prior(press).gain
    assert amounts_of(press).sheet is None


def test_a_press_that_states_either_world_is_trained_on_days_of_both(press: Press) -> None:
    either, measured = (replace(press, variation={"world": world}) for world in ("either", "measured"))
    days = [
        PressDay.of(either, Corpus(seed=1, dpi=press.dpi), seed=1, first=first).day for first in (0, 4, 8)
    ]
    assert [day.session is not None and day.session.sheets is not None for day in days] == [
        False,
        True,
        False,
    ]
    assert amounts_of(either) == amounts_of(press)
    # As many designs of each as of a press of one world, however its days begin.
    one, both = Plan.of(136), Plan.of(136, len(stated_amounts(either)))
    for part in ("pilot", "calibrate"):
        counts = np.bincount(worlds_of(getattr(both, part), 2))
        assert counts.sum() == 2 * len(getattr(one, part))
        assert abs(counts - len(getattr(one, part))).max() <= DESIGNS_A_DAY / 2
    # The prior allows what either world does: sheets of the press world differ more, places of the other.
    own, of_press, of_measured = (good_prior(one) for one in (either, press, measured))
    assert own.gain == of_press.gain > of_measured.gain
    assert own.tilt == max(of_press.tilt, of_measured.tilt)


def test_another_world_is_refused_in_one_line() -> None:
    with pytest.raises(RequestError, match="choose ideal, press or measured"):
        world_named("real")

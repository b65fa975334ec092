"""Which page of a job a sheet is taken for, where its place in the job is not known."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from packages.line.tests.run.test_pager import worded

from prooflight.prediction.predict import predict
from prooflight.rng import stream
from prooflight.simulation.scans import scan_page
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import Amounts
from prooflight_line.run.sheets.fitting import lay
from prooflight_line.run.sheets.following import AHEAD, ALIKE, Following
from prooflight_line.run.sheets.thumbnails import Shrinker, thumbnail_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press


@pytest.mark.parametrize("further", [3, AHEAD + 4])
def test_behind_an_absence_the_likeliest_page_of_all_near_is_taken(
    press: Press, make_page: Callable[..., Page], further: int
) -> None:
    """Not the one due, though the sheet is like that as well: a form of which the other has other words."""
    due, shown = (worded(make_page(150), number) for number in (0, 1))
    one, other = (
        thumbnail_of(page, predict(page, sensors=press.sensors, geometry=press.geometry, threads=1), press)
        for page in (due, shown)
    )
    session = Session.draw(Amounts.stated(), press, np.random.default_rng(3))
    scan = scan_page(
        shown,
        press=press,
        request=None,
        others=(),
        fetch=lambda _: shown,
        rng=stream(5, "print", 0),
        session=session,
    ).dn
    light = Shrinker(press).picture(scan)
    assert lay(light, one, press.geometry).likeness >= ALIKE
    following = Following(expected=[one] * further + [other] + [one] * 4, geometry=press.geometry)
    following.readings.blind = True
    assert following.identify(light, longer=0.0).job_page == further

"""The study of zones: what it prints lies where it says, and its counts are those of its rows."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.commissioning.zones.defects import Area, areas_of, with_defect
from prooflight.pages.raster import Page
from prooflight.pages.zones.zone import PageZones
from prooflight.pages.zones.zones_file import JobZones
from prooflight.prediction.predict import predict
from prooflight.rng import stream
from prooflight_studies.harness.page import page_text, plain
from prooflight_studies.zones.study import (
    PAGE_MM,
    STRONG,
    ZONES_A_PAGE,
    PageRows,
    Tally,
    _near,
    _within,
    printed_with,
    zones_of,
    zones_results,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.press.artefact import Press


@pytest.fixture
def zones() -> PageZones:
    made = JobZones.create(zones_of("ignore", stream(3, "zones-study", 0)), [PAGE_MM])
    return PageZones(zones=made.of_pages[1], careful_share=0.2)


def test_zones_lie_apart_and_on_the_page(zones: PageZones) -> None:
    assert len(zones.zones) == ZONES_A_PAGE
    x, y = (np.arange(0.05, extent, 0.1) for extent in PAGE_MM)
    held = sum(zone.holds(x, y).astype(int) for zone in zones.zones)
    assert held.max() == 1


@pytest.mark.parametrize("sort", ["spot", "streak", "density"])
def test_a_printed_defect_changes_its_area_by_so_much(
    sort: str, make_page: Callable[..., Page], press: Press
) -> None:
    page = make_page(3)
    area = Area(
        name="a",
        kind="careful",
        holds=lambda x, y: (y[:, None] > 20) & (y[:, None] < 30) & (x > 5) & (x < 15),
    )
    spoilt = printed_with(page, sort, STRONG[sort], area, sensors=press.sensors, rng=np.random.default_rng(2))
    assert spoilt is not None
    changed = np.argwhere((spoilt.cmyk != page.cmyk).any(axis=2)) * page.pixel_mm
    assert changed[:, 0].min() > 20 - STRONG["spot"]
    assert changed[:, 0].max() < 30 + STRONG["spot"]
    if sort == "density":  # 60 % less of all inks; rounding keeps the mean
        rows, columns = (
            slice(int(a / page.pixel_mm) + 2, int(b / page.pixel_mm) - 2) for a, b in ((20, 30), (5, 15))
        )
        left = spoilt.cmyk[rows, columns].sum(dtype=float) / page.cmyk[rows, columns].sum(dtype=float)
        assert left == pytest.approx(0.4, abs=0.01)


@pytest.mark.parametrize(
    ("cmyk", "darker"),
    [((0, 0, 0, 0), True), ((35, 188, 158, 0), True), ((90, 220, 220, 0), False), ((0, 0, 0, 255), False)],
)
def test_a_printed_spot_is_what_the_price_puts_into_scans(
    cmyk: tuple[int, ...], darker: bool, press: Press
) -> None:
    """In the middle of a spot of 3 mm both give the same light, black or of bare paper, to 1 % of paper: black lies on
    the other inks, and the lens spreads a little light further than the price does.
    """
    plain = np.broadcast_to(np.array(cmyk, np.uint8), (400, 400, 4)).copy()
    page = press.geometry.lay(Page(cmyk=plain, dpi=press.dpi, name="p", number=1))
    area = Area(
        name="a", kind="careful", holds=lambda x, y: (abs(y[:, None] - 10) < 0.1) & (abs(x - 10) < 0.1)
    )

    def seen(page: Page) -> NDArray[np.float32]:
        return predict(page, sensors=press.sensors, geometry=press.geometry).expected_dn

    clean = seen(page)
    printed = printed_with(page, "spot", 3.0, area, sensors=press.sensors, rng=np.random.default_rng(3))
    put = with_defect(
        np.rint(clean).astype(np.uint16), "spot", 3.0, area,
        page=page, press=press, shift_mm=(0.0, 0.0), rng=np.random.default_rng(4),
    )  # fmt: skip
    assert printed is not None
    assert put is not None
    line = int(np.abs(press.geometry.centres_y_mm(clean.shape[1]) - 10).argmin())
    column = int(np.abs(press.geometry.centres_x_mm(page.width_mm) - 10).argmin())
    there, here = float(seen(printed)[0, line, column]), float(put[0, line, column])
    assert (there < clean[0, line, column]) == darker
    assert there == pytest.approx(here, abs=0.01 * press.sensors[0].white_dn)


def test_places_within_and_beside_ignored_zones(zones: PageZones) -> None:
    areas = [area for area in areas_of(zones) if area.kind == "ignore"]
    x, y = (np.arange(0.05, extent, 0.1) for extent in PAGE_MM)
    everywhere = np.any([area.holds(x, y) for area in areas], axis=0)
    for area in areas[:3]:
        inner = partial(_within, area=area, reach=1.0)(x, y)
        assert inner.any()
        assert not (inner & ~area.holds(x, y)).any()
        beside = _near(x, y, area=area, sort="spot", others=areas)
        assert not (beside & everywhere).any()


def test_the_page_counts_its_rows() -> None:
    three = {name: Tally(prints=12, alarms=1) for name in ("spot", "streak", "density")}
    row = {"before": 2.0, "after": 1.0, "prints": 2, "alarms": 2}
    rows = PageRows(
        careful_zones=12,
        ignored_zones=12,
        foretold=[{"sort": sort, **row} for sort in three] + [{"sort": "spot", **row, "before": None}],
        rest=[{"sort": sort, "before": 1.0, "after": 1.1} for sort in three],
        inside=three,
        inside_bare=three,
        beside=[
            {"sort": "spot", "with": True, "without": True},
            {"sort": "spot", "with": False, "without": True},
        ],
        good={name: Tally(prints=40, alarms=1) for name in ("careful", "ignored")},
        good_bare={name: Tally(prints=40, alarms=0) for name in ("careful", "ignored")},
    )
    found = zones_results([rows, rows], seed=1, nominal_rate=0.01)
    spot = found.price[0]
    assert (spot["prints"], spot["alarms"], spot["zones"], spot["before_known"], spot["compared"]) == (
        8,
        8,
        4,
        2,
        2,
    )
    assert spot["better"] == 2.0
    assert found.beside[0] == {"sort": "spot", "prints": 4, "with": 2, "without": 4, "lost": 2}
    assert found.good[0]["with"] == {"prints": 80, "alarms": 2}
    text = page_text({"study": "zones", **plain(found)})
    assert "| careful | 80 | 0 of 80 (< 3.7 %) | 2 of 80, 2.5 % (< 7.7 %) |" in text
    assert "study zones --seed 1`" in text

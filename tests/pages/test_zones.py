"""Zones of a job's pages: which counts where, files, and rules for PDFs."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.errors import InputError, JobError, RequestError
from prooflight.pages.pdf.rip import PageMarks
from prooflight.pages.raster import Page, turned
from prooflight.pages.zones.rules import Rule, Rules, on_all_pages
from prooflight.pages.zones.zone import PageZones, Zone, contested
from prooflight.pages.zones.zones_file import JobZones, PriceEntry, ZoneEntry, schema

if TYPE_CHECKING:
    from pathlib import Path

A5 = (148.0, 210.0)


def entry(
    name: str = "z", kind: Any = "careful", box: Any = (10.0, 10.0, 20.0, 30.0), pages: str = "all"
) -> ZoneEntry:
    return ZoneEntry(name=name, kind=kind, rectangle_mm=box, pages=pages)


def at(zones: PageZones, kind: Any, x: float, y: float) -> bool:
    return bool(zones.holds(kind, np.array([x]), np.array([y]))[0, 0])


@given(
    box=st.tuples(*[st.floats(1, 50)] * 4),
    point=st.tuples(st.floats(0, 100), st.floats(0, 100)),
)
def test_a_rectangle_holds_what_lies_between_its_edges(box: Any, point: Any) -> None:
    (x, y, width, height), (px, py) = box, point
    zone = Zone.rectangle("z", "ignore", box)
    expected = x <= px < x + width and y <= py < y + height
    assert bool(zone.holds(np.array([px]), np.array([py]))[0, 0]) == expected
    assert zone.area_mm2 == pytest.approx(width * height)


def test_a_triangle_holds_half_of_its_rectangle() -> None:
    zone = Zone(name="z", kind="ignore", corners_mm=((0, 0), (40, 0), (0, 40)))
    places = np.arange(0.05, 40, 0.1)
    assert zone.holds(places, places).mean() == pytest.approx(0.5, abs=0.005)
    assert zone.area_mm2 == 800


def test_the_stricter_zone_counts_whatever_the_order() -> None:
    of = [
        Zone.rectangle("all", "ignore", (0, 0, 100, 100)),
        Zone.rectangle("hole", "normal", (20, 20, 40, 40)),
        Zone.rectangle("face", "careful", (30, 30, 10, 10)),
    ]
    for zones in (
        PageZones(zones=tuple(of), careful_share=0.2),
        PageZones(zones=tuple(of[::-1]), careful_share=0.2),
    ):
        assert [at(zones, kind, 5, 5) for kind in ("ignore", "normal", "careful")] == [True, False, False]
        assert [at(zones, kind, 25, 25) for kind in ("ignore", "normal", "careful")] == [False, True, False]
        assert [at(zones, kind, 35, 35) for kind in ("ignore", "normal", "careful")] == [False, False, True]
        assert zones.at(35, 35) == of[2]
        assert zones.at(150, 35) is None
    assert contested(of) == [(of[2], of[0])]


def test_boxes_that_touch_do_not_overlap() -> None:
    one, other = (
        Zone.rectangle("a", "careful", (0, 0, 10, 10)),
        Zone.rectangle("b", "ignore", (10, 0, 10, 10)),
    )
    assert contested([one, other]) == []


def test_zones_turn_with_their_page() -> None:
    cmyk = np.zeros((40, 20, 4), np.uint8)
    cmyk[5:9, 2:6] = 255
    page = Page(cmyk=cmyk, dpi=25.4, name="p0001", number=1)
    zones = JobZones.create([entry(kind="ignore", box=(2.0, 5.0, 4.0, 4.0))], [(20.0, 40.0)])
    for laid in (page, turned(page)):
        of_page = zones.page(laid)
        assert of_page is not None
        rows, columns = laid.cmyk.shape[:2]
        held = of_page.holds("ignore", np.arange(columns) + 0.5, np.arange(rows) + 0.5)
        assert np.array_equal(held, laid.cmyk[..., 0] > 0)


def price(zones: JobZones, press: str = "abc") -> PriceEntry:
    return PriceEntry(
        press=press, zones=zones.zones_digest, prints=3, seed=1, page_scores=(1.0, 2.0, 3.0),
        careful_scores=(0.5, 0.6), careful_mean=(0.0,), careful_sd=(1.0,),
    )  # fmt: skip


def test_a_file_comes_back_as_it_was_with_the_same_digest(tmp_path: Path) -> None:
    polygon = ZoneEntry(
        name="logo", kind="careful", pages="1,3", polygon_mm=((5.0, 5.0), (20.0, 5.0), (5.0, 20.0))
    )
    zones = JobZones.create([entry(pages="2-3"), polygon], [A5] * 3)
    zones = zones.priced(price(zones))
    path = tmp_path / "job.zones.json"
    zones.save(path)
    again = JobZones.read(path, [A5] * 3)
    assert (again.document, again.digest, again.of_pages) == (zones.document, zones.digest, zones.of_pages)
    assert sorted(again.of_pages) == [1, 2, 3]
    assert [zone.name for zone in again.of_pages[3]] == ["z", "logo"]
    assert (
        JobZones.create([entry(pages="2")], [A5] * 3).digest
        != JobZones.create([entry(pages="3")], [A5] * 3).digest
    )


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "is not JSON"),
        ("[1]", "must be"),
        ("[" * 100_000, "is not JSON"),
        ('{"zones": []}', "zones"),
        ('{"zones": [{"name": "a", "kind": "strict"}]}', "kind"),
        ('{"zones": [{"name": "a", "kind": "ignore"}]}', "needs either"),
        ('{"zones": [{"name": "a", "kind": "ignore", "rectangle_mm": [1, 1, 5]}]}', "rectangle_mm"),
        ('{"zones": [{"name": "a", "kind": "ignore", "rectangle_mm": [1, 1, 5, NaN]}]}', "rectangle_mm"),
        ('{"zones": [{"name": "a", "kind": "ignore", "rectangle_mm": [1, 1, 0.5, 0.5]}]}', "0.25 mm2"),
        ('{"zones": [{"name": "a", "kind": "ignore", "rectangle_mm": [140, 1, 20, 5]}]}', "12.0 mm beyond page 1"),
        ('{"zones": [{"name": "a", "kind": "ignore", "pages": "3", "rectangle_mm": [1, 1, 5, 5]}]}', "no page 3"),
        ('{"zones": [{"name": "a", "kind": "ignore", "rectangle_mm": [0, 0, 148, 200]}]}', "95% of page 1"),
        ('{"schema": 2, "zones": [{"name": "a", "kind": "ignore", "rectangle_mm": [1, 1, 5, 5]}]}', "schema"),
        ('{"zones": [{"name": "a", "kind": "ignore", "rectangle_mm": [1, 1, 5, 5], "colour": 1}]}', "not known here"),
    ],
)  # fmt: skip
def test_a_wrong_file_is_refused_in_one_line(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "job.zones.json"
    path.write_text(text)
    with pytest.raises(JobError) as raised:
        JobZones.read(path, [A5] * 2)
    assert told in str(raised.value)
    assert "\n" not in str(raised.value)


def test_zones_are_in_force_on_the_press_and_as_they_were_priced_alone() -> None:
    zones = JobZones.create([entry()], [A5])
    for unfit, told in (
        (zones, "have not been priced"),
        (zones.priced(price(zones, press="other")), "on another press"),
        (JobZones.create([entry(name="y")], [A5]).priced(price(zones)), "changed after"),
    ):
        with pytest.raises(RequestError, match=told):
            unfit.refuse_unpriced("abc", "matched_filter", where="job.zones.json")
    zones.priced(price(zones)).refuse_unpriced("abc", "matched_filter", where="job.zones.json")
    assert zones.page(Page(cmyk=np.zeros((210, 148, 4), np.uint8), dpi=25.4, name="p", number=1)) is not None


def test_an_overlap_of_careful_and_ignored_says_which_counts() -> None:
    zones = JobZones.create([entry(), entry("strip", "ignore", (0.0, 0.0, 148.0, 15.0))], [A5] * 2)
    assert zones.contested() == [
        "page 1: the careful zone 'z' overlaps the ignored 'strip'; there, careful applies"
    ]


def test_the_published_schema_is_the_files_own() -> None:
    from tests.test_docs import DOCS

    assert json.loads((DOCS / "reference/zones.schema.json").read_text(encoding="utf-8")) == schema()


MARKS = PageMarks(
    bleed=(3.0, 3.0, 142.0, 204.0),
    layers=(("Faces", (20.0, 30.0, 40.0, 50.0)), ("Cut", (-5.0, -5.0, 158.0, 220.0))),
    annotations=(
        (("Stamp", "numbering"), (100.0, 180.0, 30.0, 10.0)),
        (("Widget", "total"), (100.0, 10.0, 30.0, 8.0)),
    ),
)


def test_rules_make_zones_of_what_a_page_says() -> None:
    rules = Rules(
        layers=(Rule(name="faces", kind="careful"),),
        annotations=(Rule(name="numbering", kind="ignore"), Rule(name="Total", kind="careful")),
        outside_bleed="ignore",
    )
    found = rules.entries(MARKS, 2, A5)
    assert [(one.name, one.kind, one.rectangle_mm) for one in found if "BleedBox" not in one.name] == [
        ("faces", "careful", (20.0, 30.0, 40.0, 50.0)),
        ("numbering", "ignore", (100.0, 180.0, 30.0, 10.0)),
        ("Total", "careful", (100.0, 10.0, 30.0, 8.0)),
    ]
    zones = JobZones.create(found, [A5] * 2).of_pages[2]
    frame = PageZones(zones=zones, careful_share=0.2)
    assert at(frame, "ignore", 1.0, 100.0)
    assert at(frame, "ignore", 146.0, 209.0)
    assert not at(frame, "ignore", 4.0, 4.0)
    assert rules.unmet([MARKS]) == []
    lacking = Rules(layers=(Rule(name="Logo", kind="careful"),))
    assert lacking.unmet([MARKS]) == ["no page has a layer 'Logo': there are Cut, Faces"]


def test_a_strip_along_the_edges_is_four_zones_and_alike_pages_are_written_once() -> None:
    rules = Rules(edge_mm=4.0)
    found = on_all_pages([one for number in (1, 2, 3) for one in rules.entries(None, number, A5)], 3)
    assert [one.pages for one in found] == ["all"] * 4
    assert sum(JobZones.create(found, [A5] * 3).of_pages[1][at].area_mm2 for at in range(4)) == pytest.approx(
        148 * 210 - 140 * 202
    )


@pytest.mark.parametrize("text", ["faces", "=ignore", "faces=strict", ""])
def test_a_rule_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="--layer"):
        Rule.parse("--layer", text)

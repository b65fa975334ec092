"""Reasons in the words of the press room."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from prooflight.detectors.matched_filter.explaining import (
    distinct_inks,
    reason_for,
    regions_of,
)
from prooflight.detectors.matched_filter.naming import supported
from prooflight.detectors.matched_filter.statistics.statistic import NOWHERE, Observed, Statistic
from prooflight.detectors.verdict import Ink, Region
from prooflight.registration.register import Registration
from prooflight.scans.placement import Placement


def registration(*, located: bool = True, shift_mm: tuple[float, float] = (0.0, 0.0)) -> Registration:
    return Registration(
        placement=Placement(shift_mm=shift_mm),
        located=located,
        reason="" if located else "too little is printed to locate the page",
        planes_mm=np.zeros((4, 2)),
        plane_parts=np.zeros((2, 4)),
    )


def ink(gain: float = 0.0, register: tuple[float, float] = (0.0, 0.0)) -> Ink:
    return Ink(gain_percent=gain, dot_gain_percent=0.0, register_mm=register)


def statistic(name: str, box: tuple[float, float, float, float] = NOWHERE, value: float = 9.0) -> Observed:
    return Observed(statistic=Statistic.parse(name), value=value, box=box)


STREAK = Region(x_mm=82.5, y_mm=0.0, width_mm=1.0, height_mm=297.0, score=9.0, kind="streak")
SPOT = Region(x_mm=10.0, y_mm=20.0, width_mm=2.0, height_mm=2.0, score=9.0, kind="spots-voids")


@pytest.mark.parametrize(
    ("kind", "name", "region", "inks", "words"),
    [
        ("missing-plane", "fit/gain-C", None, {"C": ink(-92.0), "K": ink()}, "missing cyan"),
        ("missing-plane", "fit/gain-C", None, {"C": ink(-30.0)}, "weak cyan"),
        ("density", "fit/gain-M", None, {"C": ink(1.0), "M": ink(12.3)}, "magenta 12 % too strong"),
        ("density", "fit/gain-all", None, {"C": ink(-10.0), "K": ink(-12.0)}, "all inks 11 % too weak"),
        ("plane-register", "fit/plane-M", None, {"M": ink(register=(0.3, 0.0))}, "register of magenta 0.3 mm"),
        ("plane-register", "fit/plane-M", None, {"M": ink(register=(0.03, 0.0))}, "register of magenta"),
        ("plane-register", "place/planes", None, {"Y": ink(register=(0.3, 0.4))}, "register of yellow 0.5 mm"),
        ("streak", "streak/add-K/2/full", STREAK, {}, "streak at x = 83 mm in black"),
        ("spots-voids", "box/add-K+/4", SPOT, {}, "spot in black around x = 11 mm, y = 21 mm (2 x 2 mm)"),
        ("spots-voids", "box/void+/4", SPOT, {}, "void around x = 11 mm, y = 21 mm (2 x 2 mm)"),
        ("spots-voids", "apart/light-/4", SPOT, {}, "spot around x = 11 mm, y = 21 mm (2 x 2 mm)"),
        ("banding", "band/gain-C/wave", None, {"C": ink()}, "bands across the page in cyan"),
        ("unknown", "energy/page", None, {}, "difference all over the page"),
    ],
)  # fmt: skip
def test_reasons(kind: str, name: str, region: Region | None, inks: dict[str, Ink], words: str) -> None:
    assert reason_for(kind, statistic(name), region, inks, registration(), distinct="CMYK") == words


@pytest.mark.parametrize(
    ("kind", "name", "region", "inks", "words"),
    [
        ("missing-plane", "fit/gain-C", None, {"C": ink(-92.0), "K": ink()}, "missing ink"),
        ("missing-plane", "fit/gain-C", None, {"C": ink(-30.0)}, "weak cyan"),  # the page has no other
        ("density", "fit/gain-M", None, {"C": ink(1.0), "M": ink(12.3)}, "an ink 12 % too strong"),
        ("plane-register", "fit/plane-M", None, {"M": ink(register=(0.3, 0)), "K": ink()}, "register of an ink 0.3 mm"),
        ("streak", "streak/add-K/2/full", STREAK, {"K": ink()}, "streak at x = 83 mm"),
        ("spots-voids", "box/add-C+/4", SPOT, {"C": ink()}, "spot around x = 11 mm, y = 21 mm (2 x 2 mm)"),
        ("banding", "band/gain-C/wave", None, {"C": ink()}, "bands across the page"),
    ],
)  # fmt: skip
def test_an_ink_that_the_sensors_cannot_tell_from_others_is_not_named(
    kind: str, name: str, region: Region | None, inks: dict[str, Ink], words: str
) -> None:
    assert reason_for(kind, statistic(name), region, inks, registration(), distinct="") == words


def sensor(white: float, *solids: float) -> Any:
    """A sensor that sees so much light of paper and of each solid ink."""
    mean_dn = np.full((33, 33, 33, 33), white)
    for ink_at, solid in enumerate(solids):
        node = [0, 0, 0, 0]
        node[ink_at] = -1
        mean_dn[tuple(node)] = solid
    return SimpleNamespace(mean_dn=mean_dn, white_dn=white)


def test_one_sensor_tells_no_ink_from_another() -> None:
    assert distinct_inks([sensor(3000.0, 500.0, 700.0, 2500.0, 100.0)]) == frozenset()


def test_two_sensors_that_answer_alike_tell_no_ink_from_another() -> None:
    alike = sensor(3000.0, 500.0, 700.0, 2500.0, 100.0)
    assert distinct_inks([alike, alike]) == frozenset()


def test_red_green_and_blue_tell_all_inks_apart() -> None:
    red = sensor(3000.0, 300.0, 2700.0, 2900.0, 100.0)
    green = sensor(3000.0, 1800.0, 300.0, 2600.0, 100.0)
    blue = sensor(3000.0, 2500.0, 1500.0, 300.0, 100.0)
    assert distinct_inks([red, green, blue]) == frozenset("CMYK")


def test_an_ink_that_no_sensor_sees_is_not_named_and_hides_no_other() -> None:
    red = sensor(3000.0, 300.0, 2700.0, 3000.0, 100.0)
    green = sensor(3000.0, 1800.0, 300.0, 3000.0, 100.0)
    assert distinct_inks([red, green]) == frozenset("CMK")


def test_a_wrong_page_says_where_it_lies_or_why_it_is_not_found() -> None:
    moved = reason_for("wrong-page", None, None, {}, registration(shift_mm=(2.3, -0.1)), distinct="")
    assert moved == "the page is +2.3, -0.1 mm and +0.00 degrees off its position"
    lost = reason_for("wrong-page", None, None, {}, registration(located=False), distinct="")
    assert lost == "the scan does not show this page: too little is printed to locate the page"


def test_places_are_of_the_page_and_inside_it() -> None:
    strongest = [
        ("box/add-K+", statistic("box/add-K+/4", (9.0, 19.0, 2.0, 2.0))),
        ("box/gain-K+", statistic("box/gain-K+/4", (9.5, 19.5, 1.0, 1.0))),  # the same place again
        ("band/light", statistic("band/light/row", (0.0, 50.0, math.inf, 0.5))),
        ("fit/white", statistic("fit/white")),
    ]
    regions = regions_of(
        strongest,
        ["spots-voids", "scum", "banding", "unknown"],
        shift_mm=(-1.0, -1.0),
        size_mm=(100.0, 150.0),
    )
    assert [region.kind for region in regions] == ["spots-voids", "banding"]
    assert (regions[0].x_mm, regions[0].y_mm, regions[0].width_mm) == (10.0, 20.0, 2.0)
    assert (regions[1].x_mm, regions[1].width_mm) == (1.0, 99.0)
    assert regions[1].y_mm == 51.0


@pytest.mark.parametrize("down", [-1, 0, 1])
@pytest.mark.parametrize("across", [-1, 0, 1])
@pytest.mark.parametrize("last_bits", [-1e-6, 0.0, 1e-6])
def test_of_boxes_that_overlap_by_half_the_first_alone_is_a_place_on_every_processor(
    across: int, down: int, last_bits: float
) -> None:
    side = 2 * 0.42333
    first, shift_mm = (23.94712, 10.65433, side, side), (-0.00499, -0.00503)
    second = first[0] + across * side / 2 + last_bits, first[1] + down * side / 2 - last_bits, side, side
    third = first[0] + side + last_bits, first[1], side, side
    names = "box/add-K+", "box/gain-K+", "box/add-C+"
    strongest = [
        (name, statistic(f"{name}/2", box)) for name, box in zip(names, (first, second, third), strict=True)
    ]
    found = regions_of(strongest, ["scum"] * 3, shift_mm=shift_mm, size_mm=(36.0, 44.0))
    assert [(region.x_mm, region.y_mm) for region in found] == [
        (round(x - shift_mm[0], 2), round(y - shift_mm[1], 2)) for x, y, *_ in (first, third)
    ]


def test_without_a_place_it_is_the_page_as_a_whole() -> None:
    regions = regions_of(
        [("fit/white", statistic("fit/white"))], ["unknown"], shift_mm=(1.0, 0.0), size_mm=(100.0, 150.0)
    )
    assert [(r.x_mm, r.y_mm, r.width_mm, r.height_mm) for r in regions] == [(0.0, 0.0, 100.0, 150.0)]
    assert regions_of([], [], shift_mm=(0.0, 0.0), size_mm=(1.0, 1.0)) == ()


def test_a_lost_place_alone_is_no_other_page() -> None:
    lost, placed = registration(located=False), registration()
    assert supported("wrong-page", lost, "CMYK") == "unknown"
    assert supported("wrong-page", placed, "CMYK") == "wrong-page"
    assert supported("streak", lost, "CMYK") == "streak"
    assert [supported("swapped-planes", placed, inks) for inks in ("K", "CK")] == [
        "density",
        "swapped-planes",
    ]
    why = "the position of the page cannot be determined: too little is printed to locate the page"
    assert reason_for("unknown", None, None, {}, lost, distinct=()) == why

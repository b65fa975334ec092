"""Zones drawn in a browser: by mouse, by touch, by keyboard and by fields; priced, cancelled, saved."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest
from packages.console.tests.browser.test_fit_for_use import fit_for_everybody
from packages.console.tests.test_zones import job_of
from packages.console.tests.zone_prices import endless, quick

from prooflight_console.accounts.roles import Role
from prooflight_console.zones.prices import Prices

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from packages.console.tests.browser.conftest import Visitor
    from packages.console.tests.browser.serving import Serving
    from playwright.sync_api import Page

    from prooflight.press.artefact import Press


@pytest.fixture
def drawing(
    serve: Callable[..., Serving],
    journal: Path,
    visit: Callable[..., Visitor],
    tmp_path: Path,
    trained_press: Press,
) -> Callable[..., Page]:
    """Opens the page on which zones of a letter are drawn, as an engineer."""
    job, artefact = job_of(tmp_path), tmp_path / "my.press"
    trained_press.save(artefact)

    def opened(work: Any = quick, **window: Any) -> Page:
        console = serve(journal, prices=Prices(work), jobs=(job,), presses=(artefact,))
        console.person(Role.ENGINEER)
        page = visit(console, **window).signed_in("engineer").goto("/setup/zones/1")
        page.wait_for_selector("#desk[data-ready='1']")
        page.wait_for_selector("#proposals[data-ready='1']", state="attached")
        return page

    return opened


def at(page: Page, x_mm: float, y_mm: float) -> tuple[float, float]:
    """Where on the screen a place of the page lies."""
    found = page.evaluate(
        """([x, y]) => {
            const frame = one("zones").getBoundingClientRect(), view = one("zones").viewBox.baseVal;
            return [frame.left + ((x - view.x) / view.width) * frame.width,
                    frame.top + ((y - view.y) / view.height) * frame.height];
        }""",
        [x_mm, y_mm],
    )
    return found[0], found[1]


def drag(page: Page, first: tuple[float, float], last: tuple[float, float]) -> None:
    page.mouse.move(*at(page, *first))
    page.mouse.down()
    page.mouse.move(*at(page, *last), steps=4)
    page.mouse.up()


def boxes(page: Page) -> dict[str, list[float]]:
    drawn = json.loads(page.evaluate("Draft.text()"))
    return {one["name"]: one["rectangle_mm"] for one in drawn}


def test_zones_are_drawn_moved_resized_priced_and_saved(drawing: Callable[..., Page], tmp_path: Path) -> None:
    page = drawing()
    page.click("[data-tool=careful]")
    drag(page, (10, 12), (40, 42))
    assert boxes(page)["careful 1"] == pytest.approx([10, 12, 30, 30], abs=0.4)
    drag(page, (25, 27), (30, 32))
    assert boxes(page)["careful 1"] == pytest.approx([15, 17, 30, 30], abs=0.5)
    page.click("[data-tool=look]")
    drag(page, (45, 47), (50, 57))  # its lower right corner
    assert boxes(page)["careful 1"] == pytest.approx([15, 17, 35, 40], abs=0.6)

    page.click("#ask-price")
    page.wait_for_selector("body[data-price=done]")
    assert "Rest of the page" in page.inner_text("#price")
    assert "one good page in 100" in page.inner_text("#price")
    page.fill("#chosen [name=width]", "20")  # another state: the price is of the one before
    page.keyboard.press("Tab")
    assert page.is_disabled("#save")
    page.click("#undo")
    assert page.is_enabled("#save")
    page.click("#save")
    page.wait_for_selector("body[data-saved]")
    kept = json.loads((tmp_path / "letter.zones.json").read_text())
    assert kept["price"]["prints"] == 90
    assert kept["zones"][0]["rectangle_mm"] == boxes(page)["careful 1"]

    page.click(".zone-list button")
    page.click("#delete")
    assert page.inner_text("#save") == "Delete all zones"
    page.click("#save")
    page.wait_for_selector("body[data-saved]")
    assert not (tmp_path / "letter.zones.json").exists()


def test_zones_are_drawn_with_the_keyboard_alone(drawing: Callable[..., Page]) -> None:
    page = drawing()
    page.focus("#add")
    page.keyboard.press("Enter")
    page.keyboard.type("price tag")
    for value in ("Tab", "Tab", "Tab"):  # kind, pages, from left
        page.keyboard.press(value)
    page.keyboard.type("12.5")
    page.keyboard.press("Tab")
    x, y, width, height = boxes(page)["price tag"]
    assert x == 12.5
    page.focus(".zone")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Control+ArrowDown")
    page.keyboard.press("Shift+ArrowRight")
    assert boxes(page)["price tag"] == pytest.approx([13.5, y + 0.1, width + 1, height])
    page.keyboard.press("Delete")
    assert boxes(page) == {}
    page.keyboard.press("Control+z")
    assert list(boxes(page)) == ["price tag"]
    page.reload()  # what was drawn is not lost
    page.wait_for_selector("#desk[data-ready='1']")
    assert boxes(page)["price tag"] == pytest.approx([13.5, y + 0.1, width + 1, height])


def test_zones_are_drawn_with_a_finger(drawing: Callable[..., Page]) -> None:
    page = drawing(has_touch=True, viewport={"width": 1024, "height": 768})
    page.tap("[data-tool=ignore]")
    touches = page.context.new_cdp_session(page)
    for kind, place in (("touchStart", (20, 30)), ("touchMove", (30, 40)), ("touchMove", (45, 60))):
        x, y = at(page, *place)
        touches.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": x, "y": y}]})
    touches.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    page.wait_for_selector(".zone.ignore")
    assert boxes(page)["ignored 1"] == pytest.approx([20, 30, 25, 30], abs=0.6)


def test_names_of_small_zones_lie_beside_them_and_over_no_other(drawing: Callable[..., Page]) -> None:
    page = drawing(has_touch=True, viewport={"width": 1024, "height": 768})
    places = {
        "numbering": [10.0, 10.0, 3.0, 3.0],
        "price tag": [16.0, 10.0, 3.0, 3.0],
        "stamp": [13.0, 16.0, 3.0, 3.0],
        "at the right edge": [73.0, 50.0, 3.0, 4.0],
        "at the lower edge": [30.0, 98.0, 4.0, 3.0],
        "large enough": [20.0, 60.0, 50.0, 20.0],
        "large as well": [21.3, 25.7, 47.1, 21.9],
    }
    drawn = [
        {"name": name, "kind": "ignore", "pages": "all", "rectangle_mm": place, "polygon_mm": None}
        for name, place in places.items()
    ]
    page.evaluate("zones => { Draft.zones = zones; Draft.changed(); }", drawn)
    found: dict[str, list[list[float]]] = page.evaluate(
        """() => {
            const box = (part) => {
                const { x, y, width, height } = part.getBoundingClientRect();
                return [x, y, width, height];
            };
            const all = (which) => [...document.querySelectorAll(which)];
            return {
                names: Object.fromEntries(all("#zones text").map((part) => [part.textContent, box(part)])),
                zones: Object.fromEntries(all("#zones .zone").map(
                    (part) => [here()[part.dataset.at].name, box(part.querySelector(".halo"))])),
                desk: box(document.getElementById("zones")),
            };
        }"""
    )
    names, zones, desk = found["names"], found["zones"], found["desk"]
    assert names.keys() == zones.keys() == places.keys(), "each is named, and whole"
    for name, place in names.items():
        others = [zone for other, zone in zones.items() if other != name]
        others += [label for other, label in names.items() if other != name]
        assert not any(shared(place, other) > 1 for other in others), f"{name} hides another"
        assert shared(place, desk) == pytest.approx(place[2] * place[3], rel=0.02), f"{name} is cut off"
        inside = shared(place, zones[name]) > 0.9 * place[2] * place[3]
        assert inside == name.startswith("large"), name


def shared(one: list[float], other: list[float]) -> float:
    """Area that two boxes share."""
    sides = [min(one[at] + one[at + 2], other[at] + other[at + 2]) - max(one[at], other[at]) for at in (0, 1)]
    return max(sides[0], 0.0) * max(sides[1], 0.0)


def test_a_price_is_cancelled_and_the_page_is_fit_for_everybody(drawing: Callable[..., Page]) -> None:
    page = drawing(endless)
    page.click("#add")
    page.click("#ask-price")
    page.wait_for_selector("#bar-text:has-text('Good prints: 3 of 90')")
    fit_for_everybody(page)
    page.click("#cancel")
    page.wait_for_selector("body[data-price=cancelled]")
    assert page.is_disabled("#save")

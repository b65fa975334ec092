"""Zones in Set up: fit for everybody, and the picture is there."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from packages.console.tests.browser.test_fit_for_use import fit_for_everybody
from packages.console.tests.test_zones import job_of, zones

from prooflight.pages.zones.zones_file import PriceEntry
from prooflight_console.accounts.roles import Role

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from packages.console.tests.browser.conftest import Visitor
    from packages.console.tests.browser.serving import Serving


def row(name: str, kind: str, before: float | None, after: float | None) -> dict[str, Any]:
    def told(value: float | None) -> dict[str, Any]:
        return {sort: {"least": value, "low": value, "high": value} for sort in ("spot", "streak", "density")}

    return {"name": name, "kind": kind, "pages": [1], "before": told(before), "after": told(after)}


def test_zones_are_shown_with_their_price(
    serve: Callable[..., Serving], journal: Path, visit: Callable[..., Visitor], tmp_path: Path
) -> None:
    job, made = job_of(tmp_path), zones()
    price = PriceEntry(
        press="x", zones=made.zones_digest, prints=90, seed=1, page_scores=(0.0, 1.0),
        careful_scores=(0.0, 1.0), careful_mean=(0.0,), careful_sd=(1.0,),
        told=(row("face", "careful", 2.0, 0.9), row("stamp", "ignore", 2.0, None), row("rest", "rest", 1.5, 1.6)),
    )  # fmt: skip
    made.priced(price).save(tmp_path / "letter.zones.json")
    console = serve(journal, jobs=(job,))
    console.person(Role.VIEWER)
    visitor = visit(console).signed_in("viewer")
    page = visitor.goto("/setup")
    page.click("a[href='/setup/zones']")
    page.wait_for_selector(".zones-picture")
    assert page.evaluate("document.querySelector('.zones-picture').naturalWidth") > 500
    fit_for_everybody(page)

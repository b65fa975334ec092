"""Zones of a PDF are priced, saved, and then in force: in ``inspect`` and in ``watch``."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.cli.calls import prooflight

from prooflight.pages.files import write_tiff
from prooflight.pages.job import JobSource
from prooflight.pages.zones.zones_file import JobZones
from prooflight.press.artefact import Press
from prooflight.scans.recorded import recorded_scans, write_scan
from prooflight_line.journal.journal import Journal

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.pages.raster import Page


@pytest.fixture
def small(tmp_path: Path, make_page: Callable[..., Page], trained_press: Press) -> Path:
    """A folder with a job of one page, its press, a scan and zones."""
    page = make_page(2, number=1)
    (tmp_path / "job").mkdir()
    (tmp_path / "scans").mkdir()
    write_tiff(page, tmp_path / "job/p0001.tif")
    trained_press.save(tmp_path / "my.press")
    zones = {
        "zones": [
            {"name": "face", "kind": "careful", "rectangle_mm": [20, 26, 10, 12]},
            {"name": "stamp", "kind": "ignore", "rectangle_mm": [8, 8, 12, 14]},
        ]
    }
    (tmp_path / "job.zones.json").write_text(json.dumps(zones))
    return tmp_path


def test_zones_are_priced_saved_and_then_in_force(
    small: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    at = {name: small / name for name in ("job", "my.press", "job.zones.json", "scans")}
    on_press = ["--press", at["my.press"]]
    made = [at["job"], *on_press, "--world", "press", "-o", at["scans"]]
    assert prooflight(monkeypatch, "simulate", *made) == 0
    before = at["job.zones.json"].read_bytes()
    capsys.readouterr()
    watched = [at["job"], at["scans"], *on_press, "--zones", at["job.zones.json"], "--json"]
    assert prooflight(monkeypatch, "inspect", *watched) == 2
    assert "have not been priced" in " ".join(capsys.readouterr().err.split())
    priced = ["zones", "price", at["job.zones.json"], at["job"], *on_press, "--json"]
    assert prooflight(monkeypatch, *priced, "--prints", 12, "--trials", 0) == 0
    assert at["job.zones.json"].read_bytes() == before  # nothing is saved unasked
    capsys.readouterr()
    assert prooflight(monkeypatch, *priced, "--prints", 24, "--trials", 3, "--save") == 0
    told = json.loads(capsys.readouterr().out)
    assert [(one["name"], one["kind"]) for one in told["zones"]] == [
        ("face", "careful"),
        ("stamp", "ignore"),
        ("the rest of the page", "rest"),
    ]
    assert told["saved"]
    assert told["promised"] == pytest.approx(0.1)
    for row in told["zones"]:
        assert set(row["before"]) == set(row["after"]) == {"spot", "streak", "density"}
        if row["kind"] == "ignore":
            assert all(one["least"] is None for one in row["after"].values())
    kept: dict[str, Any] = json.loads(at["job.zones.json"].read_text())
    assert kept["price"]["prints"] == 24
    assert len(kept["price"]["careful_scores"]) == 16
    assert prooflight(monkeypatch, "inspect", *watched) in (0, 1)
    _watched_with_zones(small, on_press, monkeypatch, capsys)
    kept["zones"][0]["rectangle_mm"][0] = 18
    at["job.zones.json"].write_text(json.dumps(kept))
    assert prooflight(monkeypatch, "inspect", *watched) == 2
    assert "changed after they had been priced" in " ".join(capsys.readouterr().err.split())


def _watched_with_zones(
    small: Path, on_press: list[object], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A run takes zones that are in force: what a stamp leaves in its zone passes, and alarms where none is."""
    job, zones, stamped = small / "job", small / "job.zones.json", small / "stamped"
    press = Press.load(small / "my.press")
    (scan,) = recorded_scans(small / "scans", sensors=len(press.sensors))
    dn, (page_mm, _) = scan.read(), JobSource(path=job, dpi=press.dpi).open().page_size_mm(1)
    x = press.geometry.centres_x_mm(page_mm)
    y = press.geometry.centres_y_mm(dn.shape[1])
    stamp = ((y > 12) & (y < 17))[:, None] & (x > 11) & (x < 17)  # within the ignored zone
    dn[:, stamp] = np.uint16(dn.min())
    stamped.mkdir()
    write_scan(stamped / "p0001.tif", dn, facts={})
    run = ["watch", job, *on_press, "--source", f"replay:{stamped}", "--keep", "all", "--json"]
    found = []
    for number, with_zones in enumerate(([], ["--zones", zones])):
        journal = small / f"run{number}.sqlite"
        capsys.readouterr()
        prooflight(monkeypatch, *run, *with_zones, "--journal", journal)
        with Journal.open(str(journal), read_only=True) as opened:
            last = opened.last_run()
            (page,) = opened.pages(last.id)
            found.append(
                (page.verdict.verdict, last.facts.settings.get("zones"), opened.page(last.id, 0).evidence)
            )
    digest = JobZones.read(zones, JobSource(path=job, dpi=press.dpi).open().page_sizes_mm).digest
    assert [(verdict, told) for verdict, told, _ in found] == [("misprint", None), ("good", digest)]
    assert "careful" in (found[1][2] or {})
    assert "careful" not in (found[0][2] or {})
    changed = small / "changed.zones.json"
    document = json.loads(zones.read_text())
    document["zones"][1]["rectangle_mm"][0] += 1
    changed.write_text(json.dumps(document))
    journal = small / "refused.sqlite"
    assert prooflight(monkeypatch, *run, "--zones", changed, "--journal", journal) == 2
    assert "changed after they had been priced" in " ".join(capsys.readouterr().err.split())
    assert not journal.exists(), "no run began"

"""Zones by commands: from a PDF by rules, priced, and in force."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pymupdf
import pytest
from PIL import Image
from tests.cli.calls import prooflight

from prooflight.commissioning.zones.defects import (
    SORTS,
    Range,
    Trial,
    areas_of,
    caught,
    disc,
    next_strength,
    with_defect,
)
from prooflight.pages.zones.zone import PageZones, Zone
from prooflight.press.artefact import Press
from prooflight.simulation.scans import simulate

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.pages.raster import Page

A7 = (210.0, 297.0)
"""Of the PDF. [points]"""


def write_pdf(path: Path) -> None:
    """A page whose TrimBox is 10 points inside its MediaBox, with a layer, a BleedBox within and a stamp."""
    document = pymupdf.Document()
    page = document.new_page(width=A7[0] + 20, height=A7[1] + 20)
    page.set_trimbox(pymupdf.Rect(10, 10, A7[0] + 10, A7[1] + 10))
    page.set_bleedbox(pymupdf.Rect(20, 20, A7[0], A7[1]))
    faces = document.add_ocg("Faces")
    page.draw_rect(pymupdf.Rect(60, 80, 130, 160), fill=(0.2, 0.4, 0.6), oc=faces)
    page.insert_text((30, 200), "not in any layer")
    stamp = page.add_rect_annot(pymupdf.Rect(150, 250, 200, 280))
    stamp.set_info(title="Numbering")
    stamp.update()
    document.save(path)


def test_a_pdf_says_where_its_layers_boxes_and_annotations_lie(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_pdf(tmp_path / "job.pdf")
    out = tmp_path / "job.zones.json"
    rules = ["--layer", "faces=careful", "--annotation", "Numbering=ignore", "--outside-bleed", "ignore"]
    assert prooflight(monkeypatch, "job", "zones", tmp_path / "job.pdf", "-o", out, *rules, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    zones = {one["name"]: one for one in told["zones"]["zones"]}
    point = 25.4 / 72
    # From the TrimBox's corner, with half a line's width about what is drawn.
    for name, corners in (("faces", (50, 70, 70, 80)), ("Numbering", (140, 240, 50, 30))):
        assert np.allclose(zones[name]["rectangle_mm"], np.multiply(corners, point), atol=0.75), name
    assert zones["outside BleedBox, above"]["rectangle_mm"] == pytest.approx(
        [0, 0, 210 * point, 10 * point], abs=0.01
    )
    assert json.loads(out.read_text())["zones"] == [
        {name: value for name, value in one.items() if value is not None} for one in told["zones"]["zones"]
    ]
    picture = tmp_path / "zones.png"
    assert prooflight(monkeypatch, "zones", "show", out, tmp_path / "job.pdf", "--picture", picture) == 0
    assert "faces" in capsys.readouterr().out
    with Image.open(picture) as image:
        assert image.height > image.width > 500


def test_rules_that_find_nothing_write_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_pdf(tmp_path / "job.pdf")
    out = tmp_path / "job.zones.json"
    code = prooflight(monkeypatch, "job", "zones", tmp_path / "job.pdf", "-o", out, "--layer", "Logo=careful")
    assert code == 2
    assert "no page has a layer 'Logo': there are Faces" in " ".join(capsys.readouterr().err.split())
    assert not out.exists()


WITHIN = Range(low=0.1, high=10.0)


def test_what_is_caught_at_99_percent_is_found_from_trials() -> None:
    """Prints are caught by a normal law about 1 with a spread of 0.3 in the logarithm: 99 % from exp(0.3 x 2.33) = 2.0.

    200 trials at strengths chosen on the way tell it to a few per cent; a tenth of what the range spans is allowed.
    """
    rng = np.random.default_rng(3)
    trials: list[Trial] = []
    for _ in range(200):
        strength = next_strength(trials, WITHIN, rng, false_alarms=0.01)
        assert WITHIN.low <= strength <= WITHIN.high
        trials.append(Trial(strength=strength, caught=bool(np.log(strength) > 0.3 * rng.standard_normal())))
    found = caught(trials, WITHIN, false_alarms=0.01)
    assert found.low <= 2.0 <= found.high
    assert found.least == pytest.approx(2.0, rel=0.35)


@pytest.mark.parametrize("seen", [True, False])
def test_what_is_always_or_never_caught(seen: bool) -> None:
    rng = np.random.default_rng(4)
    trials: list[Trial] = []
    for _ in range(30):
        trials.append(Trial(strength=next_strength(trials, WITHIN, rng, false_alarms=0.01), caught=seen))
    found = caught(trials, WITHIN, false_alarms=0.01)
    assert found.ever == seen
    assert (found.least < 1.0) if seen else np.isinf(found.high)


@pytest.mark.parametrize("diameter_mm", [0.15, 0.3, 1.0, 2.0])
def test_a_disc_covers_its_area_wherever_it_lies(diameter_mm: float) -> None:
    """In the mean over 50 places (seed 3), to 1 %; with its edge at its radius a spot of 0.15 mm is 16 % too large."""
    rng, pixel_mm = np.random.default_rng(3), 0.1
    at = (np.arange(60) - 29.5) * pixel_mm
    covered = []
    for x, y in rng.uniform(-0.5, 0.5, (50, 2)) * pixel_mm:
        apart = np.hypot(at - x, (at - y)[:, None])
        covered.append(disc(apart, diameter_mm=diameter_mm, pixel_mm=pixel_mm).sum() * pixel_mm**2)
    assert np.mean(covered) == pytest.approx(np.pi * diameter_mm**2 / 4, rel=0.01)


@pytest.mark.parametrize("sort", [sort.name for sort in SORTS])
def test_a_defect_lies_in_its_area_alone(
    sort: str, trained_press: Press, make_page: Callable[..., Page]
) -> None:
    page = trained_press.geometry.lay(make_page(2, number=1))
    dn = simulate(page, trained_press, seed=2).dn
    zones = PageZones(zones=(Zone.rectangle("face", "careful", (10, 10, 12, 12)),), careful_share=0.2)
    face, rest = areas_of(zones)
    assert (face.kind, rest.kind) == ("careful", "rest")
    spoilt = with_defect(
        dn, sort, 2.0 if sort == "spot" else 80.0, face,
        page=page, press=trained_press, shift_mm=(0.0, 0.0), rng=np.random.default_rng(1),
    )  # fmt: skip
    assert spoilt is not None
    x, y = (
        trained_press.geometry.centres_x_mm(page.width_mm),
        trained_press.geometry.centres_y_mm(dn.shape[1]),
    )
    changed = np.argwhere(spoilt[0] != dn[0])
    assert len(changed) > 50
    reach = 1.5  # half a spot and the lens
    assert y[changed[:, 0]].min() > 10 - reach
    assert y[changed[:, 0]].max() < 22 + reach
    assert x[changed[:, 1]].min() > 10 - reach
    assert x[changed[:, 1]].max() < 22 + reach

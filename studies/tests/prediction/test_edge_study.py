from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from reportlab.pdfgen import canvas

from prooflight.camera.camera import with_pixels
from prooflight.errors import RequestError
from prooflight.pages.pdf.rip import PdfJob
from prooflight_studies.edges import rig as edge_rig
from prooflight_studies.edges import study as edge_study
from prooflight_studies.edges.rig import (
    Band,
    Rig,
    Sheet,
    averaged,
    in_columns,
    predicted,
    rip_part,
    sampled,
    truth,
    with_round_footprint,
)
from prooflight_studies.edges.study import ErrorSum

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.press.press_file import PressFile

MM = 72 / 25.4
PIXELS = 300


@pytest.fixture(scope="module")
def pdf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small page of bars at places that no raster meets, with a line of text."""
    path = tmp_path_factory.mktemp("pages") / "bars.pdf"
    drawing = canvas.Canvas(str(path), pagesize=(24 * MM, 40 * MM), invariant=1)
    drawing.setFillColorCMYK(0, 0, 0, 1)
    rng = np.random.default_rng(4)
    for x, y in rng.uniform(2, 36, (60, 2)):
        drawing.rect(x * MM, y * MM, 0.37 * MM, 1.91 * MM, stroke=0, fill=1)
    drawing.setFont("Helvetica", 9)
    drawing.drawString(4 * MM, 19 * MM, "a line of text")
    drawing.save()
    return path


@pytest.fixture(scope="module")
def rig(prototype: PressFile) -> Rig:
    return Rig.build(prototype, pixels=PIXELS)


@pytest.fixture(scope="module")
def sheet(rig: Rig, pdf: Path) -> Sheet:
    return Sheet.lay(rig, pdf, band_mm=8.0)


def rms_at_edges(predicted_dn: np.ndarray, true: Band) -> float:
    gathered = ErrorSum(name="")
    gathered.add(predicted_dn[true.lines], true)
    return gathered.row().edge_rms_sigma


def test_a_part_of_the_page_is_the_page_there(pdf: Path) -> None:
    dpi = 10 * 25.4  # a raster pixel is 0.1 mm: the part begins on a whole one
    with PdfJob(pdf) as job:
        whole = job.page(1, dpi)
    part = rip_part(pdf, 10.0, 30.0, dpi=dpi)
    assert part.cmyk.shape == (200, whole.cmyk.shape[1], 4)
    different = (part.cmyk != whole.cmyk[100:300]).any(axis=2)
    assert part.cmyk.any()
    assert different.mean() < 0.005  # edges that fall between pixels may round to either side


def test_a_page_that_is_turned_or_too_wide_is_refused(rig: Rig, pdf: Path, tmp_path: Path) -> None:
    import pymupdf

    with pymupdf.open(pdf) as document:
        document[0].set_rotation(90)
        document.save(tmp_path / "turned.pdf")
    with pytest.raises(RequestError, match=r"turned\.pdf: is turned, scaled or cropped"):
        rip_part(tmp_path / "turned.pdf", 1.0, 5.0, dpi=100)
    with pytest.raises(RequestError, match=r"turned\.pdf: is 40\.0 mm wide; choose pages at most 31"):
        Sheet.lay(rig, tmp_path / "turned.pdf")


def test_from_its_own_raster_the_product_predicts_edges_to_a_fraction_of_sigma(
    rig: Rig, sheet: Sheet
) -> None:
    with PdfJob(sheet.pdf) as job:
        page = job.page(1, rig.press.geometry.raster_dpi(2))
    true = truth(rig, sheet, page, sheet.bands[1])
    assert true.edges.sum() > 1000
    short = predicted(rig, sheet, page, corrected=False)
    plain = rms_at_edges(in_columns(rig, short), true)
    round_ = rms_at_edges(in_columns(rig, with_round_footprint(rig, short)), true)
    ours = rms_at_edges(in_columns(rig, predicted(rig, sheet, page)), true)
    # table error and column calibration are 0.05 and 0.02 of sigma
    assert round_ < 0.25
    assert ours < 0.25
    assert plain > 10 * ours


def test_coarser_rasters_place_edges_worse(rig: Rig, sheet: Sheet) -> None:
    fine, top_mm = sheet.part(rig, sheet.bands[1], 8)
    true = truth(rig, sheet, fine, sheet.bands[1], top_mm=top_mm)
    errors = []
    with PdfJob(sheet.pdf) as job:
        for s in (1, 2, 4):
            page = job.page(1, rig.press.geometry.raster_dpi(s))
            errors.append(rms_at_edges(in_columns(rig, predicted(rig, sheet, page)), true))
    own = in_columns(rig, predicted(rig, sheet, fine, top_mm=top_mm))
    errors.append(rms_at_edges(own, true))
    assert errors == sorted(errors, reverse=True)
    assert errors[1] > 10 > errors[3]


def test_averaged_signals_come_close_to_the_whole_raster(rig: Rig, sheet: Sheet) -> None:
    page, top_mm = sheet.part(rig, sheet.bands[1], 8)
    ones = averaged(rig, page, 1)
    twos = averaged(rig, page, 2)
    np.testing.assert_allclose(twos[3, 5], ones[6:8, 10:12].mean(), rtol=1e-6)
    signal = predicted(rig, sheet, page, top_mm=top_mm)
    seen = sampled(rig, sheet, ones, raster_pixel_mm=page.pixel_mm, top_mm=top_mm)
    band = sheet.bands[1]
    # the same table and footprint; the page's left edge is rounded to an eighth of a pixel
    width_mm = page.cmyk.shape[1] * page.pixel_mm
    same = replace(sheet, width_mm=width_mm)
    np.testing.assert_allclose(
        sampled(rig, same, ones, raster_pixel_mm=page.pixel_mm, top_mm=top_mm)[band],
        predicted(rig, same, page, top_mm=top_mm)[band],
        atol=0.02,
    )
    assert np.abs(seen[band] - signal[band]).max() < 0.1 * rig.press.sensors[0].white_dn


def test_errors_are_gathered_and_a_shift_is_found() -> None:
    y, x = np.mgrid[0:40, 0:50]
    true_dn = 1000 + 300 * np.sin(x / 5) + 200 * np.cos(y / 7)
    sigma = np.full(true_dn.shape, 2.0)
    edges = np.zeros(true_dn.shape, bool)
    edges[5:-5, 5:-5] = True
    band = Band(lines=slice(0, 40), mean_dn=true_dn, sigma_dn=sigma, edges=edges)
    moved = 1000 + 300 * np.sin((x - 0.1) / 5) + 200 * np.cos((y + 0.05) / 7)  # right by 0.1, up by 0.05
    gathered = ErrorSum(name="moved")
    gathered.add(moved, band)
    row = gathered.row()
    z = (moved - true_dn) / sigma
    assert row.edge_rms_sigma == pytest.approx(np.sqrt((z[edges] ** 2).mean()))
    assert row.all_rms_sigma == pytest.approx(np.sqrt((z**2).mean()))
    assert row.edge_median_sigma == pytest.approx(np.median(np.abs(z[edges])), rel=0.02)
    assert (row.right_pixels, row.down_pixels) == (
        pytest.approx(0.1, abs=2e-3),
        pytest.approx(-0.05, abs=2e-3),
    )
    assert row.shifted_edge_rms_sigma < 0.05 * row.edge_rms_sigma
    assert row.edge_pixels == 30 * 40


def test_pages_are_chosen_by_the_criterion(tmp_path: Path) -> None:
    def entry(name: str, **other: object) -> dict[str, object]:
        usual = {"strata": ["dense text"], "chars": 900, "img_frac": 0.0, "w_pt": 595, "h_pt": 842}
        return {"id": name, **usual, **other}

    entries = [
        entry("few", chars=20),
        entry("wide", w_pt=842),
        entry("pictures", img_frac=0.5),
        entry("other", strata=["dense text", "CMYK"]),
        entry("lines", strata=["line art/tables"]),
        *(entry(f"text{number}") for number in range(7)),
    ]
    (tmp_path / "pages_manifest.json").write_text(json.dumps(entries))
    chosen = [path.stem for path in edge_study.choose_pages(tmp_path / "pages")]
    assert chosen == ["text0", "text1", "text2", "text3", "text4", "lines"]
    with pytest.raises(RequestError, match=r"pages_manifest\.json: is not there"):
        edge_study.choose_pages(tmp_path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "EOF"),
        ("[" * 100_000, "recursion limit"),
        ('{"id": "a"}', "valid array"),
        ('[{"id": "a"}]', r"1\.strata: Field required"),
        ('[{"id": "../x", "strata": [], "chars": 1, "img_frac": 0, "w_pt": 1}]', r"1\.id: .* match pattern"),
        ('[{"id": "x", "strata": [], "chars": 1, "img_frac": NaN, "w_pt": 1}]', "img_frac"),
    ],
)
def test_manifests_that_cannot_be_used(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "pages_manifest.json").write_text(text)
    with pytest.raises(RequestError, match=said) as refusal:
        edge_study.choose_pages(tmp_path / "pages")
    assert "pages_manifest.json: " in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_small_study_writes_its_page(
    rig: Rig, pdf: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(edge_study, "SUPERSAMPLINGS", (2,))
    monkeypatch.setattr(edge_study, "TRUTH", 4)  # the others take long
    monkeypatch.setattr(edge_study, "FINER_TRUTH", 5)
    monkeypatch.setattr(edge_rig, "BAND_CENTRES", (0.5,))
    study = edge_study.run_edge_study(tmp_path, tmp_path / "results", rig=rig, pdfs=[pdf])
    page = (tmp_path / "results" / "edges.md").read_text()
    assert "**Pages** (1): bars." in page
    assert "nan" not in page
    for row in (*study.from_vector, *study.same_raster):
        assert f"| {row.name} | {row.edge_rms_sigma:.1f}"[:-2] in page
    goal = {row.name: row.edge_rms_sigma for row in study.same_raster}["s = 2"]
    assert goal < 0.5
    assert f"through the exact camera: {goal:.2f} (met)" in page


def test_the_specimen_is_the_one_that_the_press_was_built_for(prototype: PressFile, rig: Rig) -> None:
    sensor = with_pixels(prototype.camera(), PIXELS).sensors[0]
    assert rig.camera.sensors[0].pixels == sensor.pixels
    gain = rig.patterns[0].gain * rig.camera.column_light()
    # calibration knows each column to 0.3 % / sqrt(4096), white's temporal noise being 0.3 %
    np.testing.assert_allclose(rig.press.sensors[0].column_gain, gain, rtol=6e-4)

"""`prooflight inspect --scanner`: scans of an office scanner in, one verdict a page out."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from prooflight.cli import run
from prooflight.commissioning.build import build_press
from prooflight.inspection.scanner.finding import ExpectedPages, placed_scans
from prooflight.pages.files import write_tiff
from prooflight.pages.raster import Page
from prooflight.press.artefact import Press
from prooflight.press.pages import job_source
from prooflight.press.scanner import feeder_of, scanner_press_file
from prooflight.scans.scanner.reading import ScannerSettings, scanned_pages


@pytest.fixture(scope="module")
def made(make_page: Callable[..., Page], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``x.press``, an office scanner's; ``job`` of two pages; ``scans``: page 2, then page 1 upside down."""
    folder = tmp_path_factory.mktemp("scanned")
    press = build_press(scanner_press_file(dpi=150, grey=True, width_mm=100), seed=1)
    press.save(folder / "x.press")
    (folder / "job").mkdir()
    (folder / "scans").mkdir()
    for number, name, turned in ((1, "b", True), (2, "a", False)):
        page = make_page(20 + number, width_mm=100, height_mm=120, dpi=300, number=number)
        write_tiff(page, folder / "job" / f"p{number:04d}.tif")
        sensor = press.sensors[0]
        lines = press.press_context().predict(page).expected_dn[0]
        light = (lines - sensor.column_offset_dn) / (sensor.column_gain * np.float32(sensor.white_dn))
        light = cv2.resize(light, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC).clip(0, 1)
        srgb = np.where(
            light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-6) ** (1 / 2.4) - 0.055
        )
        codes = np.rint(255 * srgb).astype(np.uint8)
        codes = codes[::-1, ::-1] if turned else codes
        Image.fromarray(np.ascontiguousarray(codes)).save(folder / "scans" / f"{name}.png", dpi=(300, 300))
    return folder


def inspected(capsys: pytest.CaptureFixture[str], *given: object) -> tuple[int, list[dict[str, object]], str]:
    capsys.readouterr()
    code = run(["inspect", *(str(one) for one in given), "--json"])
    captured = capsys.readouterr()
    rows = [json.loads(line) for line in captured.out.splitlines()]
    return code, [row for row in rows if "verdict" in row], captured.err


def test_sheets_are_inspected_in_any_order_and_either_way_up(
    made: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    press = Press.load(made / "x.press")
    pages = ExpectedPages(job=job_source(made / "job", press), press=press, feeder=feeder_of(press))
    pairs = placed_scans(scanned_pages(made / "scans"), pages, 2, settings=ScannerSettings())
    shown = [(number, scan.name, scan.where.turned, scan.trouble) for number, scan in pairs if scan]
    assert shown == [(1, "b", True, ""), (2, "a", False, "")]
    code, rows, err = inspected(
        capsys, made / "job", made / "scans", "--scanner", "--press", made / "x.press"
    )
    assert code in (0, 1), err  # this press was not trained: chi-square excuses nothing
    assert [row["page"] for row in rows] == ["p0001", "p0002"]
    assert all(row["verdict"] != "not-inspected" for row in rows), rows


def test_a_page_that_cannot_be_placed_is_not_inspected(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    noise = np.random.default_rng(3).integers(0, 256, (1417, 1181), np.uint8)
    Image.fromarray(noise).save(tmp_path / "noise.png", dpi=(300, 300))
    code, _, err = inspected(capsys, made / "job", tmp_path, "--scanner", "--press", made / "x.press")
    assert code == 2  # no page was inspected at all
    assert "the page could not be placed" in err


def test_what_is_stated_wrongly_ends_in_one_line(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Image.new("L", (200, 200)).save(tmp_path / "bare.png")
    scanner = ("--scanner", "--press", made / "x.press")
    for given, message in (
        ((made / "scans", "--press", made / "x.press", "--tone", "srgb"), "add --scanner"),
        ((made / "scans", *scanner, "--tone", "bright"), "there is no tone"),
        ((made / "scans", *scanner, "--scan-dpi", "3"), "not a resolution of a scan"),
        ((tmp_path, *scanner), "state it by --scan-dpi"),
        ((tmp_path / "none.pdf", *scanner), "no such file"),
    ):
        code, rows, err = inspected(capsys, made / "job", *given)
        assert (code, rows) == (2, [])
        assert message in err
        assert err.count("\n") == 1


def test_a_preset_is_written_as_a_press_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["press", "preset", "scanner", "--grey", "-o", str(tmp_path / "office.toml")]) == 0
    assert "[geometry]" in (tmp_path / "office.toml").read_text(encoding="utf-8")
    capsys.readouterr()
    for arguments, message in (
        (("flatbed",), "choose from prototype, two-sensors, rgb-line, scanner"),
        (("prototype", "--grey"), "do not apply to 'prototype'"),
    ):
        assert run(["press", "preset", *arguments]) == 2
        assert message in capsys.readouterr().err

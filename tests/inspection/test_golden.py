"""Inspection against a golden scan, of files: raw scans of the press world, RGB and grey pictures. Seeds fixed."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image

from prooflight.cli import run
from prooflight.detectors.disposition import without_gate
from prooflight.errors import ScanError
from prooflight.inspection.golden import GoldenInspector, GoldenPage, golden_pages
from prooflight.rng import stream
from prooflight.scans.pictures import picture_files
from prooflight.scans.recorded import write_scan
from prooflight.simulation.scans import scan_page
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import amounts_of

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

LINES, PIXELS = 300, 260
DPI = 254.0
"""Ten pixels in a millimetre."""


def sheet() -> np.ndarray:
    """Dark bars and rings on light paper, 8 bits."""
    rng = np.random.default_rng(4)
    drawn = np.full((LINES, PIXELS), 230, np.uint8)
    for _ in range(30):
        x, y = int(rng.integers(10, PIXELS - 60)), int(rng.integers(10, LINES - 30))
        cv2.rectangle(drawn, (x, y), (x + int(rng.integers(8, 50)), y + 8), 20, -1)
    cv2.circle(drawn, (130, 150), 60, 60, 5)
    return cv2.GaussianBlur(drawn, (0, 0), 0.8)


def spotted() -> np.ndarray:
    """The sheet with a dark spot where there was paper, 1.2 x 1.0 mm at (20, 25) mm."""
    drawn = sheet()
    drawn[250:260, 200:212] = 10
    return drawn


def saved(path: Path, pixels: np.ndarray, *, dpi: float | None = DPI, **how: Any) -> Path:
    resolution = {} if dpi is None else {"resolution": (dpi, dpi), "resolutionunit": "inch"}
    tifffile.imwrite(path, pixels, **resolution, **how)
    return path


def verdict_of(golden: Path, scan: Path) -> Any:
    (page,) = golden_pages(golden, scan)
    return GoldenInspector.of(None, page.goldens[0])(page)


FORMS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "8 bits": lambda image: image,
    "16 bits": lambda image: image.astype(np.uint16) * 257,
    "float": lambda image: image.astype(np.float32) / 255,
    "RGB": lambda image: np.stack([image, image, 255 - image], axis=-1),
}


@pytest.mark.parametrize("form", FORMS)
def test_a_spot_is_found_in_any_form_of_tiff(tmp_path: Path, form: str) -> None:
    made = FORMS[form]
    how = {"photometric": "rgb" if form == "RGB" else "minisblack"}
    golden = saved(tmp_path / "golden.tif", made(sheet()), **how)
    assert verdict_of(golden, saved(tmp_path / "same.tif", made(sheet()), **how)).verdict == "good"
    said = verdict_of(golden, saved(tmp_path / "spot.tif", made(spotted()), **how))
    assert (said.verdict, without_gate(said)[0], said.kind, said.page) == (
        "misprint",
        "stop",
        "spots-voids",
        "spot",
    )
    (region,) = said.regions
    assert (region.x_mm, region.y_mm) == pytest.approx((20.0, 25.0), abs=0.4)
    assert (region.width_mm, region.height_mm) == pytest.approx((1.2, 1.0), abs=0.6)


def test_white_is_zero_is_understood(tmp_path: Path) -> None:
    golden = saved(tmp_path / "golden.tif", sheet())
    scan = saved(tmp_path / "scan.tif", 255 - sheet(), photometric="miniswhite")
    assert verdict_of(golden, scan).verdict == "good"


def test_a_grey_golden_does_for_an_rgb_scan(tmp_path: Path) -> None:
    golden = saved(tmp_path / "golden.tif", sheet())
    Image.fromarray(np.stack([sheet()] * 3, axis=-1)).save(tmp_path / "scan.png")
    assert verdict_of(golden, tmp_path / "scan.png").verdict == "good"


def test_another_sheet_is_the_wrong_page(tmp_path: Path) -> None:
    golden = saved(tmp_path / "golden.tif", sheet())
    said = verdict_of(golden, saved(tmp_path / "scan.tif", np.ascontiguousarray(sheet()[:, ::-1])))
    assert (said.verdict, said.kind, said.shift_mm) == ("misprint", "wrong-page", None)
    assert "does not show" in said.reason


def test_a_page_far_off_is_the_wrong_page_and_says_by_how_much(tmp_path: Path) -> None:
    golden = saved(tmp_path / "golden.tif", sheet(), dpi=25.4)  # a millimetre a pixel
    moved = np.roll(sheet(), 4, axis=1)
    said = verdict_of(golden, saved(tmp_path / "scan.tif", moved, dpi=25.4))
    assert said.kind == "wrong-page"
    assert said.shift_mm == pytest.approx((4.0, 0.0), abs=0.2)


# --- which golden is whose ---


def test_goldens_belong_to_scans_of_their_names(tmp_path: Path) -> None:
    goldens, scans = tmp_path / "goldens", tmp_path / "scans"
    for folder, names in ((goldens, ("a", "b", "c")), (scans, ("b", "c"))):
        folder.mkdir()
        for name in names:
            saved(folder / f"{name}.tif", sheet())
    pages = golden_pages(goldens, scans)
    assert [(page.name, page.goldens[0].name) for page in pages] == [("b", "b"), ("c", "c")]


def test_pages_of_a_job_without_a_scan_are_not_inspected(tmp_path: Path) -> None:
    scans = tmp_path / "scans"
    scans.mkdir()
    golden = saved(tmp_path / "golden.tif", sheet())
    saved(scans / "p0002.tif", sheet())
    pages = golden_pages(golden, scans, lefts_mm=[0.0, 0.0])
    said = [GoldenInspector.of(None, golden_page.goldens[0])(golden_page) for golden_page in pages]
    assert [(one.page, one.verdict) for one in said] == [("p0001", "not-inspected"), ("p0002", "good")]


# --- what cannot be used ---


def test_three_goldens_for_two_scans(tmp_path: Path) -> None:
    for folder, names in (("goldens", ("x", "y", "z")), ("scans", ("1", "2"))):
        (tmp_path / folder).mkdir()
        for name in names:
            saved(tmp_path / folder / f"{name}.tif", sheet())
    with pytest.raises(ScanError, match="3 golden scans for 2 pages"):
        golden_pages(tmp_path / "goldens", tmp_path / "scans")


def test_a_golden_without_resolution_needs_a_press(tmp_path: Path) -> None:
    golden = saved(tmp_path / "golden.tif", sheet(), dpi=None)
    with pytest.raises(ScanError, match="states no resolution"):
        GoldenInspector.of(None, picture_files(golden)[0])


def test_a_scan_of_another_size(tmp_path: Path) -> None:
    golden = saved(tmp_path / "golden.tif", sheet())
    with pytest.raises(ScanError, match="its golden has 300 x 260"):
        verdict_of(golden, saved(tmp_path / "scan.tif", sheet()[:200]))


@pytest.mark.parametrize("shape", [(1, 1), (1, 300), (31, 40)])
def test_scans_too_small_to_be_compared(tmp_path: Path, shape: tuple[int, int]) -> None:
    small = saved(tmp_path / "small.tif", np.zeros(shape, np.uint8))
    with pytest.raises(
        ScanError, match=f"golden is of {shape[0]} lines x {shape[1]} pixels; 32 x 32 are the least"
    ):
        verdict_of(small, small)


def test_a_cmyk_file_is_no_scan(tmp_path: Path) -> None:
    path = saved(tmp_path / "page.tif", np.zeros((20, 20, 4), np.uint8), photometric="separated")
    with pytest.raises(ScanError, match="is separated"):
        picture_files(path)[0].read()


def test_a_damaged_file(tmp_path: Path) -> None:
    whole = saved(tmp_path / "whole.tif", sheet()).read_bytes()
    (tmp_path / "cut.tif").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ScanError, match=r"cut\.tif"):
        picture_files(tmp_path / "cut.tif")[0].read()


def test_without_golden_scans_and_press_are_needed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["inspect", str(saved(tmp_path / "job.tif", sheet()))]) == 2
    assert "SCANS is missing" in capsys.readouterr().err


# --- raw scans of a press ---


def printed(page: Page, press: Press, seed: int) -> np.ndarray:
    """A good print on another day of the press world."""

    def no_other(number: int) -> Page:
        raise AssertionError(number)

    return scan_page(
        page,
        press=press,
        request=None,
        others=(),
        fetch=no_other,
        rng=stream(seed, "print", page.number),
        session=Session.draw(amounts_of(press), press, stream(seed, "session")),
    ).dn


def test_a_press_world_scan_serves_as_golden(
    tmp_path: Path, press: Press, make_page: Callable[..., Page], capsys: pytest.CaptureFixture[str]
) -> None:
    page = make_page(3)
    cmyk = page.cmyk.copy()
    cmyk[400:430, 300:330] = (0, 0, 0, 255)  # 1.6 mm of black on a tint
    press.save(tmp_path / "x.press")
    (tmp_path / "scans").mkdir()
    for path, shown, seed in (
        ("golden.tif", page, 1),
        ("scans/p0001.tif", page, 2),
        ("scans/p0002.tif", replace(page, cmyk=cmyk), 3),
    ):
        write_scan(tmp_path / path, printed(shown, press, seed), facts={"unit": "DN"})
    code = run(
        [
            *("inspect", str(tmp_path / "scans"), "--golden", str(tmp_path / "golden.tif")),
            *("--press", str(tmp_path / "x.press"), "--json"),
        ]
    )
    good, bad = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert code == 1
    assert (good["page"], good["verdict"], good["regions"]) == ("p0001", "good", [])
    assert (bad["page"], bad["verdict"]) == ("p0002", "misprint")
    # 300 and 400 raster pixels of 0.0527 mm; prints lie up to 0.8 mm off
    left_mm = press.geometry.left_mm(page.width_mm)
    assert bad["regions"][0]["x_mm"] == pytest.approx(left_mm + 15.8, abs=1.5)
    assert bad["regions"][0]["y_mm"] == pytest.approx(21.1, abs=1.5)
    assert bad["detector"] == "golden"


def test_a_scan_of_another_camera(tmp_path: Path, press: Press) -> None:
    golden = saved(tmp_path / "golden.tif", np.zeros((40, 40), np.uint16))
    file = picture_files(golden)[0]
    with pytest.raises(ScanError, match="1 sensors x 400 pixels"):
        GoldenInspector.of(press, file)(GoldenPage(number=1, name="p", scan=file, goldens=(file,)))


@pytest.mark.parametrize("value", [np.nan, 0.0])
def test_light_that_is_no_number_once_columns_are_taken_out_is_not_compared(
    press: Press, tmp_path: Path, value: float
) -> None:
    gain = press.sensors[0].column_gain.copy()
    gain[40] = value
    spoilt = replace(press, sensors=(replace(press.sensors[0], column_gain=gain),))
    drawn = np.resize(sheet().astype(np.uint16), (300, press.geometry.pixels))
    pages = golden_pages(saved(tmp_path / "golden.tif", drawn), saved(tmp_path / "scan.tif", drawn))
    assert GoldenInspector(press=press)(pages[0]).verdict == "good"
    with np.errstate(all="ignore"):
        said = GoldenInspector(press=spoilt)(pages[0])
    assert said.verdict == "not-inspected"
    assert "not finite numbers" in said.reason


def test_a_scan_out_of_shape_is_not_inspected_and_says_how(tmp_path: Path) -> None:
    golden = saved(tmp_path / "golden.tif", sheet())
    stretched = cv2.resize(sheet(), None, fx=1.045, fy=1.0, interpolation=cv2.INTER_CUBIC)[:, 6 : 6 + PIXELS]
    said = verdict_of(golden, saved(tmp_path / "scan.tif", stretched))
    assert (said.verdict, without_gate(said)[0], said.regions, said.score) == (
        "not-inspected",
        "hold",
        (),
        None,
    )
    assert said.reason.startswith("the scan does not fit its golden: shifted by ")
    assert "stretched by 4." in said.reason  # of 4.5 %
    assert said.shift_mm is not None


# --- zones and copies, by the command ---


def zones_file(path: Path, kind: str = "ignore") -> Path:
    zone = {"name": "label", "kind": kind, "rectangle_mm": [19, 24, 3.5, 3.5]}
    path.write_text(json.dumps({"zones": [zone]}))
    return path


def inspected(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], *more: str
) -> tuple[int, list[dict[str, Any]]]:
    for name, pixels in (("golden.tif", sheet()), ("copy.tif", sheet()), ("spot.tif", spotted())):
        saved(tmp_path / name, pixels)
    code = run(
        ["inspect", str(tmp_path / "spot.tif"), "--golden", str(tmp_path / "golden.tif"), *more, "--json"]
    )
    return code, [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def test_an_ignored_zone_alarms_nobody(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert inspected(tmp_path, capsys)[0] == 1
    code, (verdict,) = inspected(tmp_path, capsys, "--zones", str(zones_file(tmp_path / "z.json")))
    assert (code, verdict["verdict"], verdict["regions"]) == (0, "good", [])


def test_zones_that_a_golden_does_not_know(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    careful = zones_file(tmp_path / "z.json", "careful")
    golden = saved(tmp_path / "golden.tif", sheet())
    for more, why in (([], "holds careful zones"), (["--press", "x.press"], "only where scans are pictures")):
        words = ["inspect", str(golden), "--golden", str(golden), "--zones", str(careful), *more]
        assert run(words) == 2
        assert why in capsys.readouterr().err


def test_several_copies_may_be_golden(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    copy = ("--golden", str(tmp_path / "copy.tif"))
    assert inspected(tmp_path, capsys, *copy)[0] == 1
    as_it_is = ("--golden", str(tmp_path / "spot.tif"))
    assert inspected(tmp_path, capsys, *as_it_is)[0] == 0


def test_a_report_shows_the_golden_the_scan_and_their_difference(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, (verdict,) = inspected(tmp_path, capsys, "--report", str(tmp_path / "out"))
    text = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert (code, verdict["verdict"]) == (1, "misprint")
    assert "spot.tif against golden.tif" in text
    assert text.count("data:image/webp") >= 6  # the page, three pictures, and a piece of two of them
    assert "1 stopped as a misprint" in text


def test_a_report_of_a_missing_scan_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    golden, scans = saved(tmp_path / "golden.tif", sheet()), tmp_path / "scans"
    scans.mkdir()
    saved(scans / "a.tif", sheet())
    (scans / "b.tif").write_bytes(b"no picture")
    words = ["inspect", str(scans), "--golden", str(golden), "--report", str(tmp_path / "out"), "--json"]
    assert run(words) == 3
    assert [json.loads(line)["verdict"] for line in capsys.readouterr().out.splitlines()] == [
        "good",
        "not-inspected",
    ]
    assert "could not be inspected" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")

"""A press read from a small chart: 60 patches at 150 dpi, mono-spectral inks known in closed form."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from prooflight.commissioning.chart.calibrate import Calibration, calibrate
from prooflight.commissioning.chart.patch_reading import read_scan
from prooflight.commissioning.chart.scan import read_chart_scan
from prooflight.errors import ChartError, ScanError
from prooflight.inks.chart_layout import Layout, PlacedRecipes, place_recipes, write_recipes
from prooflight.inks.chart_print import raster
from prooflight.inks.recipes import choose_recipes, printable_recipes
from prooflight.prediction.predict import predict
from prooflight.press.artefact import Press
from prooflight.scans.recorded import write_scan
from prooflight.spectra import srgb_light

PITCH_MM = 25.4 / 150
WHITE = np.array([3000.0, 2500.0, 2000.0])
BLACK_DN = 20.0
READ_DN2, DN_PER_E = 4.0, 0.02
DENSITY = np.array([[2.5, 0.4, 0.2], [0.3, 2.2, 0.6], [0.1, 0.3, 2.0], [2.4, 2.4, 2.4]])
LAYOUT = Layout(width_mm=110.0, height_mm=90.0, margin_mm=5.0, mark_mm=6.0, patch_mm=6.0, gap_mm=1.0)


def true_light(cmyk: np.ndarray) -> np.ndarray:
    """Beer and Lambert with a little tone value increase: (..., 4) -> (..., 3)."""
    area = cmyk + 0.4 * cmyk * (1 - cmyk)
    return np.exp(-area @ DENSITY)


@pytest.fixture(scope="module")
def placed() -> PlacedRecipes:
    candidates = printable_recipes()
    return place_recipes(candidates[choose_recipes(candidates, 60)], LAYOUT, np.random.default_rng(3))


@pytest.fixture(scope="module")
def chart(placed: PlacedRecipes, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("chart") / "chart.txt"
    write_recipes(path, placed)
    return path


def scanned(
    placed: PlacedRecipes,
    *,
    seed: int = 1,
    turn_deg: float = 0.7,
    quarter: int = 0,
    white: np.ndarray = WHITE,
) -> np.ndarray:
    """A scan of page 1, (3, lines, pixels) uint16: skewed, on a black bed, lamp weaker at the sides, noisy, dusty."""
    rng = np.random.default_rng(seed)
    page = raster(placed, 1)
    light = true_light(page.reshape(-1, 4) / 255).reshape(*page.shape[:2], 3).astype(np.float32)
    scale = 0.1 / PITCH_MM
    lines, pixels = round(100 / PITCH_MM), round(120 / PITCH_MM)
    to_pixel = cv2.getRotationMatrix2D((page.shape[1] / 2, page.shape[0] / 2), turn_deg, scale)
    to_pixel[:, 2] += np.array([pixels, lines]) / 2 - np.array(page.shape[1::-1]) / 2
    # The pixel's aperture: a box of its own width, before sampling.
    blurred = cv2.GaussianBlur(cv2.blur(light, (2, 2)), (0, 0), 0.6)
    seen = cv2.warpAffine(blurred, to_pixel, (pixels, lines), flags=cv2.INTER_LINEAR, borderValue=(0.05,) * 3)
    for _ in range(20):  # dust
        at = rng.integers(0, (pixels, lines))
        cv2.circle(seen, at.tolist(), 2, (0.2, 0.2, 0.2), -1)
    seen = np.rot90(seen, quarter)
    columns = 1 - 0.1 * np.linspace(-1, 1, seen.shape[1]) ** 2 + 0.01 * rng.standard_normal(seen.shape[1])
    dn = np.moveaxis(seen * columns[:, None], 2, 0) * white[:, None, None]
    noisy = dn + BLACK_DN + rng.standard_normal(dn.shape) * np.sqrt(READ_DN2 + DN_PER_E * dn)
    return np.clip(np.rint(noisy), 0, 4095).astype(np.uint16)


@pytest.fixture(scope="module")
def scan(placed: PlacedRecipes, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scan") / "scan.tif"
    write_scan(path, scanned(placed), facts={})
    return path


@pytest.fixture(scope="module")
def found(chart: Path, scan: Path) -> Calibration:
    return calibrate(chart, [scan], name="small")


def test_colours_are_those_of_the_inks(found: Calibration) -> None:
    """Between patches as well: 60 patches of smooth inks leave a per cent or so of what an ink does."""
    cmyk = np.random.default_rng(0).random((500, 4)) * 0.9
    light = found.learned.fit.model.light(cmyk)
    want = (true_light(cmyk) * WHITE + BLACK_DN) / (WHITE + BLACK_DN)
    assert np.sqrt(np.mean((light - want) ** 2)) < 0.002
    one_band = np.sqrt(np.mean((np.exp(-cmyk @ DENSITY) - want) ** 2))
    assert one_band > 0.02  # what no tone curve would leave: the limit above is no empty one


def test_paper_and_columns(found: Calibration) -> None:
    """Expected paper in every column is what the scan shows there, to a few standard errors of some 100 pixels."""
    red = found.press.sensors[0]
    paper = red.column_offset_dn + red.column_gain * red.mean_dn[0, 0, 0, 0]
    middle = slice(120, -120)
    lamp = 1 - 0.1 * np.linspace(-1, 1, paper.size) ** 2
    ratio = (paper / (WHITE[0] * lamp + BLACK_DN))[middle]
    assert abs(ratio.mean() - 1) < 0.002
    assert 0.007 < ratio.std() < 0.013  # the columns' own 1 %


def test_noise_rises_with_signal(found: Calibration) -> None:
    for index, noise in enumerate(found.learned.noise):
        want = READ_DN2 + DN_PER_E * WHITE[index] + 1 / 12
        assert noise.variance_dn2(np.array(WHITE[index] + BLACK_DN)) == pytest.approx(want, rel=0.1)
        assert noise.constant_dn2 < 0.3 * want


def test_geometry_comes_from_the_marks(found: Calibration) -> None:
    assert found.press.geometry.pixel_pitch_mm == pytest.approx(PITCH_MM, rel=5e-4)
    assert found.press.geometry.line_pitch_mm == pytest.approx(PITCH_MM, rel=5e-4)
    (scan,) = found.learned.scans
    assert scan.chart.turn_deg == pytest.approx(-0.7, abs=0.02)  # OpenCV turns the other way
    assert scan.chart.residual_px < 0.1
    assert scan.chart.marks == 4


def test_the_press_predicts_and_keeps(found: Calibration, tmp_path: Path, placed: PlacedRecipes) -> None:
    path = tmp_path / "x.press"
    found.press.save(path)
    again = Press.load(path)
    assert again.digest == found.press.digest
    from prooflight.pages.raster import Page

    page = Page(cmyk=raster(placed, 1), dpi=254, name="chart", number=1)
    seen = predict(page, sensors=again.sensors, geometry=again.geometry)
    assert np.isfinite(seen.expected_dn).all()
    assert (seen.variance_dn2 > 0).all()


def test_residuals_name_every_patch(found: Calibration, placed: PlacedRecipes) -> None:
    assert len(found.patches) == 60
    places = {(patch.page, patch.row, patch.column) for patch in found.patches}
    assert places == set(map(tuple, placed.place.tolist()))
    assert sum(not patch.used for patch in found.patches) <= 1
    assert max(found.residual_sigma) < 0.5


@pytest.mark.parametrize("quarter", [1, 2])
def test_a_turned_chart_is_found(placed: PlacedRecipes, tmp_path: Path, quarter: int) -> None:
    path = tmp_path / "turned.tif"
    write_scan(path, scanned(placed, quarter=quarter, turn_deg=-1.8), facts={})
    turned = read_scan(path, placed)
    assert turned.chart.turn_deg % 360 == pytest.approx((1.8 - 90 * quarter) % 360, abs=0.03)


def test_an_rgb_picture_is_three_sensors(placed: PlacedRecipes, tmp_path: Path) -> None:
    """8-bit codes without a profile are sRGB: paper of code v reads 65535 x its light."""
    code = np.full((40, 50, 3), (200, 180, 90), np.uint8)
    path = tmp_path / "flat.png"
    assert cv2.imwrite(str(path), code[..., ::-1])
    scan = read_chart_scan(path)
    assert scan.names == ("red", "green", "blue")
    assert scan.encoding == "srgb"
    want = 65535 * srgb_light(np.array([200, 180, 90]) / 255)
    assert scan.dn[:, 3, 4] == pytest.approx(want, rel=1e-6)
    assert read_chart_scan(path, encoding="linear").dn[:, 0, 0].tolist() == [200, 180, 90]
    deep = tmp_path / "deep.tif"
    tifffile.imwrite(
        deep, code.astype(np.uint16) * 100, photometric="rgb", resolution=(300, 300), resolutionunit=2
    )
    linear = read_chart_scan(deep)
    assert (linear.encoding, linear.dpi) == ("linear", (300.0, 300.0))
    assert linear.dn[:, 0, 0].tolist() == [20000, 18000, 9000]


def test_bad_input_is_named(placed: PlacedRecipes, chart: Path, scan: Path, tmp_path: Path) -> None:
    bright = tmp_path / "bright.tif"
    write_scan(bright, scanned(placed, white=2 * WHITE), facts={})
    with pytest.raises(ScanError, match="sensor red is saturated"):
        calibrate(chart, [bright], name="x")
    empty = tmp_path / "empty.tif"
    write_scan(empty, np.full((3, 400, 500), 2000, np.uint16), facts={})
    with pytest.raises(ScanError, match="no chart found"):
        calibrate(chart, [empty], name="x")
    other = tmp_path / "other.txt"
    shuffled = np.random.default_rng(9).permutation(len(placed.cmyk))
    write_recipes(other, replace(placed, cmyk=placed.cmyk[shuffled]))
    with pytest.raises(ScanError, match="the scan is of another chart"):
        calibrate(other, [scan], name="x")
    grey = tmp_path / "grey.tif"
    write_scan(grey, scanned(placed)[:1], facts={})
    with pytest.raises(ScanError, match="has sensors"):
        calibrate(chart, [scan, grey], name="x")
    with pytest.raises(ChartError):
        calibrate(scan, [scan], name="x")
    with pytest.raises(ScanError, match="no such file"):
        calibrate(chart, [tmp_path / "missing.tif"], name="x")

"""The paper's figures of a press: what they show is what the press and its camera say."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image
from scipy import stats

from prooflight.errors import RequestError
from prooflight.pages.files import write_tiff
from prooflight.press.press_file import PressFile
from prooflight.simulation.misprints.kinds import KINDS
from prooflight.simulation.scans import MisprintRequest
from prooflight_studies.harness.operating import area_under_roc
from prooflight_studies.paper.figures import (
    COLOURS,
    Exhibit,
    draw_figures,
    error_map,
    repeated_exposures,
    slices,
)
from prooflight_studies.paper.page_samples import Samples, judged_samples, page_samples

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory, make_page: Callable[..., Page]) -> Path:
    path = tmp_path_factory.mktemp("job") / "p0001.tif"
    write_tiff(make_page(3), path)
    return path


def test_all_figures_are_written(two_sensor_file: PressFile, job: Path, tmp_path: Path) -> None:
    # pixels of 0.26 mm, so that figures 7 and 8 need no press of their own
    text = two_sensor_file.text.replace("pixels = 2048", "pixels = 200").replace("= 546.6", "= 1260.0")
    short = PressFile(two_sensor_file.path, text)
    exhibit = Exhibit(job=job, good_copies=6, of_each_kind=2)
    written = draw_figures(short, exhibit, tmp_path / "out")
    assert [path.name for path in written] == [
        "figure-3-light-and-sensors.png",
        "figure-4-tables-mono.png",
        "figure-4-tables-blue.png",
        "figure-5-noise-mono.png",
        "figure-5-noise-blue.png",
        "figure-6-error-map.png",
        "figure-7-statistics.png",
        "figure-8-roc-and-cost.png",
    ]
    assert sorted((tmp_path / "out").iterdir()) == sorted(written)
    for path in written:
        with Image.open(path) as image:
            assert image.format == "PNG"
            assert len(image.convert("L").getcolors() or []) > 20


def test_slices_are_the_tables(press: Press) -> None:
    sensor = press.sensors[0]
    mean_cm, mean_yk, sigma_cm, sigma_yk = slices(sensor)
    assert (mean_cm.x_ink, mean_cm.y_ink, mean_yk.x_ink, mean_yk.y_ink) == (
        "cyan",
        "magenta",
        "yellow",
        "black",
    )
    assert mean_cm.values[9, 4] == sensor.mean_dn[4, 9, 0, 0]
    assert mean_yk.values[5, 4] == sensor.mean_dn[0, 0, 4, 5]
    assert sigma_cm.values[0, 0] == pytest.approx(np.sqrt(sensor.variance_dn2[0, 0, 0, 0]))
    # black darkens far more than yellow, so it must be the rows
    assert mean_yk.values[-1, 0] < 0.1 * mean_yk.values[0, 0] < mean_yk.values[0, -1]
    assert sigma_yk.values[-1, 0] < sigma_yk.values[0, -1]


def test_repeated_exposures_follow_the_tables_gaussian(prototype: PressFile) -> None:
    repeated = repeated_exposures(prototype.camera(), prototype.inks(), 0, np.random.default_rng(1))
    assert [colour.name for colour in repeated] == list(COLOURS)
    for colour in repeated:
        # 20,000 exposures: five standard errors of mean and of sigma
        assert abs(colour.dn.mean() - colour.mean_dn) < 5 * colour.sigma_dn / np.sqrt(20_000)
        assert colour.dn.std() == pytest.approx(colour.sigma_dn, rel=5 / np.sqrt(40_000))
        codes = np.arange(colour.dn.min(), colour.dn.max())
        before_rounding = np.sqrt(colour.sigma_dn**2 - 1 / 12)
        share = np.searchsorted(np.sort(colour.dn), codes, side="right") / colour.dn.size
        promised = stats.norm.cdf((codes + 0.5 - colour.mean_dn) / before_rounding)
        assert np.abs(share - promised).max() < 5 * 0.5 / np.sqrt(20_000)


def test_the_error_map_shows_the_misprint_and_nothing_else(press: Press, job: Path) -> None:
    shown = error_map(press, Exhibit(job=job), seed=1)
    assert shown.verdict == "misprint"
    x_mm, y_mm, width_mm, height_mm = shown.region_mm
    rows, columns = shown.block_z.shape
    x = shown.frame.x_mm + (np.arange(columns) + 0.5) * shown.frame.width_mm / columns
    y = shown.frame.y_mm + (np.arange(rows) + 0.5) * shown.frame.height_mm / rows
    # blocks of which any part is within a millimetre of the misprint
    off_x, off_y = 1 + shown.frame.width_mm / columns / 2, 1 + shown.frame.height_mm / rows / 2
    in_y = (y > y_mm - off_y) & (y < y_mm + height_mm + off_y)
    inside = np.outer(in_y, (x > x_mm - off_x) & (x < x_mm + width_mm + off_x))
    assert np.abs(shown.block_z[inside]).max() > 20
    assert np.abs(shown.block_z[~inside]).max() < 6  # 2,000 blocks of N(0, 1)


@pytest.fixture(scope="module")
def samples(two_sensor_press: Press, job: Path) -> Samples:
    return page_samples(two_sensor_press, job, 1, good=10, of_each_kind=2, seed=3)


def test_statistics_of_good_copies_are_those_of_the_standard_normal(samples: Samples) -> None:
    """About 2100 windows a copy, 10 copies, each sensor: five standard errors."""
    good = samples.statistics[samples.kinds == ""]
    assert good.shape == (10, 2, 3)
    windows = 2100
    np.testing.assert_allclose(good[..., 0].mean(axis=0), 0, atol=5 / np.sqrt(10 * windows))
    np.testing.assert_allclose(good[..., 2].mean(axis=0), 0.5, atol=5 * 0.5 / np.sqrt(10 * windows))
    # the least of so many: between its 1e-4 quantiles
    low, high = stats.norm.ppf(1 - (1 - np.array([1e-4, 1 - 1e-4])) ** (1 / windows))
    assert (good[..., 1] > low).all()
    assert (good[..., 1] < high).all()


def test_every_kind_is_printed_and_what_is_learned_is_not_judged(samples: Samples) -> None:
    assert {*samples.types} == {"correct", "global", "local"}
    kinds, counts = np.unique(samples.kinds, return_counts=True)
    assert set(kinds) - {""} <= set(KINDS)
    judged = judged_samples(samples)
    for pages in judged.values():
        assert (~pages.bad).sum() == 5
        assert pages.bad.sum() == (counts[kinds != ""] // 2).sum()
    assert area_under_roc(judged["chi-square"]) > 0.7


def test_the_same_seed_prints_the_same_copies(samples: Samples, two_sensor_press: Press, job: Path) -> None:
    again = page_samples(two_sensor_press, job, 1, good=2, of_each_kind=0, seed=3)
    np.testing.assert_array_equal(again.statistics, samples.statistics[:2])


def test_pages_and_misprints_that_do_not_exist_are_refused(press: Press, job: Path) -> None:
    with pytest.raises(RequestError, match="no page 9"):
        error_map(press, Exhibit(job=job, page=9), seed=1)
    with pytest.raises(RequestError, match="no kind"):
        Exhibit(job=job, misprint=MisprintRequest.parse("earthquake"))

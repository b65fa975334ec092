"""Accuracy of tables on pages' colours: counting, weighting, and the page that is written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.stand_ins import others

from prooflight.errors import JobError
from prooflight.inks.built_in import built_in_inks
from prooflight.pages.files import write_tiff
from prooflight.pages.job import open_job
from prooflight.pages.raster import Page
from prooflight.press.press_file import PressFile
from prooflight.simulation.corpus.corpus import design_page
from prooflight_studies.tables.study import (
    FREQUENT,
    OTHERS,
    Colours,
    job_colours,
    judged,
    page_colours,
    random_colours,
    run_table_study,
    with_chart,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.press.artefact import Press


def page_of(colours: np.ndarray) -> Page:
    return Page(cmyk=colours.reshape(1, -1, 4).astype(np.uint8), dpi=100.0, name="p0001", number=1)


def test_every_colour_of_a_page_is_counted() -> None:
    colours = np.array([(1, 2, 3, 4)] * 5 + [(4, 3, 2, 1)] * 2 + [(0, 0, 0, 255)])
    cmyk, times, pixels = page_colours(page_of(colours), np.random.default_rng(0))
    found = {tuple(recipe): count for recipe, count in zip(cmyk.tolist(), pixels.tolist(), strict=True)}
    assert found == {(1, 2, 3, 4): 5, (4, 3, 2, 1): 2, (0, 0, 0, 255): 1}
    assert times.tolist() == [1, 1, 1]


def test_drawn_colours_stand_for_the_others() -> None:
    different = 60_000
    codes = np.arange(different)
    colours = np.stack([codes // 256, codes % 256, codes * 0, codes * 0], axis=1)
    often = colours[7]
    page = page_of(np.concatenate([colours, np.repeat(often[None], 900, axis=0)]))
    cmyk, times, pixels = page_colours(page, np.random.default_rng(0))
    assert len(cmyk) == len(np.unique(cmyk, axis=0)) == FREQUENT + OTHERS
    assert times.sum() == pytest.approx(different)
    assert pixels.sum() == pytest.approx(different + 900)
    (place,) = np.flatnonzero((cmyk == often).all(axis=1))
    assert (times[place], pixels[place]) == (1, 901)


def test_errors_are_of_the_tables_and_weighted_by_colour_or_by_pixel(
    press: Press, prototype: PressFile
) -> None:
    camera, inks = prototype.camera(), built_in_inks()
    (sensor,) = camera.sensors
    shifted = press.sensors[0].mean_dn.copy()
    shifted[:, :, :, 16:] += 10.0  # all colours with so much black are 10 DN off
    model = replace(press.sensors[0], mean_dn=shifted)
    dark, light = (0, 0, 0, 200), (0, 0, 0, 8)  # the second is a node, off by its own evening-out alone
    colours = Colours(
        name="two",
        source="",
        cmyk=np.array([dark, light], np.uint8),
        times=np.ones(2),
        pixels=np.array([1.0, 99.0]),
        page=np.array([0, 1]),
    )
    (row,) = judged("p", camera, inks, (model,), colours)
    electrons = sensor.electrons(camera.irradiance_photons(inks.reflectance(np.array(dark) / 255)))
    sigma = np.sqrt(sensor.variance_temporal_e2(electrons)) * sensor.dn_per_e
    assert row.max_sigma == row.worst_page_rms_sigma == pytest.approx(10 / sigma, rel=0.05)
    assert row.rms_sigma == pytest.approx(row.max_sigma / np.sqrt(2), rel=0.01)
    assert row.rms_sigma_by_pixels == pytest.approx(row.max_sigma / 10, rel=0.1)
    assert row.white_sigma < 1e-3
    assert row.worst[0].cmyk_percent == (0, 0, 0, pytest.approx(78.4))
    assert row.worst[0].error_sigma > 0
    assert row.different == 2


def test_the_study_of_a_small_job_writes_its_page(
    prototype: PressFile, make_page: Callable[..., Page], tmp_path: Path
) -> None:
    for number in (1, 2):
        write_tiff(make_page(number, dpi=120.0, number=number), tmp_path / "job" / f"p{number}.tif")
    short = PressFile(prototype.path, prototype.text.replace("pixels = 2048", "pixels = 64"))
    rows = run_table_study([short], {"a job": tmp_path / "job"}, tmp_path / "out")
    assert [row.colours for row in rows] == ["random and ramps", "a job"]
    for row in rows:
        assert row.rms_sigma <= 0.10
        assert row.rms_sigma_by_pixels <= 0.10
        assert row.white_sigma <= 0.02
        assert row.sigma_percent < 1
    text = (tmp_path / "out" / "tables.md").read_text(encoding="utf-8")
    assert f"{rows[1].rms_sigma:.4f}" in text
    assert "2 pages" in text
    assert str(tmp_path) not in text


def test_colours_of_a_job_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(JobError):
        job_colours("x", tmp_path, seed=1, progress=lambda _text: None)


def test_random_colours_are_those_of_press_build() -> None:
    colours = random_colours(1)
    assert len(colours.cmyk) > 20_000
    assert colours.cmyk[0].tolist() == [0, 0, 0, 0]


def test_a_chart_joins_a_press_file_without_naming_its_folder(prototype: PressFile, tmp_path: Path) -> None:
    joined = with_chart(prototype, tmp_path / "chart.txt")
    assert str(tmp_path) not in joined.text
    assert joined.name == "prototype-chart"
    assert joined.camera().pixel_pitch_mm == prototype.camera().pixel_pitch_mm


@pytest.mark.parametrize(
    "first", [None, *others("pages")], ids=lambda path: path.stem if path else "composed"
)
def test_tables_are_within_a_tenth_of_sigma_on_a_page(
    press: Press, prototype: PressFile, tmp_path: Path, first: Path | None
) -> None:
    if first is None:
        first = tmp_path / "composed.tif"
        write_tiff(design_page(1, 0, dpi=60.0), first)
    colours = job_colours("real", first, seed=1, progress=lambda _text: None)
    with open_job(first, dpi=100.0) as job:
        assert colours.pixels.sum() == pytest.approx(job.page(1).cmyk[..., 0].size)
    (row,) = judged("p", prototype.camera(), prototype.inks(), press.sensors, colours)
    assert row.rms_sigma <= 0.10
    assert row.rms_sigma_by_pixels <= 0.10

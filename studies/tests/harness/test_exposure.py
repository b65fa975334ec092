"""The exact exposure of a page against closed forms, ISETCam's edge, and the fast approximation."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from prooflight import spectra
from prooflight.camera.camera import Camera, respond, with_pixels
from prooflight.camera.lens_correction import spectral_blur
from prooflight.camera.sensor import FixedPattern, Noise
from prooflight.errors import RequestError
from prooflight.pages.raster import MM_PER_INCH, Page
from prooflight_studies.exact.exposure import distinct_colours, page_electrons, page_taps, read_out_page

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.press.press_file import PressFile

PIXELS, BACKING = 60, 0.05
BLUE_HALF = np.where(spectra.WAVE_NM < 500, 0.9, 0.05)
RED_HALF = 0.95 - BLUE_HALF


class TwoInks:
    """Recipes between two reflectances: K says how much of the second."""

    name = "two"

    def __init__(self, paper: NDArray[np.float64], ink: NDArray[np.float64]) -> None:
        self.paper, self.ink = paper, ink

    def reflectance(self, cmyk: NDArray[np.floating]) -> NDArray[np.float64]:
        share = np.asarray(cmyk, dtype=np.float64)[..., 3:]
        return self.paper + share * (self.ink - self.paper)


INKS = TwoInks(np.full(36, 0.85), np.full(36, 0.02))


@pytest.fixture(scope="module")
def camera(prototype: PressFile) -> Camera:
    return with_pixels(prototype.camera(), PIXELS)


def page_of(camera: Camera, black: NDArray[np.bool_], s: int) -> Page:
    cmyk = np.zeros((*black.shape, 4), np.uint8)
    cmyk[..., 3] = 255 * black
    return Page(cmyk=cmyk, dpi=MM_PER_INCH * s / camera.pixel_pitch_mm, name="p0001", number=1)


def electrons_of(
    camera: Camera,
    page: Page,
    *,
    inks: TwoInks = INKS,
    left: float = 0.0,
    top: float = 0.0,
    lines: int = 50,
    **more: Any,
) -> NDArray[np.float32]:
    """Seen from ``left`` camera pixels and ``top`` lines within the page on, without cos^4."""
    return page_electrons(
        camera,
        inks,
        page,
        centres_x_mm=(np.arange(camera.sensors[0].pixels) + 0.5 + left) * camera.pixel_pitch_mm,
        centres_y_mm=(np.arange(lines) + 0.5 + top) * camera.line_pitch_mm,
        backing_reflectance=BACKING,
        **{"falloff": False, **more},
    )


def band_electrons(camera: Camera) -> NDArray[np.float64]:
    return camera.sensors[0].electrons(camera.irradiance_photons(np.eye(36)))


def letters(rows: int, columns: int, s: int) -> NDArray[np.bool_]:
    """Blots a camera pixel and more wide, on paper."""
    blots = np.random.default_rng(5).random((rows // (2 * s) + 1, columns // (2 * s) + 1)) < 0.3
    return np.kron(blots, np.ones((2 * s, 2 * s), bool))[:rows, :columns]


def test_an_even_page_gives_what_the_camera_answers_to_its_colour(camera: Camera) -> None:
    page = page_of(camera, np.ones((2 * 160, 2 * 180), bool), 2)
    got = electrons_of(camera, page, left=60, top=55)
    (answer,) = respond(camera, INKS.ink)
    # single precision at the signal of paper, and 1e-4 of the contrast to a backing 55 pixels away
    white = respond(camera, INKS.paper)[0].electrons
    np.testing.assert_allclose(got, answer.electrons, atol=1e-4 * white)


def test_the_lens_darkens_columns_far_from_its_axis(camera: Camera) -> None:
    page = page_of(camera, np.zeros((160, 180), bool), 1)
    bright = electrons_of(camera, page)
    np.testing.assert_allclose(
        electrons_of(camera, page, falloff=True), bright * camera.column_light(), rtol=1e-5
    )


@pytest.mark.parametrize("binning", [1, 2])
@pytest.mark.parametrize("along", [False, True])
def test_an_edge_between_two_colours_has_each_bands_own_profile(
    camera: Camera, along: bool, binning: int
) -> None:
    camera = replace(camera, binning_along=binning)
    s, reach = 4, 64
    black = np.zeros((s * 2 * reach * binning, s * 2 * reach), bool)
    black[:, s * reach :] = True
    if along:
        black = np.zeros_like(black)
        black[s * reach * binning :] = True
    inks = TwoInks(RED_HALF, BLUE_HALF)
    left, top = reach - PIXELS / 2 + 0.13, reach - 25 + 0.07
    got = electrons_of(camera, page_of(camera, black, s), inks=inks, left=left, top=top)[0]
    seen = got[:, PIXELS // 2] if along else got[25]
    middle = np.arange(50) + 0.5 - 25 + 0.07 if along else np.arange(PIXELS) + 0.5 - PIXELS / 2 + 0.13
    x = (middle * binning if along else middle)[:, None]
    # Fourier integral of a step through lens and boxes; midpoints, as the integrand is finite at 0
    cutoff = 10.9
    f = (np.arange(40_000) + 0.5) * cutoff / 40_000
    boxes = np.sinc(f) * np.sinc(f * binning) if along else np.sinc(f)
    pixel_mm = camera.sensors[0].pixel_pitch_um * 1e-3
    mtf = camera.lens.mtf(f / pixel_mm, wave_nm=spectra.WAVE_NM[:, None]) * boxes
    share = 0.5 + np.sin(2 * np.pi * f * x) @ (mtf / (np.pi * f)).T * (cutoff / f.size)  # (x, 36)
    band = band_electrons(camera)
    want = (RED_HALF + share * (BLUE_HALF - RED_HALF)) @ band
    # the cut to three shapes (3e-5) and what a page 128 pixels long lacks of an endless one (2e-4)
    inner = slice(10, -10)
    np.testing.assert_allclose(seen[inner], want[inner], atol=3e-4 * band.sum())


def test_three_shapes_stand_for_36_bands(camera: Camera) -> None:
    blurs = [spectral_blur(camera, camera.sensors[0], rank=rank) for rank in (1, 2, 3, 4)]
    losses = [blur.truncation for blur in blurs]
    assert losses[2] < 1e-4 < losses[0]
    assert losses == sorted(losses, reverse=True)
    for blur in blurs:
        assert blur.shapes[:, 0].tolist() == [1.0] + [0.0] * (len(blur.shapes) - 1)
        np.testing.assert_allclose(blur.bands_e[:, 0], band_electrons(camera))


def test_light_is_neither_lost_nor_made(camera: Camera) -> None:
    s = 3
    black = letters(s * 12, s * 14, s)
    got = electrons_of(camera, page_of(camera, black, s), left=-23, top=-19)[0]
    band = band_electrons(camera)
    light = np.where(black, INKS.ink @ band, INKS.paper @ band) - BACKING * band.sum()
    # diffraction carries about 2e-4 past each edge of the field, 19 pixels and more away
    assert (got - BACKING * band.sum()).sum() == pytest.approx(light.sum() / s**2, rel=2e-3)


def test_far_from_the_page_lies_the_backing(camera: Camera) -> None:
    page = page_of(camera, np.zeros((40, 40), bool), 2)
    got = electrons_of(camera, page, left=-30, top=-30)[0]
    band = band_electrons(camera)
    assert got[40, 40] == pytest.approx(INKS.paper @ band, rel=0.01)
    assert np.abs(got[:5] - BACKING * band.sum()).max() < 1e-4 * band.sum()
    assert np.abs(got[:, :5] - BACKING * band.sum()).max() < 1e-4 * band.sum()


def test_a_page_moved_by_a_raster_pixel_is_the_page_seen_from_a_raster_pixel_away(camera: Camera) -> None:
    s = 4
    black = np.pad(letters(s * 90, s * 100, s), s)
    page = page_of(camera, black, s)
    moved = page_of(camera, np.roll(black, (1, 1), axis=(0, 1)), s)
    seen = electrons_of(camera, moved, left=20 + 1 / s, top=20 + 1 / s)
    # of 140,000 electrons; a tile is circular, so its border is not quite the same
    np.testing.assert_allclose(seen, electrons_of(camera, page, left=20, top=20), atol=3)


def test_tiles_do_not_show(camera: Camera) -> None:
    page = page_of(camera, letters(2 * 150, 2 * 160, 2), 2)
    whole = electrons_of(camera, page, left=40, top=40)
    tiled = electrons_of(camera, page, left=40, top=40, tile_pixels=120)
    assert np.abs(whole - tiled).max() < 2e-4 * band_electrons(camera).sum()
    assert (whole != tiled).any()
    with pytest.raises(ValueError, match="tile_pixels must be above 96"):
        electrons_of(camera, page, tile_pixels=96)


def test_the_separable_footprint_comes_close(camera: Camera) -> None:
    s = 2
    black = letters(s * 150, s * 160, s)
    page = page_of(camera, black, s)
    exact = electrons_of(camera, page, left=50, top=50)[0]
    across, along = page_taps(
        camera.footprint(camera.sensors[0]),
        centres_x_mm=(np.arange(PIXELS) + 50.5) * camera.pixel_pitch_mm,
        centres_y_mm=(np.arange(50) + 50.5) * camera.pixel_pitch_mm,
        raster_pixel_mm=page.pixel_mm,
        raster_shape=black.shape,
    )
    band = band_electrons(camera)
    light = np.where(black, INKS.ink @ band, INKS.paper @ band).astype(np.float32)
    close = across.apply(along.apply(light).T).T
    difference = np.abs(close - exact) / band.sum()
    # measured: 0.9 % where four corners meet, mostly tails beyond the footprint's 4 pixels
    assert 1e-3 < difference.max() < 0.02
    assert np.sqrt((difference**2).mean()) < 0.005


def test_noise_is_the_sensors(camera: Camera) -> None:
    sensor = replace(camera.sensors[0], black_level_dn=64)
    camera = replace(camera, sensors=(sensor,))
    page = page_of(camera, np.zeros((900, 180), bool), 1)
    scan = read_out_page(
        camera,
        electrons_of(camera, page, left=60, top=50, lines=800, falloff=True),
        patterns=[FixedPattern(gain=np.ones(PIXELS), offset_e=np.zeros(PIXELS))],
        rng=np.random.default_rng(3),
        noise=Noise.TEMPORAL,
    )
    (answer,) = respond(camera, INKS.paper)
    assert scan.shape == (1, 800, PIXELS)
    assert scan.dtype == np.uint16
    # four standard errors of 48,000 samples, seed 3; cos^4 is 1 within 1e-4 on so short a line
    assert scan.mean() == pytest.approx(
        float(answer.dn_mean), abs=4 * answer.dn_sigma_temporal / np.sqrt(scan.size) + 2e-4 * answer.dn_mean
    )
    assert scan.std() == pytest.approx(float(answer.dn_sigma_temporal), rel=4 / np.sqrt(2 * scan.size))


def test_distinct_colours_are_sorted_and_complete() -> None:
    codes = np.random.default_rng(0).integers(0, 50, (600, 7)).astype(np.uint32)
    np.testing.assert_array_equal(distinct_colours(codes), np.unique(codes))


def test_pitches_that_do_not_divide_are_refused_with_the_resolution_to_use(camera: Camera) -> None:
    page = replace(page_of(camera, np.zeros((40, 40), bool), 2), dpi=400.0)
    with pytest.raises(
        RequestError, match=r"page p0001: has 1\.6\d+ raster pixels a camera line; rip at a whole"
    ):
        electrons_of(camera, page)
    with pytest.raises(ValueError, match="spaced by a camera line"):
        page_electrons(
            camera,
            INKS,
            page,
            centres_x_mm=np.arange(PIXELS) * camera.pixel_pitch_mm,
            centres_y_mm=np.arange(9) * 1.5 * camera.line_pitch_mm,
            backing_reflectance=BACKING,
        )


def test_isetcams_edge(
    oracle: Callable[[str], dict[str, Any]], isetcam_camera: Callable[[float], Camera]
) -> None:
    edges = oracle("edges")
    (scene,) = edges["scenes"]
    camera = isetcam_camera(edges["distance_m"])
    light = np.array(scene["preOTF_electrons_equiv"])
    per_pixel = round(camera.sensors[0].pixel_pitch_um / scene["sample_pitch_um"])
    x_um = np.array(scene["pixel_x_um"])
    camera = with_pixels(camera, x_um.size)
    band = band_electrons(camera)
    # its even reflectances, from its light before blur
    inks = TwoInks(np.full(36, light.max() / band.sum()), np.full(36, light.min() / band.sum()))
    black = np.tile(light < light.mean(), (120 * per_pixel, 1))
    got = page_electrons(
        camera,
        inks,
        page_of(camera, black, per_pixel),
        centres_x_mm=(x_um * 1e-3 + light.size / 2 * scene["sample_pitch_um"] * 1e-3)
        / camera.lens.magnification,
        centres_y_mm=(np.arange(5) + 57.5) * camera.line_pitch_mm,
        backing_reflectance=0.0,
        falloff=False,
    )[0, 2]
    step = light.max() - light.min()
    assert np.abs(np.diff(got)).max() > 0.3 * step  # the edge lies within the profile
    np.testing.assert_allclose(got, scene["pixel_electrons_box"], atol=0.005 * step)

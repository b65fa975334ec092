"""Good prints: placement, register, inks, paper and light of one print."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INK_LETTERS
from prooflight.scans.placement import Placement, Warp
from prooflight.simulation.session import Session, bounds_percent, lamp_profile, rounded
from prooflight.simulation.sheets import RUN_SHEETS, InkFields, smooth_field, smooth_line

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.simulation.worlds import PageAmounts, PaperAmounts

WARP_LENGTH_MM: Final = 25.0
WARP_PITCH_MM: Final = 2.5
CLOUD_LENGTHS_MM: Final = (5.0, 10.0, 20.0)
"""Lengths of the paper's clouds, 5..20 mm by worlds.toml; assumed: as much at 5 as at 10 and at 20."""
CLOUD_PITCH_MM: Final = 1.25
A4_MM2: Final = 210.0 * 297.0
CONTRAST_PITCH_MM: Final = 0.254
"""Pixel pitch at which worlds.toml gives the halftone's contrast; it grows as 1 / pitch."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Speck:
    """Benign speck of ink."""

    x_mm: float
    y_mm: float
    diameter_mm: float
    ink: int
    """Ink 0..3 for C, M, Y, K; assumed: any ink alike."""
    share: float
    """Additional share of a whole ink. [-]"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Print:
    """Parameters of one good print."""

    placement: Placement
    register_mm: NDArray[np.float64]
    """Displacement (4, 2) of each ink plane to the right and downwards on the page."""
    ink_gain: NDArray[np.float64]
    """Relative gain (4,) of each ink at the page's centre, besides the session's. [-]"""
    ink_tilt: NDArray[np.float64]
    """Gain (4, 2) added to it at the page's right and lower edges, and subtracted at the others. [-]"""
    dot_gain: NDArray[np.float64]
    """Ink area (4,) added at 50 %; 4 d a (1 - a) elsewhere. [-]"""
    white: NDArray[np.float64]
    """Reflectance (sensors,) of the paper over the expected. [-]"""
    cloud: NDArray[np.float64]
    """Relative deviation (rows, columns) of reflectance from place to place, 0 on average. [-]

    Nodes are CLOUD_PITCH_MM apart from the page's corner, linear between.
    """
    specks: tuple[Speck, ...]
    lamp: NDArray[np.float64]
    """Lamp's profile (pixels,) over the session's. [-]"""
    flicker: NDArray[np.float64]
    """Light (lines,) of each line, 1 on average. [-]"""
    fields: InkFields | None = None
    """Deviations of the inks from place to place besides; None: not of this world."""

    @classmethod
    def draw(
        cls, session: Session, press: Press, page: Page, rng: np.random.Generator, *, sheet: int | None = None
    ) -> Self:
        """Draw one good print of a page of this size.

        sheet: number of the sheet in the day's run, by which a press drifts in the world ``measured``; None: any.
        """
        amounts, geometry = session.amounts, press.geometry
        ink, paper, lamp = amounts.ink, amounts.paper, amounts.lamp
        plane_um = rng.standard_normal((4, 2)) * amounts.register.plane_um
        clip_um = amounts.register.plane_clip_um
        common_sd = rng.standard_normal()
        common = common_sd * (paper.white_percent / 100)
        own = rng.standard_normal(len(press.sensors)) * (paper.white_channel_percent / 100)
        lines = geometry.lines(page.height_mm)
        print_ = cls(
            placement=draw_placement(amounts.page, page, rng),
            register_mm=plane_um.clip(-clip_um, clip_um) / 1000,
            ink_gain=rng.standard_normal(4) * (ink.gain_print_percent / 100),
            ink_tilt=rng.standard_normal((4, 2)) * (ink.gain_tilt_percent / 100),
            dot_gain=rng.standard_normal(4) * (ink.dot_gain_percent / 100),
            white=(1 + common) * (1 + own),
            cloud=_cloud(paper, page, rng),
            specks=_specks(paper, page, rng),
            lamp=1 + lamp_profile(geometry.pixels, rng) * (lamp.profile_print_percent / 100),
            flicker=1 + rng.standard_normal(lines) * (lamp.flicker_percent / 100),
        )
        if session.sheets is None:
            return print_
        number = int(rng.integers(RUN_SHEETS)) if sheet is None else sheet
        drifted = session.sheets.drifted(number, np.append(rng.standard_normal(4), common_sd))
        return replace(
            print_,
            ink_gain=drifted[:4] * (ink.gain_print_percent / 100),
            white=(1 + drifted[4] * (paper.white_percent / 100)) * (1 + own),
            fields=session.sheets.fields(page, rng),
        )

    def plain(self) -> dict[str, Any]:
        """Return the parameters for a person, in mm, degrees and per cent; inks in the order C, M, Y, K."""
        place = self.placement
        warp = np.zeros((1, 1, 2)) if place.warp is None else place.warp.nodes_mm
        return {
            "shift_mm": rounded(place.shift_mm, 4),
            "skew_deg": round(place.skew_deg, 5),
            "stretch_percent": rounded(place.stretch_percent, 5),
            "warp_rms_mm": rounded(np.sqrt(np.mean(warp.astype(np.float64) ** 2, axis=(0, 1))), 4),
            "register_mm": [rounded(plane, 4) for plane in self.register_mm],
            "ink_gain_percent": rounded(100 * self.ink_gain, 3),
            "ink_tilt_percent": [rounded(100 * tilt, 3) for tilt in self.ink_tilt],
            "dot_gain_percent": rounded(100 * self.dot_gain, 3),
            "white_percent": rounded(100 * (self.white - 1), 3),
            "lamp_percent": bounds_percent(self.lamp),
            "specks": [
                {
                    "x_mm": round(speck.x_mm, 2),
                    "y_mm": round(speck.y_mm, 2),
                    "diameter_mm": round(speck.diameter_mm, 3),
                    "ink": INK_LETTERS[speck.ink],
                    "ink_percent": round(100 * speck.share, 1),
                }
                for speck in self.specks
            ],
        }


def draw_placement(page_amounts: PageAmounts, page: Page, rng: np.random.Generator) -> Placement:
    """Draw the placement of a print.

    Half of the variance of the displacement along the travel depends on the line alone, for the whole web
    slips; the rest, and all of that across, varies over the page. All of it is smooth over 25 mm: a drum's
    inertia allows no jitter from line to line.
    """
    shift_x, shift_y = rng.uniform(-1, 1, 2) * page_amounts.shift_mm
    skew = rng.uniform(-1, 1) * page_amounts.skew_deg
    across, along = rng.uniform(-1, 1, 2) * page_amounts.scale_percent
    rows, columns = (int(extent / WARP_PITCH_MM) + 2 for extent in (page.height_mm, page.width_mm))
    of_page = [
        smooth_field(rows, columns, pitch_mm=WARP_PITCH_MM, length_mm=WARP_LENGTH_MM, rng=rng) for _ in "xy"
    ]
    of_web = smooth_line(rows, pitch_mm=WARP_PITCH_MM, length_mm=WARP_LENGTH_MM, rng=rng)[:, None]
    warp_x = of_page[0] * (page_amounts.warp_across_um / 1000)
    warp_y = (of_page[1] + of_web) * (page_amounts.warp_along_um / 1000 / np.sqrt(2))
    nodes = np.stack([warp_x, warp_y], axis=-1).astype(np.float32)
    return Placement(
        shift_mm=(float(shift_x), float(shift_y)),
        skew_deg=float(skew),
        stretch_percent=(float(across), float(along)),
        warp=Warp(nodes_mm=nodes, pitch_mm=WARP_PITCH_MM) if nodes.any() else None,
    )


def composed(one: Placement, other: Placement) -> Placement:
    """Return the sum of two displacements: a page displaced by a misprint also moves as every print does.

    It is of first order: the turns and stretches are thousandths, so that their order does not matter.
    """
    return Placement(
        shift_mm=(one.shift_mm[0] + other.shift_mm[0], one.shift_mm[1] + other.shift_mm[1]),
        skew_deg=one.skew_deg + other.skew_deg,
        stretch_percent=(
            one.stretch_percent[0] + other.stretch_percent[0],
            one.stretch_percent[1] + other.stretch_percent[1],
        ),
        warp=one.warp or other.warp,
    )


def plane_pixels(print_: Print, page: Page) -> NDArray[np.int64]:
    """Return each plane's register, rounded to whole raster pixels (52 um each at s = 2), (4, 2)."""
    return np.rint(print_.register_mm / page.pixel_mm).astype(np.int64)


def speck_pixels(print_: Print, page: Page) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
    """Return the raster pixels on which specks lie: (n, 2) row and column, and the ink printed there, (n, 4).

    They are those whose centre a speck covers; the ink is added to that of the displaced planes.
    """
    rows, columns = page.cmyk.shape[:2]
    planes = plane_pixels(print_, page)
    printed: dict[tuple[int, int], NDArray[np.int64]] = {}
    for speck in print_.specks:
        x, y, radius = (v / page.pixel_mm for v in (speck.x_mm, speck.y_mm, speck.diameter_mm / 2))
        for row in range(max(int(y - radius), 0), min(int(y + radius) + 1, rows)):
            for column in range(max(int(x - radius), 0), min(int(x + radius) + 1, columns)):
                if np.hypot(row + 0.5 - y, column + 0.5 - x) > radius:
                    continue
                recipe = printed.setdefault((row, column), _recipe(page, planes, row, column))
                recipe[speck.ink] = min(recipe[speck.ink] + round(255 * speck.share), 255)
    places = np.array(list(printed), np.int64).reshape(-1, 2)
    return places, np.array(list(printed.values()), np.uint8).reshape(-1, 4)


def _recipe(page: Page, planes: NDArray[np.int64], row: int, column: int) -> NDArray[np.int64]:
    """Return the ink of the displaced planes at one raster pixel, (4,)."""
    recipe = np.zeros(4, np.int64)
    for ink, (right, down) in enumerate(planes):
        i, j = row - down, column - right
        if 0 <= i < page.cmyk.shape[0] and 0 <= j < page.cmyk.shape[1]:
            recipe[ink] = page.cmyk[i, j, ink]
    return recipe


def _cloud(paper: PaperAmounts, page: Page, rng: np.random.Generator) -> NDArray[np.float64]:
    rows, columns = (int(extent / CLOUD_PITCH_MM) + 2 for extent in (page.height_mm, page.width_mm))
    total = np.zeros((rows, columns))
    for length_mm in CLOUD_LENGTHS_MM:
        total += smooth_field(rows, columns, pitch_mm=CLOUD_PITCH_MM, length_mm=length_mm, rng=rng)
    return total * (paper.cloudiness_percent / 100 / np.sqrt(len(CLOUD_LENGTHS_MM)))


def _specks(paper: PaperAmounts, page: Page, rng: np.random.Generator) -> tuple[Speck, ...]:
    count = rng.poisson(paper.specks_per_page * page.width_mm * page.height_mm / A4_MM2)
    return tuple(
        Speck(
            x_mm=float(rng.uniform(0, page.width_mm)),
            y_mm=float(rng.uniform(0, page.height_mm)),
            diameter_mm=float(rng.uniform(*paper.specks_diameter_mm)),
            ink=int(rng.integers(4)),
            share=float(rng.uniform(*paper.specks_ink_percent)) / 100,
        )
        for _ in range(count)
    )

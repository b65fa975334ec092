"""A design prepared for its scans: all that can be computed of a page before it is scanned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INKS
from prooflight.detectors.matched_filter.fit.beat import RowBeats, beat_contrasts, row_beats
from prooflight.detectors.matched_filter.fit.binning import (
    binned_geometry,
    binned_sensor,
    bins_of,
    thinned,
)
from prooflight.detectors.matched_filter.fit.modes import (
    AddedInks,
    QuantisedImages,
    first_lines,
    page_features,
    pixel_map,
    prepare_modes,
)
from prooflight.detectors.matched_filter.fit.nuisance import (
    Colours,
    FitBlocks,
    NuisanceModel,
    ResidualVariance,
    page_colours,
)
from prooflight.detectors.matched_filter.fit.residuals import most_steps
from prooflight.detectors.matched_filter.fit.special_places import (
    ZoneImages,
    hidden_edges,
    ignored_tiles,
    unresolved_places,
)
from prooflight.detectors.matched_filter.glyphs.scoring import (
    PageGlyphs,
    prepare_glyphs,
)
from prooflight.detectors.matched_filter.statistics.local_evidence import PERIODS_MM, tile_side
from prooflight.detectors.matched_filter.statistics.marks import speck_shares
from prooflight.detectors.print_prior import PrintPrior
from prooflight.kernels.registration.coarse import SHRINK
from prooflight.prediction.predict import Prediction
from prooflight.prediction.raster_light import FlatGroups
from prooflight.registration.landmarks import HALFTONE
from prooflight.registration.overlaps import Overlaps, overlaps_of
from prooflight.registration.register import Landmarks, prepare
from prooflight.scans.placement import IN_PLACE

if TYPE_CHECKING:
    from prooflight.pages.pdf.area_averages import InkLight
    from prooflight.pages.raster import Page
    from prooflight.pages.screen import Screen
    from prooflight.pages.zones.zone import PageZones
    from prooflight.prediction.tables import SensorModel
    from prooflight.scans.geometry import ScanGeometry


FRINGE_PARTS: Final = 2
"""Number of steps over a raster pixel by which planes of a press that rips pages itself are sought by their fringes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PreparedPage:
    """A design prepared for its scans."""

    page: Page
    flat: FlatGroups
    """Groups of the page that are flat further than planes of a print are displaced."""
    landmarks: Landmarks
    overlaps: Overlaps | None = None
    """Shared edges of planes, if prediction is to follow their fringes; None: it follows registration
    alone."""
    images: QuantisedImages
    """``Modes.images`` of the page in its nominal place, in binned pixels."""
    colours: Colours
    page_features: NDArray[np.float64]
    prior: PrintPrior
    """Prior of good prints."""
    zones: ZoneImages | None
    """Ignored areas, and areas that are also judged separately; None: there are none."""
    binned_geometry: ScanGeometry
    binned_sensors: tuple[SensorModel, ...]
    unresolved: NDArray[np.float32] | None = None
    """See ``unresolved_places``."""
    hidden: NDArray[np.float32] | None = None
    """See ``hidden_edges``."""
    specks: NDArray[np.float32]
    """See ``speck_shares``."""
    glyphs: PageGlyphs | None = None
    """Glyphs that are tested; None: none are."""
    beat: NDArray[np.float64] | None = None
    """See ``beat_contrasts``, the greatest of all sensors; None: the press's screen is not stated."""
    row_beats: RowBeats | None = None
    """See ``row_beats``."""
    own_light: InkLight | None = None
    """See ``prepare_page``."""

    @property
    def added(self) -> AddedInks:
        """``Modes.add`` of the page, likewise, computed when it is first needed."""
        bins = bins_of(self.landmarks.geometry)
        return AddedInks(self.page, sensors=self.binned_sensors, geometry=self.binned_geometry, bins=bins)

    def nuisance_model(
        self,
        places: FitBlocks,
        sums: NDArray[np.floating],
        planes: NDArray[np.float64],
        residual_variance: ResidualVariance,
    ) -> NuisanceModel:
        """Return the model of one scan of the page; the arguments are those of ``NuisanceModel.of``."""
        return NuisanceModel.of(
            places,
            sums,
            sensors=self.binned_sensors,
            colours=self.colours,
            planes=planes,
            pixel_mm=self.binned_geometry.pixel_pitch_mm,
            prior=self.prior,
            residual_variance=residual_variance,
        )

    def under(self, sensors: Sequence[SensorModel]) -> PreparedPage:
        """Return the page for sensors of which only the columns' gains differ.

        Modes are of bare columns, and stay.

        Landmarks stay as well: other gains would hardly change their choice.
        """
        landmarks = replace(self.landmarks, sensors=tuple(sensors))
        return replace(self, landmarks=landmarks, binned_sensors=mode_sensors(sensors, landmarks.geometry))


def mode_sensors(sensors: Sequence[SensorModel], geometry: ScanGeometry) -> tuple[SensorModel, ...]:
    """Return the sensors in pixels binned by ``bins_of``."""
    pitch_mm = geometry.pixel_pitch_mm, geometry.line_pitch_mm
    return tuple(binned_sensor(sensor, bins_of(geometry), pitch_mm) for sensor in sensors)


def without_arrays(design: PreparedPage) -> tuple[PreparedPage, dict[str, NDArray[Any]]]:
    """Return a design without its large arrays, and those, except the raster, by name."""
    large: dict[str, NDArray[Any] | None] = {
        "levels": design.images.levels,
        "windows": design.landmarks.windows,
        "flat": design.flat.flat,
        "hidden": design.hidden,
        "unresolved": design.unresolved,
    }
    bare = replace(
        design,
        page=replace(design.page, cmyk=np.zeros((1, 1, INKS), np.uint8)),
        images=replace(design.images, levels=np.zeros((0, 0, 0), np.uint16)),
        landmarks=replace(design.landmarks, windows=np.zeros(0, np.float32)),
        flat=replace(design.flat, flat=np.zeros((0, 0), np.bool_)),
        hidden=None,
        unresolved=None,
    )
    return bare, {name: array for name, array in large.items() if array is not None}


def with_arrays(bare: PreparedPage, page: Page, arrays: Mapping[str, NDArray[Any]]) -> PreparedPage:
    """Return the design of ``page`` of which ``without_arrays`` returned these."""
    return replace(
        bare,
        page=page,
        images=replace(bare.images, levels=arrays["levels"]),
        landmarks=replace(bare.landmarks, windows=arrays["windows"]),
        flat=replace(bare.flat, flat=arrays["flat"]),
        hidden=arrays.get("hidden"),
        unresolved=arrays.get("unresolved"),
    )


def prepare_page(
    page: Page,
    expected: Prediction,
    *,
    sensors: Sequence[SensorModel],
    geometry: ScanGeometry,
    fringes: bool = False,
    prior: PrintPrior | None = None,
    zones: PageZones | None = None,
    glyphs: bool = False,
    screen: tuple[Screen, InkLight] | None = None,
    own_light: InkLight | None = None,
) -> PreparedPage:
    """Prepare a design for its scans.

    Parameters
    ----------
    page : the design.
    expected : its prediction in its nominal place.
    sensors, geometry : of the camera's own pixels.
    fringes : whether prediction follows the fringes of planes that share edges (``register_by_fringes``).
    prior : of good prints; None: the press world's.
    zones : of the page; None: there are none.
    glyphs : whether its glyphs are tested.
    screen : of the press, and the light that its tints take; None: not stated.
    own_light : light that the inks of a press take that rips pages itself, whose planes lie between the raster's
        pixels; None: planes are displaced by whole pixels.
    """
    bins, prior = bins_of(geometry), prior or PrintPrior()
    at = binned_geometry(geometry, bins)
    taken_as = mode_sensors(sensors, geometry)
    thin = thinned(page, bins)
    modes = prepare_modes(thin, sensors=taken_as, geometry=at)
    inside = pixel_map(page, at, IN_PLACE).inside
    modes = replace(modes, images=first_lines(modes.images, len(inside)))
    images, ignored = None, None
    if zones is not None:
        images, ignored = ZoneImages.of(zones, page, at), ignored_tiles(zones, page, geometry, SHRINK)
        inside = inside & (images.images[0] < 0.5)
    halftone, beat, along = HALFTONE, None, None
    if screen is not None:
        single = _beat(screen, sensors, geometry, correlated=False)
        halftone = max(HALFTONE, float(np.sqrt(single.max())))
        beat = _beat(screen, sensors, geometry, bins=bins)
        line_mm, tile_lines = at.line_pitch_mm, tile_side(at)
        along = row_beats(
            modes.cover, *screen, taken_as, line_mm=line_mm, tile_lines=tile_lines, periods_mm=PERIODS_MM
        )
    landmarks = prepare(
        page,
        expected,
        sensors=sensors,
        geometry=geometry,
        prior=prior.of_place,
        halftone=halftone,
        ignored=ignored,
    )
    overlaps = None
    if fringes:
        finer = 1 if own_light is None else FRINGE_PARTS
        overlaps = overlaps_of(page, landmarks, good_mm=prior.most_plane_mm, finer=finer)
    return PreparedPage(
        page=page,
        flat=FlatGroups.of(page, most_steps(page, good_mm=prior.most_plane_mm)),
        landmarks=landmarks,
        overlaps=overlaps,
        images=QuantisedImages.of(modes.images),
        colours=page_colours(modes.cover),
        page_features=page_features(modes, inside),
        prior=prior,
        zones=images,
        binned_geometry=at,
        binned_sensors=taken_as,
        unresolved=unresolved_places(page, thin, at),
        hidden=hidden_edges(modes, taken_as),
        specks=speck_shares(prior, taken_as, at.pixel_pitch_mm),
        glyphs=prepare_glyphs(page, sensors=taken_as, geometry=at) if glyphs else None,
        beat=beat,
        row_beats=along,
        own_light=own_light,
    )


def _beat(
    screen: tuple[Screen, InkLight], sensors: Sequence[SensorModel], geometry: ScanGeometry, **how: Any
) -> NDArray[np.float64]:
    """Return ``beat_contrasts``, called with ``how``, of the sensor that sees most of the beat."""
    pitch_mm = geometry.pixel_pitch_mm, geometry.line_pitch_mm
    return np.asarray(
        np.max([beat_contrasts(*screen, sensor.footprint, pitch_mm, **how) for sensor in sensors], axis=0)
    )

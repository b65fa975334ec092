"""Analysis of a scan: the variation of a press's good prints is removed, and the residuals are summed up.

``families`` computes statistics from the sums, and ``model`` decides by them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Final, NoReturn

import numpy as np

from prooflight.cmyk import INKS
from prooflight.detectors.matched_filter.fit.beat import RowBeats, beat_contrasts, row_beats
from prooflight.detectors.matched_filter.fit.binning import (
    binned_geometry,
    binned_sensor,
    bins_of,
    thinned,
)
from prooflight.detectors.matched_filter.fit.columns import bridged, faulty_columns
from prooflight.detectors.matched_filter.fit.modes import (
    AddedInks,
    QuantisedImages,
    first_lines,
    page_features,
    pixel_map,
    prepare_modes,
)
from prooflight.detectors.matched_filter.fit.nuisance import ResidualVariance, page_colours
from prooflight.detectors.matched_filter.fit.residuals import corrected, in_register
from prooflight.detectors.matched_filter.fit.special_places import (
    ZoneImages,
    hidden_edges,
    ignored_tiles,
    unresolved_places,
)
from prooflight.detectors.matched_filter.glyphs.scoring import (
    NOTHING,
    chance_astray,
    prepare_glyphs,
    score_glyphs,
)
from prooflight.detectors.matched_filter.scan_images import DesignImages, HostImages, PlacedPage
from prooflight.detectors.matched_filter.statistics.local_evidence import MODES, PERIODS_MM, tile_side
from prooflight.detectors.matched_filter.statistics.marks import measure_marks, speck_shares
from prooflight.detectors.print_prior import PrintPrior
from prooflight.kernels.registration.coarse import SHRINK
from prooflight.prediction.predict import Prediction, repeats_of
from prooflight.prediction.printed import PrintedPage
from prooflight.registration.landmarks import HALFTONE
from prooflight.registration.overlaps import overlaps_of
from prooflight.registration.planes import register_by_fringes, register_far_planes
from prooflight.registration.register import prepare, register
from prooflight.scans.placement import IN_PLACE

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.fit.nuisance import Colours, Fit, FitBlocks, PlacedScan
    from prooflight.detectors.matched_filter.glyphs.scoring import PageGlyphs, ScoredPage
    from prooflight.detectors.matched_filter.scan_images import Engine, ScanImages
    from prooflight.detectors.matched_filter.statistics.local_evidence import Sums
    from prooflight.detectors.matched_filter.statistics.marks import Marks
    from prooflight.pages.pdf.area_averages import InkLight
    from prooflight.pages.raster import Page
    from prooflight.pages.screen import Screen
    from prooflight.pages.zones.zone import PageZones
    from prooflight.prediction.tables import SensorModel
    from prooflight.registration.overlaps import Overlaps
    from prooflight.registration.register import Landmarks, Registration
    from prooflight.scans.geometry import ScanGeometry
    from prooflight.scans.placement import Placement


MAX_REPREDICTIONS: Final = 2
"""Maximum number of times that a page is predicted again at the position that its residuals indicate."""
FAR_PIXELS: Final = 0.1
"""Minimum displacement of some part of a page that requires another prediction."""
FRINGE_PARTS: Final = 2
"""Number of steps over a raster pixel by which planes of a press that rips pages itself are sought by their fringes."""
REMAINING_SHARE: Final = 0.75
"""Share of the previous displacement from which no other prediction is made: displacements caused by a page's
edge and by uneven light do not decrease."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PreparedPage:
    """A design prepared for its scans."""

    page: Page
    repeats: NDArray[np.bool_]
    """See ``predict``."""
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
    """None: glyphs are not tested."""
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

    @property
    def design_images(self) -> DesignImages:
        """Its images, and how it is seen."""
        return DesignImages(
            page=self.page,
            images=self.images,
            hidden=self.hidden,
            beat=self.beat,
            row_beats=self.row_beats,
            unresolved=self.unresolved,
            added=self.added,
            colours=self.colours,
            prior=self.prior,
            sensors=self.binned_sensors,
            geometry=self.binned_geometry,
            camera_sensors=self.landmarks.sensors,
            camera_geometry=self.landmarks.geometry,
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
        "hidden": design.hidden,
        "unresolved": design.unresolved,
    }
    bare = replace(
        design,
        page=replace(design.page, cmyk=np.zeros((1, 1, INKS), np.uint8)),
        images=replace(design.images, levels=np.zeros((0, 0, 0), np.uint16)),
        landmarks=replace(design.landmarks, windows=np.zeros(0, np.float32)),
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
        repeats=repeats_of(page),
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScanAnalysis:
    """Result of one scan, before any decision."""

    registration: Registration
    fit: Fit
    sums: Sums
    marks: Marks
    noise: NDArray[np.float64]
    """(sensors,) true temporal variance over the predicted one. [-]"""
    careful: NDArray[np.bool_] | None
    """(lines, pixels) binned pixels of careful areas; None: the page has no zones."""
    summed: Callable[[tuple[str, ...]], Sums]
    """Function that returns the sums of given modes of ``MODES``."""
    placed: Callable[[], PlacedScan]
    """Function that returns the scan and its modes at the page's placement."""
    far_planes: Callable[[], tuple[NDArray[np.float64], NDArray[np.bool_]] | None]
    """Function that returns ``register_far_planes``."""
    block_sums: Callable[[], tuple[FitBlocks, NDArray[np.float32]]]
    """Function that returns the blocks of the fit, and their sums over the placed scan."""
    glyphs: ScoredPage = NOTHING
    """Result of the glyph tests."""
    blind_columns: tuple[int, ...] = ()
    """Camera columns on the page that are faulty in every sensor, so that nothing saw what passed under them."""

    def of_every_mode(self) -> ScanAnalysis:
        """Return the analysis with the sums of all ``MODES``."""
        return self if self.sums.modes == MODES else replace(self, sums=self.summed(MODES))

    def settled(self) -> ScanAnalysis:
        """Return the analysis with the sums that it has and no others, so that the scan's images may be forgotten."""
        return replace(
            self, summed=_forgotten, placed=_forgotten, far_planes=_forgotten, block_sums=_forgotten
        )


def _forgotten(*_: object) -> NoReturn:
    raise RuntimeError("the scan's images are no longer in memory")


def analyse(
    prepared: PreparedPage,
    scan: NDArray[np.uint16],
    *,
    lost: NDArray[np.bool_] | None = None,
    residual_variance: ResidualVariance | None = None,
    analysed_modes: tuple[str, ...] = MODES,
    floor_share: float = 0.0,
    engine: Engine = HostImages,
    threads: int = 1,
) -> ScanAnalysis:
    """Find the page in a scan, remove the variation of good prints, and sum up the residuals.

    Where good prints are exact (``ResidualVariance.exact``) nothing is removed: the results of registration
    and fit are evidence alone.

    Parameters
    ----------
    prepared : the page.
    scan : (sensors, lines, pixels) raw digital numbers [DN]. It may have fewer lines than its geometry states, and
        no more: missing lines are unknown, like what is off the page.
    lost : (sensors, lines) lines of the scan that are unknown as well; None: none are.
    residual_variance : variance of good prints in addition to the fit; None: an office-class press's.
    analysed_modes : modes that are summed up at once, of ``MODES``, light the first.
    floor_share : as in ``measure_marks``.
    engine : what computes the scan's images.
    threads : number of threads that share the work.
    """
    landmarks = prepared.landmarks
    height_mm = prepared.page.height_mm
    columns = faulty_columns(scan, landmarks.sensors, landmarks.geometry, page_height_mm=height_mm)
    scan = bridged(scan, columns, landmarks.sensors)
    return analyse_registered(
        prepared,
        scan,
        register(landmarks, scan, lost=lost, threads=threads),
        lost=lost,
        columns=columns,
        residual_variance=residual_variance or ResidualVariance(),
        analysed_modes=analysed_modes,
        floor_share=floor_share,
        engine=engine,
        threads=threads,
    )


def analyse_registered(
    prepared: PreparedPage,
    scan: NDArray[np.uint16],
    registration: Registration,
    *,
    lost: NDArray[np.bool_] | None = None,
    columns: NDArray[np.bool_] | None = None,
    residual_variance: ResidualVariance,
    analysed_modes: tuple[str, ...] = MODES,
    floor_share: float = 0.0,
    engine: Engine = HostImages,
    threads: int = 1,
) -> ScanAnalysis:
    """Analyse a scan whose page is registered already; see ``analyse``.

    columns: which are faulty (sensors, pixels), and bridged in the scan; None: none.
    """
    at, bins = prepared.binned_geometry, bins_of(prepared.landmarks.geometry)
    residual_variance = residual_variance.with_edges_off(prepared.page.edge_sd_mm / at.pixel_pitch_mm)
    placed, careful, planes_mm = _placed(prepared, scan, registration, residual_variance, lost, threads)
    where = placed.where
    # The card has no body for the beat of a stated screen.
    on_host = residual_variance.exact or prepared.beat is not None
    images = (HostImages if on_host else engine)(placed)
    fit = images.fitted(planes_mm / at.pixel_pitch_mm)
    noise = images.take_fit(fit.emptied() if residual_variance.exact else fit)
    faulty = np.zeros((len(noise), at.pixels), bool)
    if columns is not None:
        faulty = np.asarray(columns.reshape(len(noise), -1, bins).any(axis=2))
    if faulty.any():  # what such a column sees says nothing
        images.leave_out(faulty)
    if not residual_variance.exact:
        _take_moves(images, placed.placement, at, prepared.page.width_mm)
    marks, glyphs = _marks_and_glyphs(prepared, images, placed, registration, floor_share)
    return ScanAnalysis(
        registration=registration,
        fit=fit,
        sums=images.summed(analysed_modes),
        marks=marks,
        noise=noise,
        careful=careful,
        summed=images.summed,
        placed=images.placed,
        far_planes=partial(
            register_far_planes,
            prepared.page,
            prepared.landmarks,
            scan,
            registration,
            lost=lost,
            threads=threads,
        ),
        block_sums=images.block_sums,
        glyphs=glyphs,
        blind_columns=tuple((np.flatnonzero(faulty.all(axis=0) & where.inside.any(axis=0)) * bins).tolist()),
    )


def _placed(
    prepared: PreparedPage,
    scan: NDArray[np.uint16],
    registration: Registration,
    residual_variance: ResidualVariance,
    lost: NDArray[np.bool_] | None,
    threads: int,
) -> tuple[PlacedPage, NDArray[np.bool_] | None, NDArray[np.float64]]:
    """Return the page where its scan shows it, its careful areas, and its planes (4, 2) [mm] in the raster's places.

    The careful areas are None if the page has no zones.
    """
    page, geometry = prepared.page, prepared.landmarks.geometry
    placement, planes_mm = IN_PLACE, np.zeros_like(registration.planes_mm)
    if not residual_variance.exact:
        placement, planes_mm = _followed(prepared, scan, registration, lost, threads)
    where = pixel_map(page, prepared.binned_geometry, placement)
    if scan.shape[1] < geometry.lines(page.height_mm):
        where = where.of_first(scan.shape[1] // bins_of(geometry))
    careful = None
    if prepared.zones is not None:
        ignored, careful = prepared.zones.moved(where)
        where = replace(where, inside=where.inside & ~ignored)
    most_mm = prepared.prior.most_plane_mm
    printed, planes_mm = in_register(page, planes_mm, good_mm=most_mm, light=prepared.own_light)
    repeats = prepared.repeats
    if not isinstance(printed, PrintedPage) and printed is not page:
        repeats = repeats_of(printed)
    placed = PlacedPage(
        design=prepared.design_images,
        scan=scan,
        where=where,
        printed=printed,
        repeats=repeats,
        placement=placement,
        lost=lost,
        residual_variance=residual_variance,
        threads=threads,
    )
    return placed, careful, planes_mm


def _marks_and_glyphs(
    prepared: PreparedPage,
    images: ScanImages,
    placed: PlacedPage,
    registration: Registration,
    floor_share: float,
) -> tuple[Marks, ScoredPage]:
    """Return the small windows and the glyphs of the residuals; see ``measure_marks`` and ``score_glyphs``."""
    where, threads = placed.where, placed.threads
    light, left, weight = images.residuals()
    marks = measure_marks(
        prepared.binned_sensors,
        where.inside,
        light,
        left,
        weight,
        geometry=prepared.binned_geometry,
        page_width_mm=prepared.page.width_mm,
        unresolved=images.unresolved,
        hidden=images.hidden,
        edges_in_border=prepared.own_light is not None,
        tolerance=prepared.prior.place,
        specks=prepared.specks,
        floor_share=floor_share,
        threads=threads,
    )
    if prepared.glyphs is None:
        return marks, NOTHING
    # Glyphs are weighed at unresolved places all the same: their own strokes are what is known.
    astray = _astray(registration, prepared.binned_geometry)
    return marks, score_glyphs(prepared.glyphs, left, weight, light, where, astray=astray, threads=threads)


def _astray(registration: Registration, geometry: ScanGeometry) -> float:
    """Return the chance that glyphs lie elsewhere than the page was located; 1: it was not."""
    if not registration.located:
        return 1.0
    pitches_mm = geometry.pixel_pitch_mm, geometry.line_pitch_mm
    return chance_astray([sd / pitch for sd, pitch in zip(registration.shift_sd_mm, pitches_mm, strict=True)])


def _take_moves(images: ScanImages, placement: Placement, geometry: ScanGeometry, width_mm: float) -> None:
    """Remove the local displacements of the page relative to ``placement`` from the residuals, in place.

    One linear step leaves a considerable part at edges that are sharper than a pixel. These are predicted
    again at their estimated position, and once more if that reduced the displacement and some remain
    displaced. The remainder is small.
    """
    moves = images.local_moves()
    for _ in range(MAX_REPREDICTIONS):
        placement = corrected(placement, moves, geometry, width_mm)
        images.predict_again(placement)
        moves, previous = images.local_moves(), moves
        far = np.abs(moves) > FAR_PIXELS
        if not (far & (np.abs(moves) < REMAINING_SHARE * np.abs(previous))).any():
            break
    images.take_moves(moves)


def _followed(
    prepared: PreparedPage,
    scan: NDArray[np.uint16],
    registration: Registration,
    lost: NDArray[np.bool_] | None,
    threads: int,
) -> tuple[Placement, NDArray[np.float64]]:
    """Return the placement and the planes (4, 2) [mm] that prediction follows."""
    if prepared.overlaps is None or not registration.located:
        return registration.placement, registration.planes_mm
    landmarks = prepared.landmarks if prepared.own_light is None else prepared.landmarks.finer(FRINGE_PARTS)
    fringes = register_by_fringes(
        prepared.overlaps, landmarks, scan, registration, lost=lost, threads=threads
    )
    if fringes is None:
        return registration.placement, registration.planes_mm
    return fringes.placement, fringes.planes_mm

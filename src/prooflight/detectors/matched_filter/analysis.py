"""Analysis of a scan: the variation of a press's good prints is removed, and the residuals are summed up.

Steps over all pixels are those of ``ScanImages``: ``HostImages`` computes them on the processor, ``card.images`` on a
graphics card. ``families`` computes statistics from the sums, and ``model`` decides by them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Final, NoReturn, Protocol

import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.matched_filter.design import FRINGE_PARTS, PreparedPage
from prooflight.detectors.matched_filter.fit.beat import add_beat
from prooflight.detectors.matched_filter.fit.binning import (
    binned,
    binned_scan,
    bins_of,
    bridged,
    faulty_columns,
    lengthened,
)
from prooflight.detectors.matched_filter.fit.modes import (
    AddedInks,
    PixelMap,
    moved,
    moved_modes,
    pixel_map,
)
from prooflight.detectors.matched_filter.fit.nuisance import (
    Fit,
    FitBlocks,
    PlacedScan,
    ResidualVariance,
    summed_blocks,
)
from prooflight.detectors.matched_filter.fit.residuals import (
    by_prediction,
    corrected,
    in_register,
    local_moves,
    residual_images,
    take_moves,
)
from prooflight.detectors.matched_filter.fit.special_places import with_hidden_edges
from prooflight.detectors.matched_filter.glyphs.scoring import (
    NOTHING,
    ScoredPage,
    chance_astray,
    score_glyphs,
)
from prooflight.detectors.matched_filter.statistics.local_evidence import MODES, Sums, summed
from prooflight.detectors.matched_filter.statistics.marks import Marks, measure_marks
from prooflight.detectors.matched_filter.statistics.statistic import SCREEN_MODES
from prooflight.prediction.predict import Prediction, predict
from prooflight.prediction.printed import PrintedPage
from prooflight.prediction.raster_light import RasterLight, raster_light
from prooflight.registration.planes import register_by_fringes, register_far_planes
from prooflight.registration.register import Registration, register
from prooflight.scans.placement import IN_PLACE, Placement
from prooflight.scans.scan import in_groups

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.scans.geometry import ScanGeometry

UNRESOLVED: Final = 0.25
"""Share of a moved pixel that was unresolved from which all of it is. [-]"""
ADDED: Final = frozenset(name for name in MODES if name.startswith("add-"))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlacedPage:
    """A page where its scan shows it."""

    design: PreparedPage
    scan: NDArray[np.uint16]
    """(sensors, lines, pixels) raw digital numbers. [DN]"""
    where: PixelMap
    """Its binned pixels; ignored areas are not inside."""
    printed: Page | PrintedPage
    """The design with its planes displaced."""
    placement: Placement
    lost: NDArray[np.bool_] | None
    """(sensors, lines) lines of the scan that are unknown; None: none are."""
    residual_variance: ResidualVariance
    threads: int

    def raster_light(self) -> RasterLight | None:
        """Look up the light of what was printed, for ``predict``; None: it predicts camera pixels."""
        if self.residual_variance.exact:
            return None
        design = self.design
        return raster_light(self.printed, sensors=design.binned_sensors, flat=design.flat)

    def predict(self, placement: Placement, raster: RasterLight | None = None) -> Prediction:
        """Predict binned pixels; raster: ``raster_light``.

        A prediction in binned pixels takes half the time. At edges, where a column's own gain is applied to its
        neighbours' light as well, it is within a third of the noise of the binned prediction in camera pixels.
        That is more than prints scatter by only if good prints are exact.
        """
        design, threads = self.design, self.threads
        if not self.residual_variance.exact:
            return predict(
                self.printed,
                sensors=design.binned_sensors,
                geometry=design.binned_geometry,
                placement=placement,
                raster=raster,
                threads=threads,
            )
        sensors, geometry = design.landmarks.sensors, design.landmarks.geometry
        bins = bins_of(geometry)
        fine = predict(self.printed, sensors=sensors, geometry=geometry, placement=placement, threads=threads)
        return Prediction(
            expected_dn=binned(fine.expected_dn, bins),
            variance_dn2=binned(fine.variance_dn2, bins) / np.float32(bins**2),
        )

    def binned_lost(self) -> NDArray[np.bool_] | None:
        """Return ``lost`` in binned lines."""
        if self.lost is None:
            return None
        return in_groups(self.lost, bins_of(self.design.landmarks.geometry), self.where.inside.shape[0])


class ScanImages(Protocol):
    """Images of a scan; methods are called in the order in which they stand here."""

    hidden: NDArray[np.float32] | None
    """``PreparedPage.hidden`` at the page's placement."""
    unresolved: NDArray[np.bool_] | None
    """(lines, pixels) which pixels see a design finer than they resolve; None: none do."""

    def fitted(self, planes: NDArray[np.float64]) -> Fit:
        """Estimate every nuisance parameter; planes (4, 2): where their estimation starts [pixels]."""

    def block_sums(self) -> tuple[FitBlocks, NDArray[np.float32]]:
        """Return the blocks of the fit, and their sums on the processor (``summed_blocks``)."""

    def take_fit(self, fit: Fit) -> NDArray[np.float64]:
        """Make residuals and their inverse variance after a fit; return each sensor's noise factor."""

    def leave_out(self, faulty: NDArray[np.bool_]) -> None:
        """Clear residuals and weight of columns (sensors, pixels)."""

    def local_moves(self) -> NDArray[np.float32]:
        """See ``moves.local_moves``."""

    def predict_again(self, placement: Placement) -> None:
        """Change residuals to a prediction at another placement; fitted amounts stay."""

    def take_moves(self, moves: NDArray[np.float32]) -> None:
        """Remove displacements from the residuals to first order."""

    def residuals(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """Return expected light, residuals and inverse variance, (sensors, lines, pixels) each."""

    def summed(self, modes: tuple[str, ...]) -> Sums:
        """Return the sums of modes of ``MODES``, light the first; may be called again, from any thread."""

    def placed(self) -> PlacedScan:
        """Return the scan and its modes at the page's placement, on the processor."""


Engine = Callable[[PlacedPage], ScanImages]
"""Class of ``ScanImages`` that computes the images of a scan, given its page."""


class HostImages:
    """Images of a scan on the processor."""

    def __init__(self, page: PlacedPage) -> None:
        design, where, threads = page.design, page.where, page.threads
        self._page, self._placement = page, page.placement
        self._raster = page.raster_light()
        seen = page.predict(page.placement, self._raster)
        modes = moved_modes(design.images, where, len(seen.expected_dn), threads=threads)
        self.hidden, self._is_cleared = None, False
        if design.hidden is not None:
            self.hidden = moved(design.hidden, where, threads=threads)
            modes.texture[...] = with_hidden_edges(modes.texture, self.hidden, page.residual_variance)
        if design.beat is not None and not page.residual_variance.exact:
            modes.cleared()
            add_beat(modes, design.beat, page.residual_variance)
        bins = bins_of(design.landmarks.geometry)
        self._placed = PlacedScan(
            measured_dn=lengthened(binned_scan(page.scan, bins), where.inside.shape[0]),
            seen=seen,
            modes=modes,
            where=where,
            sensors=design.binned_sensors,
            colours=design.colours,
            lost=page.binned_lost(),
        )
        self.unresolved = None
        if design.unresolved is not None:
            self.unresolved = moved(design.unresolved[None], where, threads=threads)[0] > UNRESOLVED
        self._before = seen.expected_dn
        self._light = self._placed.light()

    def fitted(self, planes: NDArray[np.float64]) -> Fit:
        """See ``ScanImages``."""
        design, blocks = self._page.design, FitBlocks.of(self._placed.seen_by_all())
        self._block_sums = blocks, summed_blocks(self._placed, blocks, self._page.threads)
        return design.nuisance_model(*self._block_sums, planes, self._page.residual_variance).fit()

    def block_sums(self) -> tuple[FitBlocks, NDArray[np.float32]]:
        """See ``ScanImages``; those of ``fitted``, since the placed scan stays."""
        return self._block_sums

    def take_fit(self, fit: Fit) -> NDArray[np.float64]:
        """See ``ScanImages``."""
        self._left, self._weight, self._of_edges, noise = residual_images(
            self._placed,
            fit,
            self._light,
            residual_variance=self._page.residual_variance,
            threads=self._page.threads,
        )
        return noise

    def leave_out(self, faulty: NDArray[np.bool_]) -> None:
        """See ``ScanImages``."""
        for index in np.flatnonzero(faulty.any(axis=1)):
            self._left[index][:, faulty[index]] = self._weight[index][:, faulty[index]] = 0.0

    def local_moves(self) -> NDArray[np.float32]:
        """See ``ScanImages``."""
        return local_moves(self._left, self._weight, self._light, threads=self._page.threads)

    def predict_again(self, placement: Placement) -> None:
        """See ``ScanImages``."""
        after = self._page.predict(placement, self._raster).expected_dn
        by_prediction(self._left, self._weight, self._before, after, threads=self._page.threads)
        self._before = after

    def take_moves(self, moves: NDArray[np.float32]) -> None:
        """See ``ScanImages``."""
        take_moves(self._left, self._weight, self._light, moves, threads=self._page.threads)

    def residuals(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """See ``ScanImages``."""
        return self._light, self._left, self._weight

    def placed(self) -> PlacedScan:
        """See ``ScanImages``."""
        if not self._is_cleared:
            self._placed.modes.cleared()
            self._is_cleared = True
        return self._placed

    def summed(self, modes: tuple[str, ...]) -> Sums:
        """See ``ScanImages``."""
        return sums_of(
            self._page,
            self._placed if modes == SCREEN_MODES else self.placed(),
            self._light,
            self._left,
            self._weight,
            self._of_edges,
            self.unresolved,
            modes,
        )


def sums_of(
    page: PlacedPage,
    placed: PlacedScan,
    light: NDArray[np.float32],
    left: NDArray[np.float32],
    weight: NDArray[np.float32],
    of_edges: NDArray[np.float32],
    unresolved: NDArray[np.bool_] | None,
    modes: tuple[str, ...],
) -> Sums:
    """Return the sums of modes of ``MODES`` on the processor; unresolved pixels have no weight in them."""
    design, threads = page.design, page.threads
    return summed(
        with_added(placed, design.added, threads=threads) if ADDED.intersection(modes) else placed,
        light,
        left,
        weight if unresolved is None else np.where(unresolved, np.float32(0), weight),
        of_edges,
        geometry=design.binned_geometry,
        page_width_mm=design.page.width_mm,
        prior=design.prior,
        analysed_modes=modes,
        row_beats=None if page.residual_variance.exact else design.row_beats,
        threads=threads,
    )


def with_added(placed: PlacedScan, added: AddedInks, *, threads: int = 1) -> PlacedScan:
    """Return the scan with the images of inks printed where they are not, moved to the page's placement."""
    images = moved(added.images, placed.where, threads=threads)
    shape = (placed.modes.sensors, -1, *images.shape[1:])
    return replace(placed, modes=replace(placed.modes, add=images.reshape(shape)))


MAX_REPREDICTIONS: Final = 2
"""Maximum number of times that a page is predicted again at the position that its residuals indicate."""
FAR_PIXELS: Final = 0.1
"""Minimum displacement of some part of a page that requires another prediction."""
REMAINING_SHARE: Final = 0.75
"""Share of the previous displacement from which no other prediction is made: displacements caused by a page's
edge and by uneven light do not decrease."""


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
    placed = PlacedPage(
        design=prepared,
        scan=scan,
        where=where,
        printed=printed,
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

"""Our detector's analysis of a scan: what good prints of a press do is taken out, and what is left is summed up.

``families`` makes statistics of that, and ``model`` decides by them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.matched_filter.fit.binning import (
    binned,
    binned_geometry,
    binned_scan,
    binned_sensor,
    bins_of,
    lengthened,
    thinned,
)
from prooflight.detectors.matched_filter.fit.modes import (
    AddedInks,
    Modes,
    first_lines,
    moved,
    page_features,
    pixel_map,
    prepare_modes,
)
from prooflight.detectors.matched_filter.fit.moves import by_prediction, local_moves, nearer, take_moves
from prooflight.detectors.matched_filter.fit.nuisance import (
    PlacedScan,
    PrintPrior,
    ResidualVariance,
    fit_nuisances,
    page_colours,
)
from prooflight.detectors.matched_filter.fit.residuals import in_register, residual_images
from prooflight.detectors.matched_filter.fit.zone_images import ZoneImages, ignored_tiles
from prooflight.detectors.matched_filter.glyphs.weighing import (
    NOTHING,
    chance_astray,
    prepare_glyphs,
    weighed,
)
from prooflight.detectors.matched_filter.statistics.local_evidence import MODES, summed
from prooflight.detectors.matched_filter.statistics.marks import measure_marks
from prooflight.kernels.registration.coarse import SHRINK
from prooflight.prediction.predict import Prediction, predict
from prooflight.registration.overlaps import overlaps_of
from prooflight.registration.planes import register_by_fringes
from prooflight.registration.register import prepare, register
from prooflight.scans.placement import IN_PLACE
from prooflight.scans.scan import in_groups

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.fit.nuisance import Colours, Fit
    from prooflight.detectors.matched_filter.glyphs.weighing import PageGlyphs, WeighedPage
    from prooflight.detectors.matched_filter.statistics.local_evidence import Sums
    from prooflight.detectors.matched_filter.statistics.marks import Marks
    from prooflight.pages.raster import Page
    from prooflight.pages.zones.zone import PageZones
    from prooflight.prediction.printed import PrintedPage
    from prooflight.prediction.tables import SensorModel
    from prooflight.registration.overlaps import Overlaps
    from prooflight.registration.register import Landmarks, Registration
    from prooflight.scans.geometry import ScanGeometry
    from prooflight.scans.placement import Placement


PREDICTED_ANEW: Final = 2
"""Times, at most, that a page is predicted where its residuals say that it lies ..."""
FAR_PIXELS: Final = 0.1
"""... and how far off some part of it must lie for the second; not one ..."""
STILL_ASKED: Final = 0.75
"""... that asks for so much of what it did before: what a page's edge and uneven light ask for stays as it is."""
ADDED: Final = frozenset(name for name in MODES if name.startswith("add-"))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PreparedPage:
    """A design ready for its scans."""

    page: Page
    landmarks: Landmarks
    overlaps: Overlaps | None = None
    """Where planes share edges, if prediction is to follow their fringes; None: it follows registration alone."""
    images: NDArray[np.float32]
    """``Modes.images`` of the page in its place, in binned pixels."""
    added: AddedInks
    colours: Colours
    page_features: NDArray[np.float64]
    prior: PrintPrior
    """What good prints do."""
    zones: ZoneImages | None
    """What is ignored, and what is judged by itself as well; None: nothing."""
    binned_geometry: ScanGeometry
    binned_sensors: tuple[SensorModel, ...]
    glyphs: PageGlyphs | None = None
    """None: they are not weighed."""

    def under(self, sensors: Sequence[SensorModel]) -> PreparedPage:
        """The same of sensors of which only the columns' gains are others; modes are of bare columns, and stay.

        Landmarks stay too: other gains would hardly choose others.
        """
        landmarks = replace(self.landmarks, sensors=tuple(sensors))
        return replace(self, landmarks=landmarks, binned_sensors=_binned(sensors, landmarks.geometry))


def _binned(sensors: Sequence[SensorModel], geometry: ScanGeometry) -> tuple[SensorModel, ...]:
    """What ``bins_of`` pixels of each see together."""
    pitch_mm = geometry.pixel_pitch_mm, geometry.line_pitch_mm
    return tuple(binned_sensor(sensor, bins_of(geometry), pitch_mm) for sensor in sensors)


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
) -> PreparedPage:
    """All that is known of a design ahead of its scans; expected: its prediction in its place.

    fringes: where planes share edges, prediction follows their fringes (``register_by_fringes``). prior: what good
    prints do, by default those of the press world. glyphs: whether its glyphs
    are to be weighed.
    """
    bins, prior = bins_of(geometry), prior or PrintPrior()
    at = binned_geometry(geometry, bins)
    taken_as = _binned(sensors, geometry)
    modes = prepare_modes(thinned(page, bins), sensors=taken_as, geometry=at)
    inside = pixel_map(page, at, IN_PLACE).inside
    modes = replace(modes, images=first_lines(modes.images, len(inside)))
    images, ignored = None, None
    if zones is not None:
        images, ignored = ZoneImages.of(zones, page, at), ignored_tiles(zones, page, geometry, SHRINK)
        inside = inside & (images.images[0] < 0.5)
    landmarks = prepare(
        page, expected, sensors=sensors, geometry=geometry, prior=prior.of_place, ignored=ignored
    )
    overlaps = None
    if fringes:
        overlaps = overlaps_of(page, landmarks, good_mm=prior.most_plane_mm)
    return PreparedPage(
        page=page,
        landmarks=landmarks,
        overlaps=overlaps,
        images=modes.images,
        added=AddedInks(page, sensors=taken_as, geometry=at, bins=bins),
        colours=page_colours(modes.cover),
        page_features=page_features(modes, inside),
        prior=prior,
        zones=images,
        binned_geometry=at,
        binned_sensors=taken_as,
        glyphs=prepare_glyphs(page, sensors=taken_as, geometry=at) if glyphs else None,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScanAnalysis:
    """What one scan says, before anything is decided."""

    found: Registration
    fit: Fit
    sums: Sums
    marks: Marks
    noise: NDArray[np.float64]
    """(sensors,) true temporal variance over the prediction's. [-]"""
    careful: NDArray[np.bool_] | None
    """(lines, pixels) binned pixels of careful areas; None: the page has no zones."""
    summed: Callable[[tuple[str, ...]], Sums]
    """Sums of those of ``MODES`` that are named."""
    glyphs: WeighedPage = NOTHING
    """What it says of the page's glyphs."""

    def of_every_mode(self) -> ScanAnalysis:
        """The same with the sums of all ``MODES``."""
        return self if self.sums.modes == MODES else replace(self, sums=self.summed(MODES))


def analyse(
    prepared: PreparedPage,
    scan: NDArray[np.uint16],
    *,
    lost: NDArray[np.bool_] | None = None,
    residual_variance: ResidualVariance | None = None,
    looked_at: tuple[str, ...] = MODES,
    floor_share: float = 0.0,
    threads: int = 1,
) -> ScanAnalysis:
    """Find the page in a scan (sensors, lines, pixels), take out what good prints do, sum up what is left.

    A scan may have fewer lines than its geometry says, and no more: what it lacks is unknown, as what is off the page,
    and so are lines that were ``lost`` (sensors, lines).
    Where good prints are exact (``ResidualVariance.exact``) that is nothing: what registration and fit find is evidence
    alone. looked_at: those of ``MODES`` that are summed up at once, light the first. floor_share: as of
    ``measure_marks``. threads: that share its parts out.
    """
    return analyse_found(
        prepared,
        scan,
        register(prepared.landmarks, scan, lost=lost, threads=threads),
        lost=lost,
        residual_variance=residual_variance or ResidualVariance(),
        looked_at=looked_at,
        floor_share=floor_share,
        threads=threads,
    )


def analyse_found(
    prepared: PreparedPage,
    scan: NDArray[np.uint16],
    found: Registration,
    *,
    lost: NDArray[np.bool_] | None = None,
    residual_variance: ResidualVariance,
    looked_at: tuple[str, ...] = MODES,
    floor_share: float = 0.0,
    threads: int = 1,
) -> ScanAnalysis:
    """``analyse`` of a scan in which the page was found."""
    page, prior, at = prepared.page, prepared.prior, prepared.binned_geometry
    geometry = prepared.landmarks.geometry
    bins = bins_of(geometry)
    residual_variance = residual_variance.with_edges_off(page.edge_sd_mm / at.pixel_pitch_mm)
    if residual_variance.exact:
        placement, planes_mm = IN_PLACE, np.zeros_like(found.planes_mm)
    else:
        placement, planes_mm = _followed(prepared, scan, found, lost, threads)
    where = pixel_map(page, at, placement)
    if scan.shape[1] < geometry.lines(page.height_mm):
        where = where.of_first(scan.shape[1] // bins)
    careful = None
    if prepared.zones is not None:
        ignored, careful = prepared.zones.moved(where)
        where = replace(where, inside=where.inside & ~ignored)
    printed, planes_mm = in_register(page, planes_mm, good_mm=prior.most_plane_mm)
    seen = _predicted(prepared, printed, placement, exact=residual_variance.exact, threads=threads)
    placed = PlacedScan(
        measured_dn=lengthened(binned_scan(scan, bins), where.inside.shape[0]),
        seen=seen,
        modes=Modes(images=moved(prepared.images, where, threads=threads), sensors=len(seen.expected_dn)),
        where=where,
        sensors=prepared.binned_sensors,
        colours=prepared.colours,
        lost=None if lost is None else in_groups(lost, bins, where.inside.shape[0]),
    )
    fit = fit_nuisances(
        placed,
        planes=planes_mm / at.pixel_pitch_mm,
        pixel_mm=at.pixel_pitch_mm,
        prior=prior,
        residual_variance=residual_variance,
        threads=threads,
    )
    taken, light = fit.emptied() if residual_variance.exact else fit, placed.light()
    left, weight, of_edges, noise = residual_images(
        placed, taken, light, residual_variance=residual_variance, threads=threads
    )
    if not residual_variance.exact:
        _take_moves(prepared, printed, placement, seen, left, weight, light, threads=threads)

    marks = measure_marks(
        placed,
        light,
        left,
        weight,
        geometry=at,
        page_width_mm=page.width_mm,
        tolerance=prior.place,
        floor_share=floor_share,
        threads=threads,
    )

    def sums_of(modes: tuple[str, ...]) -> Sums:
        return summed(
            with_added(placed, prepared.added, threads=threads) if ADDED.intersection(modes) else placed,
            light,
            left,
            weight,
            of_edges,
            geometry=at,
            page_width_mm=page.width_mm,
            prior=prior,
            looked_at=modes,
            threads=threads,
        )

    glyphs = NOTHING
    if prepared.glyphs is not None:
        pitches_mm = at.pixel_pitch_mm, at.line_pitch_mm
        sd_pixels = [sd / pitch for sd, pitch in zip(found.shift_sd_mm, pitches_mm, strict=True)]
        astray = chance_astray(sd_pixels) if found.found else 1.0
        glyphs = weighed(prepared.glyphs, left, weight, light, where, astray=astray, threads=threads)
    return ScanAnalysis(
        found=found,
        fit=fit,
        sums=sums_of(looked_at),
        marks=marks,
        noise=noise,
        careful=careful,
        summed=sums_of,
        glyphs=glyphs,
    )


def _take_moves(
    prepared: PreparedPage,
    printed: Page | PrintedPage,
    placement: Placement,
    seen: Prediction,
    left: NDArray[np.float32],
    weight: NDArray[np.float32],
    light: NDArray[np.float32],
    *,
    threads: int,
) -> None:
    """Take out of the residuals, in place, that parts of the page lie a little off ``placement``.

    One linear step leaves a good deal of edges that are sharper than a pixel: they are predicted anew where they seem
    to lie, and once more if that was the way to go and some lie elsewhere still. What is left then is small.
    """
    before, width_mm = seen.expected_dn, prepared.page.width_mm
    moves = local_moves(left, weight, light, threads=threads)
    for _ in range(PREDICTED_ANEW):
        placement = nearer(placement, moves, prepared.binned_geometry, width_mm)
        after = _predicted(prepared, printed, placement, exact=False, threads=threads).expected_dn
        by_prediction(left, weight, before, after, threads=threads)
        before, moves, asked = after, local_moves(left, weight, light, threads=threads), moves
        far = np.abs(moves) > FAR_PIXELS
        if not (far & (np.abs(moves) < STILL_ASKED * np.abs(asked))).any():
            break
    take_moves(left, weight, light, moves, threads=threads)


def _predicted(
    prepared: PreparedPage, printed: Page | PrintedPage, placement: Placement, *, exact: bool, threads: int
) -> Prediction:
    """What binned pixels must show.

    Predicted as such, in half the time, they are within a third of their noise of what the camera's own pixels show
    together, at edges, where a column's own gain is taken with its neighbours' light. Only where good prints are exact
    is that more than they scatter by.
    """
    if not exact:
        sensors, geometry = prepared.binned_sensors, prepared.binned_geometry
        return predict(printed, sensors=sensors, geometry=geometry, placement=placement, threads=threads)
    sensors, geometry = prepared.landmarks.sensors, prepared.landmarks.geometry
    bins = bins_of(geometry)
    fine = predict(printed, sensors=sensors, geometry=geometry, placement=placement, threads=threads)
    return Prediction(
        expected_dn=binned(fine.expected_dn, bins),
        variance_dn2=binned(fine.variance_dn2, bins) / np.float32(bins**2),
    )


def with_added(placed: PlacedScan, added: AddedInks, *, threads: int = 1) -> PlacedScan:
    """With the images of inks printed where they are not, moved to where the page lies."""
    images = moved(added.images, placed.where, threads=threads)
    shape = (placed.modes.sensors, -1, *images.shape[1:])
    return replace(placed, modes=replace(placed.modes, add=images.reshape(shape)))


def _followed(
    prepared: PreparedPage,
    scan: NDArray[np.uint16],
    found: Registration,
    lost: NDArray[np.bool_] | None,
    threads: int,
) -> tuple[Placement, NDArray[np.float64]]:
    """The placement and the planes (4, 2) [mm] that prediction follows."""
    if prepared.overlaps is None or not found.found:
        return found.placement, found.planes_mm
    fringes = register_by_fringes(
        prepared.overlaps, prepared.landmarks, scan, found, lost=lost, threads=threads
    )
    if fringes is None:
        return found.placement, found.planes_mm
    return fringes.placement, fringes.planes_mm

"""Images of one scan from its prediction to its residuals: the steps of its analysis that go over all pixels.

``HostImages`` computes them on the processor, ``card.images`` on a graphics card; ``analysis`` decides their order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from prooflight.detectors.matched_filter.fit.beat import add_beat
from prooflight.detectors.matched_filter.fit.binning import binned, binned_scan, bins_of, lengthened
from prooflight.detectors.matched_filter.fit.modes import Modes, moved
from prooflight.detectors.matched_filter.fit.nuisance import (
    FitBlocks,
    NuisanceModel,
    PlacedScan,
    summed_blocks,
)
from prooflight.detectors.matched_filter.fit.residuals import (
    by_prediction,
    local_moves,
    residual_images,
    take_moves,
)
from prooflight.detectors.matched_filter.fit.special_places import with_hidden_edges
from prooflight.detectors.matched_filter.statistics.local_evidence import MODES, summed
from prooflight.prediction.predict import Prediction, predict
from prooflight.scans.scan import in_groups

if TYPE_CHECKING:
    from typing import Final

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.fit.beat import RowBeats
    from prooflight.detectors.matched_filter.fit.modes import AddedInks, PixelMap, QuantisedImages
    from prooflight.detectors.matched_filter.fit.nuisance import Colours, Fit, ResidualVariance
    from prooflight.detectors.matched_filter.statistics.local_evidence import Sums
    from prooflight.detectors.print_prior import PrintPrior
    from prooflight.pages.raster import Page
    from prooflight.prediction.printed import PrintedPage
    from prooflight.prediction.tables import SensorModel
    from prooflight.scans.geometry import ScanGeometry
    from prooflight.scans.placement import Placement

UNRESOLVED: Final = 0.25
"""Share of a moved pixel that was unresolved from which all of it is. [-]"""
ADDED: Final = frozenset(name for name in MODES if name.startswith("add-"))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DesignImages:
    """What a prepared design has of images, in its nominal place and in binned pixels, and how it is seen."""

    page: Page
    images: QuantisedImages
    """``Modes.images``."""
    hidden: NDArray[np.float32] | None
    """See ``hidden_edges``."""
    beat: NDArray[np.float64] | None
    """See ``beat_contrasts``, the greatest of all sensors; None: the press's screen is not stated."""
    row_beats: RowBeats | None
    """See ``row_beats``."""
    unresolved: NDArray[np.float32] | None
    """See ``unresolved_places``."""
    added: AddedInks
    colours: Colours
    prior: PrintPrior
    sensors: tuple[SensorModel, ...]
    geometry: ScanGeometry
    camera_sensors: tuple[SensorModel, ...]
    """Sensors in the camera's own pixels."""
    camera_geometry: ScanGeometry
    """Geometry in the camera's own pixels."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlacedPage:
    """A page where its scan shows it."""

    design: DesignImages
    scan: NDArray[np.uint16]
    """(sensors, lines, pixels) raw digital numbers. [DN]"""
    where: PixelMap
    """Its binned pixels; ignored areas are not inside."""
    printed: Page | PrintedPage
    """The design with its planes displaced."""
    repeats: NDArray[np.bool_]
    """See ``predict``: of the raster of ``printed``, whose rows are others where planes lie off by parts of a pixel."""
    placement: Placement
    lost: NDArray[np.bool_] | None
    """(sensors, lines) lines of the scan that are unknown; None: none are."""
    residual_variance: ResidualVariance
    threads: int

    def predict(self, placement: Placement) -> Prediction:
        """Predict binned pixels.

        A prediction in binned pixels takes half the time. At edges, where a column's own gain is applied to its
        neighbours' light as well, it is within a third of the noise of the binned prediction in camera pixels.
        That is more than prints scatter by only if good prints are exact.
        """
        design, threads = self.design, self.threads
        if not self.residual_variance.exact:
            return predict(
                self.printed,
                sensors=design.sensors,
                geometry=design.geometry,
                placement=placement,
                repeats=self.repeats,
                threads=threads,
            )
        sensors, geometry = design.camera_sensors, design.camera_geometry
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
        return in_groups(self.lost, bins_of(self.design.camera_geometry), self.where.inside.shape[0])


class ScanImages(Protocol):
    """Images of a scan; methods are called in the order in which they stand here."""

    hidden: NDArray[np.float32] | None
    """``DesignImages.hidden`` at the page's placement."""
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
"""What makes the images of a scan."""


class HostImages:
    """Images of a scan on the processor."""

    def __init__(self, page: PlacedPage) -> None:
        design, where, threads = page.design, page.where, page.threads
        self._page, self._placement = page, page.placement
        seen = page.predict(page.placement)
        modes = Modes(images=moved(design.images, where, threads=threads), sensors=len(seen.expected_dn))
        self.hidden = None
        if design.hidden is not None:
            self.hidden = moved(design.hidden, where, threads=threads)
            modes.texture[...] = with_hidden_edges(modes.texture, self.hidden, page.residual_variance)
        if design.beat is not None and not page.residual_variance.exact:
            add_beat(modes, design.beat, page.residual_variance)
        bins = bins_of(design.camera_geometry)
        self._placed = PlacedScan(
            measured_dn=lengthened(binned_scan(page.scan, bins), where.inside.shape[0]),
            seen=seen,
            modes=modes,
            where=where,
            sensors=design.sensors,
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
        model = NuisanceModel.of(
            *self._block_sums,
            sensors=design.sensors,
            colours=design.colours,
            planes=planes,
            pixel_mm=design.geometry.pixel_pitch_mm,
            prior=design.prior,
            residual_variance=self._page.residual_variance,
        )
        return model.fit()

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
        after = self._page.predict(placement).expected_dn
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
        return self._placed

    def summed(self, modes: tuple[str, ...]) -> Sums:
        """See ``ScanImages``."""
        return sums_of(
            self._page,
            self._placed,
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
        geometry=design.geometry,
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

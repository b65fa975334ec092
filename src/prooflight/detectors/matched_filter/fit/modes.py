"""Modes: response of a page's signal to more ink, less ink, dot gain, and ink where there was none.

They are computed once per design, before its scans, at camera resolution with the page in its nominal place,
and are then moved to where a scan's page is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INKS
from prooflight.detectors.matched_filter.fit.binning import thinned
from prooflight.kernels.memory import unset
from prooflight.kernels.prediction.lookup import NODES
from prooflight.kernels.residuals.fit import InkImages
from prooflight.kernels.residuals.moving import (
    CELL,
    CELL_LINES,
    STRETCH,
    find_filled,
    move_smooth,
    quantise,
    within,
)
from prooflight.kernels.residuals.page_features import page_feature_sums
from prooflight.pages.parallel import shared_out
from prooflight.prediction.predict import predict_light
from prooflight.prediction.tables import (
    EVERY,
    SLOPE_NODES,
    SameArray,
    SensorModel,
    mean_slopes,
    node_fractions,
)

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.scans.geometry import ScanGeometry
    from prooflight.scans.placement import Placement

MOST_LEVELS: Final = 65535
COVER_SCALE: Final = 4096.0
"""Signal that stands for full coverage while coverage is predicted. [DN]"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Modes:
    """Images (..., lines, pixels) of each cause's effect on the light of bare columns.

    Inks are in the order CMYK.
    """

    images: NDArray[np.float32]
    """(channels, lines, pixels) images that the fit needs, in one array that is moved at once; see the
    properties."""
    sensors: int
    shown: NDArray[np.bool_] | None = None
    """(channels, ., .) which ``CELL`` pixels of ``STRETCH`` lines of each image show anything, of moved images; None:
    any may. Others of gain and dot gain may hold anything until they are ``cleared``."""
    add: NDArray[np.float32] | None = None
    """(sensors, 4, lines, pixels) J (1 - a): effect of each ink printed where it is not; None: not computed.
    [DN]"""

    @property
    def gain(self) -> NDArray[np.float32]:
        """(sensors, 4, lines, pixels) J a: effect of a gain of 1 of each ink. [DN]"""
        return self._of_inks(0)

    @property
    def dot(self) -> NDArray[np.float32]:
        """(sensors, 4, lines, pixels) 4 J a (1 - a): effect of each ink's dot gain, stated at 50 %. [DN]"""
        return self._of_inks(1)

    @property
    def texture(self) -> NDArray[np.float32]:
        """(sensors, lines, pixels) sum over inks of J^2 a (1 - a): halftone variance at contrast 1. [DN^2]"""
        return self.images[-INKS - self.sensors : -INKS]

    @property
    def cover(self) -> NDArray[np.float32]:
        """(4, lines, pixels) ink area, as the first sensor's lens blurs it. [-]"""
        return self.images[-INKS:]

    def inks(self, sensor: int) -> InkImages:
        """Return one sensor's images, as the kernels take them."""
        shown = self.shown
        if shown is None:
            channels, lines, pixels = self.images.shape
            shown = np.ones((channels, -(-lines // STRETCH), -(-pixels // CELL)), bool)
        gain, dot = (shown[INKS * at : INKS * (at + 1)] for at in (sensor, self.sensors + sensor))
        return InkImages(
            gain=self.gain[sensor],
            dot=self.dot[sensor],
            texture=self.texture[sensor],
            cover=self.cover,
            shown=np.stack([gain, dot, shown[-INKS:]]),
        )

    def cleared(self) -> None:
        """Set to 0 what is not ``shown``."""
        if self.shown is not None:
            lines, pixels = self.images.shape[1:]
            for image, shown in zip(self.images, self.shown[: 2 * INKS * self.sensors], strict=False):
                blank = np.repeat(np.repeat(~shown, STRETCH, axis=0), CELL, axis=1)
                np.copyto(image, 0, where=blank[:lines, :pixels])

    def _of_inks(self, part: int) -> NDArray[np.float32]:
        size = self.sensors * INKS
        images = self.images[size * part : size * (part + 1)]
        return images.reshape(self.sensors, INKS, *images.shape[1:])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModeTables:
    """Tables over CMYK of each cause's effect on a sensor, sign reversed where it darkens; see ``Modes``."""

    gain: tuple[NDArray[np.float32], ...]
    """One table per ink, (33, 33, 33, 33)."""
    add: tuple[NDArray[np.float32], ...]
    dot: tuple[NDArray[np.float32], ...]
    texture: NDArray[np.float32]


def mode_tables(sensor: SensorModel) -> ModeTables:
    """Return the tables of every mode of one sensor; cached by its signal table, which sensors may share."""
    return _mode_tables(SameArray(sensor.mean_dn))


@lru_cache(maxsize=8)
def _mode_tables(mean_dn: SameArray) -> ModeTables:
    slopes = _on_nodes(mean_slopes(mean_dn.array))
    inks = [(np.maximum(-slopes[..., ink], 0), area) for ink, area in enumerate(_areas())]
    variance = sum(j**2 * (a * (1 - a)).clip(min=0) for j, a in inks)
    return ModeTables(
        gain=tuple(_table(j * a) for j, a in inks),
        add=tuple(_table(j * (1 - a).clip(min=0)) for j, a in inks),
        dot=tuple(_table(j * (4 * a * (1 - a)).clip(min=0)) for j, a in inks),
        texture=_table(np.asarray(variance)),
    )


@lru_cache(maxsize=1)
def area_tables() -> tuple[NDArray[np.float32], ...]:
    """Return tables of each ink's area alone, which do not depend on the sensor."""
    nodes = (NODES,) * INKS
    return tuple(_table(np.broadcast_to(COVER_SCALE * area, nodes)) for area in _areas())


def _areas() -> tuple[NDArray[np.float64], ...]:
    """Return the area of each ink at a table's nodes: (33, 1, 1, 1), (1, 33, 1, 1) and so on."""
    return tuple(np.meshgrid(*[node_fractions()] * INKS, indexing="ij", sparse=True))


def _table(values: NDArray[np.floating]) -> NDArray[np.float32]:
    return np.ascontiguousarray(values, np.float32)


def _on_nodes(slopes: NDArray[np.float32]) -> NDArray[np.float32]:
    """Interpolate slopes linearly to all nodes: (33, 33, 33, 33, 4)."""
    fine = slopes
    for ink in range(INKS):
        along = np.moveaxis(fine, ink, 0)
        wide = np.empty((EVERY * (SLOPE_NODES - 1) + 1, *along.shape[1:]), np.float32)
        wide[::EVERY] = along
        wide[1::EVERY] = (along[:-1] + along[1:]) / 2
        fine = np.moveaxis(wide, 0, ink)
    return fine


def prepare_modes(page: Page, *, sensors: Sequence[SensorModel], geometry: ScanGeometry) -> Modes:
    """Return the modes of a page in its nominal place, without ``Modes.add``.

    An ink that the page lacks costs nothing.
    """
    channels = len(sensors) * (2 * INKS + 1) + INKS
    images = np.empty((channels, geometry.lines(page.height_mm), geometry.pixels), np.float32)
    modes = Modes(images=images, sensors=len(sensors))
    used = int(np.bitwise_or.reduce(page.packed[::2, ::2], axis=None))
    present = [ink for ink in range(INKS) if (used >> (8 * ink)) & 255]
    for ink in set(range(INKS)) - set(present):
        for blank in (modes.gain[:, ink], modes.dot[:, ink], modes.cover[ink]):
            blank[...] = 0
    for index, sensor in enumerate(sensors):
        tables, see = mode_tables(sensor), partial(predict_light, page, sensor.footprint, geometry=geometry)
        for of_inks, out in (
            (tables.gain, modes.gain[index]),
            (tables.dot, modes.dot[index]),
        ):
            see([of_inks[ink] for ink in present], [out[ink] for ink in present], sign=-1)
        see([tables.texture], [modes.texture[index]])
    areas, cover = area_tables(), modes.cover
    shown = [areas[ink] for ink in present], [cover[ink] for ink in present]
    predict_light(page, sensors[0].footprint, *shown, geometry=geometry)
    cover /= np.float32(COVER_SCALE)
    return modes


class AddedInks:
    """``Modes.add`` of a page in its nominal place, computed on demand.

    Pages that pass the screening do not need it.
    """

    def __init__(
        self, page: Page, *, sensors: Sequence[SensorModel], geometry: ScanGeometry, bins: int
    ) -> None:
        """Store the page; sensors, geometry: of binned pixels; bins: pixels per bin and axis."""
        self.page, self.sensors, self.geometry, self.bins = page, sensors, geometry, bins

    @cached_property
    def images(self) -> NDArray[np.float32]:
        """(sensors x 4, lines, pixels) images, computed at the first access."""
        page, geometry = thinned(self.page, self.bins), self.geometry
        shape = len(self.sensors), INKS, geometry.lines(page.height_mm), geometry.pixels
        images = np.empty(shape, np.float32)
        for sensor, out in zip(self.sensors, images, strict=True):
            predict_light(
                page, sensor.footprint, mode_tables(sensor).add, list(out), geometry=geometry, sign=-1
            )
        return first_lines(images.reshape(-1, *shape[2:]), geometry.lines(self.page.height_mm))


def first_lines(images: NDArray[np.float32], lines: int) -> NDArray[np.float32]:
    """Return the page's lines of images (n, lines, pixels) of a thinned page.

    A thinned page may extend a line beyond the page itself, because its last squares of raster pixels need
    not be full.
    """
    return images if images.shape[1] == lines else np.ascontiguousarray(images[:, :lines])


def filled_cells(images: NDArray[np.generic]) -> NDArray[np.uint8]:
    """Return which cells of ``CELL`` pixels of ``CELL_LINES`` lines of images (n, lines, pixels) show anything."""
    channels, lines, pixels = images.shape
    filled = np.empty((channels, -(-lines // CELL_LINES), -(-pixels // CELL)), np.uint8)
    find_filled(images, filled)
    return filled


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class QuantisedImages:
    """Images, each of one sign, in levels of 16 bits: half the memory, and no further off than 1/130,000 of the
    greatest value of each.
    """

    levels: NDArray[np.uint16]
    """(channels, lines, pixels)"""
    units: NDArray[np.float32]
    """(channels,) value of one level; 0 where an image is blank."""
    filled: NDArray[np.uint8]
    """See ``filled_cells``."""

    @classmethod
    def of(cls, images: NDArray[np.float32]) -> Self:
        """Quantise images (channels, lines, pixels)."""
        levels, units = np.empty(images.shape, np.uint16), np.zeros(len(images), np.float32)
        for n, image in enumerate(images):
            low, high = float(image.min()), float(image.max())
            units[n] = (high if high > -low else low) / MOST_LEVELS
            if units[n]:
                quantise(image, np.float32(1 / units[n]), levels[n])
            else:
                levels[n] = 0
        return cls(levels=levels, units=units, filled=filled_cells(levels))

    @property
    def values(self) -> NDArray[np.float32]:
        """The images (channels, lines, pixels)."""
        return self.levels * self.units[:, None, None]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PixelMap:
    """Position on the page, in its nominal place, that each camera pixel sees under a placement.

    [camera pixels]

    Displacements are stored at nodes ``STRETCH`` pixels apart and are linear between them.
    """

    across: NDArray[np.float32]
    """(rows, columns) at nodes: distance to the right of a pixel at which it sees the page. [pixels]"""
    along: NDArray[np.float32]
    """Distance below the pixel."""
    inside: NDArray[np.bool_]
    """(lines, pixels) whether that position is on the page, ``margin`` pixels or more from its edge."""

    def slant(self) -> NDArray[np.float64]:
        """Return lines' displacement to the right of the middle line's, at mid-width: (lines,) [pixels]."""
        lines, pixels = self.inside.shape
        nodes = self.across[:, pixels // 2 // STRETCH]
        by_line = np.interp(np.arange(lines), np.arange(nodes.size) * STRETCH, nodes)
        return np.asarray(by_line - by_line[lines // 2])

    def of_first(self, lines: int) -> PixelMap:
        """Return the map of a scan of which only the first ``lines`` lines exist.

        The others count as off the page.
        """
        inside = self.inside.copy()
        inside[lines:] = False
        return replace(self, inside=inside)


def pixel_map(page: Page, geometry: ScanGeometry, placement: Placement, *, margin: float = 2.0) -> PixelMap:
    """Return the map of a page at ``placement``, exact at nodes and linear between them."""
    lines, pixels = geometry.lines(page.height_mm), geometry.pixels
    down = np.arange(0, lines + STRETCH, STRETCH)
    across = np.arange(0, pixels + STRETCH, STRETCH)
    x0, y0 = geometry.centres_x_mm(page.width_mm)[0], geometry.centres_y_mm(1)[0]
    x, y = np.meshgrid(x0 + across * geometry.pixel_pitch_mm, y0 + down * geometry.line_pitch_mm)
    seen_x, seen_y = placement.seen_mm(x, y, page_width_mm=page.width_mm, page_height_mm=page.height_mm)
    by_x = ((seen_x - x) / geometry.pixel_pitch_mm).astype(np.float32)
    by_y = ((seen_y - y) / geometry.line_pitch_mm).astype(np.float32)
    left, top = -x0 / geometry.pixel_pitch_mm, -y0 / geometry.line_pitch_mm
    right = left + page.width_mm / geometry.pixel_pitch_mm
    bottom = top + page.height_mm / geometry.line_pitch_mm
    inside = np.empty((lines, pixels), np.uint8)
    bounds = (left + margin, right - margin, top + margin, bottom - margin)
    within(by_x, by_y, *(np.float32(bound) for bound in bounds), inside)
    return PixelMap(across=by_x, along=by_y, inside=inside.view(np.bool_))


def moved(
    images: NDArray[np.float32] | QuantisedImages, seen: PixelMap, *, threads: int = 1
) -> NDArray[np.float32]:
    """Move images (channels, lines, pixels) to a placement, bilinearly; 0 outside the field."""
    return _moved(images, seen, 0, threads)[0]


def moved_modes(images: QuantisedImages, seen: PixelMap, sensors: int, *, threads: int = 1) -> Modes:
    """Return modes whose images are ``moved``; most of a page shows no ink, and is not written (``Modes.shown``)."""
    out, shown = _moved(images, seen, 2 * INKS * sensors, threads)
    return Modes(images=out, sensors=sensors, shown=shown)


def _moved(
    images: NDArray[np.float32] | QuantisedImages, seen: PixelMap, blank: int, threads: int
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return moved images, whose blank cells are set to 0 from image ``blank`` on, and ``Modes.shown`` of them."""
    taken: NDArray[np.generic]
    if isinstance(images, QuantisedImages):
        taken, units, filled = images.levels, images.units, images.filled
    else:
        taken, units, filled = images, np.ones(len(images), np.float32), filled_cells(images)
    out, which = unset(taken.shape), np.arange(len(taken))
    # Contiguous, as a single part is: the kernel is then compiled for one kind of array.
    parts = [np.ascontiguousarray(which[first::threads]) for first in range(threads)]
    of_parts = shared_out(
        [
            partial(move_smooth, taken, units, filled, part, seen.across, seen.along, blank, out)
            for part in parts
        ],
        threads=threads,
    )
    shown = np.empty((len(taken), *of_parts[0].shape[1:]), bool)
    for part, of_part in zip(parts, of_parts, strict=True):
        shown[part] = of_part
    return out, shown


PAGE_FEATURES: Final = 15
PAGE_FEATURE_LINES: Final = 3
"""Step between the lines of which page features are computed."""


def page_features(modes: Modes, inside: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return a page's features, from which its own scatter is predicted: (PAGE_FEATURES,) numbers.

    They are logarithms of each ink's mean area, of the printed share, of halftone texture, of edges of black,
    of edges of the other inks and of edges of two inks at once, whose register cannot be observed; each ink's
    share of solids; the share of the scan that is page; and the share of the page with more ink than two
    solids.
    """
    sums, pixels, every = page_feature_sums(modes.cover, modes.texture[0], inside, PAGE_FEATURE_LINES)
    ink, solid, printed, heavy, texture, of_black, of_others, of_two = np.split(
        sums, np.cumsum([4, 4, 1, 1, 1, 1, 1])
    )
    edges = np.concatenate([of_black, of_others, of_two]) / every
    return np.concatenate(
        [
            np.log(ink / pixels + 1e-4),
            solid / pixels,
            np.log(printed / pixels + 1e-3),
            [inside.mean()],
            np.log(texture / pixels + 1),
            np.log(edges + 1e-4),
            heavy / pixels,
        ]
    )

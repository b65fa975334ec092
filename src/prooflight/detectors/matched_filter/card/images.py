"""Images of one scan on a graphics card: the steps of ``analysis.ScanImages`` as bodies of ``kernels.gpu``.

A design's raster and images stay on the card from its first scan on. The scan and small arrays go up; block sums,
flat squares, sums of evidence and the images that marks and glyphs need come back. Small systems (the fit, the noise
factor, smoothing of displacements) are solved on the processor, with the functions of ``fit``.

On the processor remain registration, fringes, marks, glyphs and all statistics; the prediction of a page that is only
shifted, or of a sensor whose variance does not follow its light; and the full pass of a page that alarms.
"""

from __future__ import annotations

import math
import threading
import weakref
from collections.abc import Callable, Hashable
from functools import cache, partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INKS
from prooflight.detectors.matched_filter.analysis import UNRESOLVED, Engine, PlacedPage, sums_of
from prooflight.detectors.matched_filter.card.designs import DesignOnCard, Designs
from prooflight.detectors.matched_filter.fit.binning import bins_of
from prooflight.detectors.matched_filter.fit.modes import Modes
from prooflight.detectors.matched_filter.fit.nuisance import (
    BLOCK,
    MOST_BLOCKS,
    Fit,
    FitBlocks,
    PlacedScan,
    summed_blocks,
)
from prooflight.detectors.matched_filter.fit.residuals import (
    FLAT_SIGMAS,
    LOCAL_PIXELS,
    fitted_amounts,
    moves_of,
    noise_of,
    tile_shape,
)
from prooflight.detectors.matched_filter.fit.special_places import PLANE_SD
from prooflight.detectors.matched_filter.statistics.local_evidence import (
    EDGE_CLASSES,
    MODES,
    SEGMENTS,
    Sums,
    own_gains,
    segment_lines,
    sums_from,
    tile_side,
)
from prooflight.detectors.matched_filter.statistics.statistic import SCREEN_MODES
from prooflight.kernels.gpu import prediction, residuals, sums
from prooflight.kernels.prediction.aiming import phase_weights
from prooflight.kernels.prediction.lens_correction import FAR_BLOCK, FARTHER_BLOCK
from prooflight.kernels.residuals.fit import SHAPES, SUMS
from prooflight.prediction.predict import Prediction, raster_and_planes
from prooflight.prediction.sampling_grid import sampling_grid
from prooflight.prediction.tables import shot_slope

if TYPE_CHECKING:
    from prooflight.kernels.gpu.runners import Pool, Runner
    from prooflight.scans.placement import Placement

f32 = np.float32
GAIN_LINES: Final = 24
"""Lines of a part of a column whose gain one thread sums up."""
COLUMN_SUMS: Final = SUMS - SHAPES
"""Columns of ``block_lights`` and ``block_inks``: all sums of a block but the bells."""
HALF_OF_FOUR: Final = 2
"""Flat squares are 2 x 2 pixels."""
ROUNDS: Final = ("first", "second", "third")
"""Predictions of a scan, each at a better place."""


def engine_on(pool: Pool, designs: Designs | None = None) -> Engine:
    """Return the engine that analyses each scan on a runner of a pool; designs: where the pool's runners work."""
    on_card = designs or Designs()

    def images(page: PlacedPage) -> CardImages:
        runner = pool.take()
        return CardImages(page, on_card.on_card(page.design, runner), runner, pool.give)

    return images


@cache
def card_engine() -> Engine:
    """Return the engine of this process's card."""
    from prooflight.kernels.gpu.runners import Card, Pool

    return engine_on(Pool(Card))


class CardImages:
    """Images of a scan on a card; its runner is given back with the sums of a page that passes."""

    def __init__(
        self, page: PlacedPage, design: DesignOnCard, runner: Runner, give: Callable[[Runner], None]
    ) -> None:
        self._page, self._design, self._runner = page, design, runner
        weakref.finalize(self, give, runner)
        self._guard, self._screened = threading.Lock(), False
        self._rounds: tuple[str, ...] = ROUNDS
        self._whole: PlacedScan | None = None
        of, sensors = page.design, len(page.design.binned_sensors)
        self._shape, self._sensors = page.where.inside.shape, sensors
        self._gain_at = [INKS * s for s in range(sensors)]
        self._dot_at = [INKS * (sensors + s) for s in range(sensors)]
        self._texture_at = [2 * INKS * sensors + s for s in range(sensors)]
        self._cover_at = (2 * INKS + 1) * sensors
        self._unresolved_at = design.stack.shape[0] - 1
        inside, lost = page.where.inside, page.binned_lost()
        self._seen_by_all = inside if lost is None else np.asarray(inside & ~np.any(lost, axis=0)[:, None])
        self._fill("scan", page.scan)
        self._fill("right", page.where.across)
        self._fill("down", page.where.along)
        self._fill("inside all", self._seen_by_all)
        for s in range(sensors):
            self._fill(f"inside {s}", inside if lost is None else np.asarray(inside & ~lost[s, :, None]))
        self._predict(page.placement, self._rounds[0])
        self._runner.step(self._at("begin"), self._begin)
        self.hidden = self.unresolved = None
        stack, first = self._room("modes", design.stack.shape), len(of.images.units)
        if of.hidden is not None:
            self.hidden = np.stack([self._runner.back(stack[first + s]) for s in range(sensors)])
        if of.unresolved is not None:
            self.unresolved = self._runner.back(stack[self._unresolved_at]) > UNRESOLVED

    # --- memory

    def _room(self, name: str, shape: tuple[int, ...] | None = None, kind: Any = f32) -> Any:
        return self._runner.room(name, self._shape if shape is None else shape, kind)

    def _fill(self, name: str, array: NDArray[Any]) -> Any:
        room = self._room(name, array.shape, array.dtype)
        self._runner.fill(room, array)
        return room

    def _at(self, *step: Hashable) -> Hashable:
        """Return the key of a step: whatever of its arrays and numbers may differ from scan to scan."""
        return self._design.number, self._page.scan.shape, self._shape, self._page.residual_variance, *step

    def _of(self, name: str, sensor: int) -> Any:
        return self._room(f"{name} {sensor}")

    # --- prediction

    def _predict(self, placement: Placement, again: str) -> None:
        """Predict all sensors at a placement, into rooms named by ``again``."""
        page, of = self._page, self._page.design
        raster, planes = raster_and_planes(page.printed, placement)
        grid = sampling_grid(raster, of.binned_geometry, placement, along_first=True)
        if (
            placement.is_shift
            or raster is not of.page
            or any(shot_slope(sensor) <= 0 for sensor in of.binned_sensors)
        ):
            seen = page.predict(placement)
            for s in range(self._sensors):
                self._fill(f"mean {again} {s}", seen.expected_dn[s])
                self._fill(f"variance {again} {s}", seen.variance_dn2[s])
            return
        where = np.zeros((5, 2), np.int32)
        where[:4], where[4] = planes, planes.any()
        self._fill("planes", where)
        for s, sensor in enumerate(of.binned_sensors):
            passes = []
            for name, one in zip(
                ("across", "along"), grid.passes(sensor.footprint, raster.pixel_mm), strict=True
            ):
                nodes = self._fill(f"{name} nodes {s}", one.places)
                reach = (one.cumulative.size - 1) / (2 * one.step)
                passes.append(
                    (name, nodes, one.pitch, one.segment, reach, self._weights(one, grid.phase_bits))
                )
            key = self._at(
                "predict", again, s, grid.phase_bits, *((one[1].shape, *one[2:5]) for one in passes)
            )
            self._runner.step(key, partial(self._filter, s, passes, grid.phase_bits, again))

    def _weights(self, one: Any, bits: int) -> Any:
        taps = math.ceil((one.cumulative.size - 1) / one.step) + 1
        key = id(one.cumulative), one.step, bits
        if key not in self._design.weights:
            table = phase_weights(one.cumulative, one.step, 1 << bits, taps)
            self._design.weights[key] = self._runner.put(table), one.cumulative
        return self._design.weights[key][0]

    def _filter(self, s: int, passes: list[tuple[Any, ...]], bits: int, again: str) -> None:
        run, on_card, (lines, pixels) = self._runner.run, self._design.sensors[s], self._shape
        rows, columns = self._design.packed.shape
        aims = []
        for (name, nodes, pitch, segment, reach, table), extent in zip(
            passes, (pixels, columns), strict=True
        ):
            shape = lines, -(-extent // segment)
            base = self._room(f"{name} base", shape, np.int32)
            at, advance = self._room(f"{name} at", shape), self._room(f"{name} advance", shape)
            run(prediction.aim, shape, nodes, pitch, segment, reach, bits, base, at, advance)
            aims.append((base, at, advance, segment, bits, table))
        light, summed = self._room("raster light", (rows, columns)), self._room("rows", (lines, columns))
        run(
            prediction.lookup,
            (rows, columns),
            self._design.packed,
            self._room("planes", (5, 2), np.int32),
            *on_card.recipe,
            light,
        )
        run(prediction.along, (lines, columns), light, *aims[1], summed)
        out = self._room("uncorrected")
        run(prediction.across, (lines, pixels), summed, *aims[0], out)
        small, large = ((-(-lines // side), -(-pixels // side)) for side in (FAR_BLOCK, FARTHER_BLOCK))
        blocks, larger = self._room("blocks", small), self._room("larger blocks", large)
        run(prediction.block_means, small, out, FAR_BLOCK, blocks)
        run(prediction.block_means, large, blocks, FARTHER_BLOCK // FAR_BLOCK, larger)
        far, farther, total = (
            self._room("far", small),
            self._room("farther", large),
            self._room("far light", small),
        )
        run(prediction.convolved, small, blocks, on_card.far, far)
        run(prediction.convolved, large, larger, on_card.farther, farther)
        run(prediction.far_total, small, far, farther, total)
        run(
            prediction.to_levels,
            (lines, pixels),
            out,
            on_card.near,
            total,
            *on_card.levels,
            self._of(f"mean {again}", s),
            self._of(f"variance {again}", s),
        )

    # --- the fit

    def _begin(self) -> None:
        """Bin the scan, move the design's images to the page's place, and make its light."""
        run, of, on_card = self._runner.run, self._page.design, self._design
        scan = self._room("scan", self._page.scan.shape, self._page.scan.dtype)
        modes, nodes = self._room("modes", on_card.stack.shape), self._page.where.across.shape
        run(
            residuals.moved,
            self._shape,
            on_card.stack,
            self._room("right", nodes),
            self._room("down", nodes),
            modes,
        )
        contrast = self._page.residual_variance.contrast
        for s in range(self._sensors):
            run(
                residuals.binned,
                self._shape,
                scan[s],
                bins_of(of.landmarks.geometry),
                self._of("measured", s),
            )
            if of.hidden is not None and contrast > 0:
                share, hidden_at = f32(PLANE_SD**2 / contrast), len(of.images.units) + s
                run(residuals.with_hidden, self._shape, modes, hidden_at, share, self._texture_at[s])
            run(
                residuals.lights,
                self._shape,
                self._of("mean first", s),
                on_card.sensors[s].offset,
                self._of("light", s),
            )

    def fitted(self, planes: NDArray[np.float64]) -> Fit:
        """See ``ScanImages``."""
        of, blocks = self._page.design, FitBlocks.of(self._seen_by_all)
        corners = np.full(
            (MOST_BLOCKS, 2), max(self._shape), np.int32
        )  # those beyond the page sum up to nothing
        block_corners = blocks.corners
        corners[: len(block_corners)] = block_corners
        self._fill("corners", corners)
        self._runner.step(self._at("blocks"), self._sum_blocks)
        totals = [
            self._runner.back(self._room(f"block sums {s}", (MOST_BLOCKS, SUMS)))[: len(block_corners)]
            for s in range(self._sensors)
        ]
        return of.nuisance_model(blocks, np.stack(totals), planes, self._page.residual_variance).fit()

    def _sum_blocks(self) -> None:
        run = self._runner.run
        modes = self._room("modes", self._design.stack.shape)
        corners = self._room("corners", (MOST_BLOCKS, 2), np.int32)
        inside = self._room("inside all", kind=np.bool_)
        rows = self._room("block columns", (MOST_BLOCKS, BLOCK, COLUMN_SUMS))
        for s in range(self._sensors):
            out, cover_at = self._room(f"block sums {s}", (MOST_BLOCKS, SUMS)), self._cover_at
            mean, light, variance = (self._of(name, s) for name in ("mean first", "light", "variance first"))
            run(
                residuals.block_lights,
                (MOST_BLOCKS, BLOCK),
                self._of("measured", s),
                mean,
                light,
                variance,
                modes,
                self._texture_at[s],
                inside,
                corners,
                BLOCK,
                rows,
            )
            ink_images = modes, self._gain_at[s], self._dot_at[s], cover_at
            run(residuals.block_inks, (MOST_BLOCKS, 4 * BLOCK), *ink_images, inside, corners, BLOCK, rows)
            run(residuals.block_totals, (MOST_BLOCKS, COLUMN_SUMS), rows, out)
            bells = light, modes, cover_at, inside, self._design.bells, corners, BLOCK
            run(residuals.block_bells, (MOST_BLOCKS, SHAPES), *bells, out)

    # --- residuals

    def take_fit(self, fit: Fit) -> NDArray[np.float64]:
        """See ``ScanImages``."""
        page, pixels = self._page, self._shape[1]
        for s, amounts in enumerate(fitted_amounts(fit, page.design.colours, pixels)):
            for name, array in amounts._asdict().items():
                self._fill(f"fitted {name} {s}", array)
        self._runner.step(self._at("residuals"), self._subtract)
        noise = np.ones(self._sensors)
        for s in range(self._sensors):
            flat = self._runner.back(self._room(f"flat {s}", self._flat_shape))
            square, ratio = flat.reshape(2, -1)
            there = square >= 0
            noise[s] = noise_of(np.stack([square[there], ratio[there]]), page.residual_variance)
        self._fill("noise", noise.astype(f32))
        self._runner.step(self._at("weights"), self._compute_weights)
        return noise

    @property
    def _flat_shape(self) -> tuple[int, int, int]:
        return 2, self._shape[0] // HALF_OF_FOUR, self._shape[1] // HALF_OF_FOUR

    def _subtract(self) -> None:
        run, pixels = self._runner.run, self._shape[1]
        modes = self._room("modes", self._design.stack.shape)
        shapes = {"shape": (SHAPES,), "columns": (pixels,), "gain": (4, 3), "dot": (4,), "planes": (4, 2)}
        for s in range(self._sensors):
            inside, light, left = (
                self._room(f"inside {s}", kind=np.bool_),
                self._of("light", s),
                self._of("left", s),
            )
            fitted = [self._room(f"fitted {name} {s}", shape) for name, shape in shapes.items()]
            run(
                residuals.residual,
                self._shape,
                self._of("measured", s),
                self._of("mean first", s),
                light,
                inside,
                modes,
                self._gain_at[s],
                self._dot_at[s],
                self._cover_at,
                self._design.bells,
                *fitted,
                left,
            )
            run(
                residuals.flat_square,
                self._flat_shape[1:],
                left,
                self._of("variance first", s),
                light,
                modes,
                self._texture_at[s],
                inside,
                f32(FLAT_SIGMAS**2),
                self._room(f"flat {s}", self._flat_shape),
            )

    def _compute_weights(self) -> None:
        of = self._page.residual_variance
        shares = [f32(one) for one in (of.edge, of.contrast, of.share, of.dark)]
        for s, sensor in enumerate(self._page.design.binned_sensors):
            self._runner.run(
                residuals.weighted,
                self._shape,
                self._of("light", s),
                self._of("variance first", s),
                self._room("modes", self._design.stack.shape),
                self._texture_at[s],
                self._room(f"inside {s}", kind=np.bool_),
                self._room("noise", (self._sensors,)),
                s,
                *shares,
                f32(sensor.white_dn),
                self._of("weight", s),
                self._of("of edges", s),
            )

    def leave_out(self, faulty: NDArray[np.bool_]) -> None:
        """See ``ScanImages``."""
        for s in range(self._sensors):
            columns = self._fill(f"faulty {s}", faulty[s])
            self._runner.run(
                residuals.left_out, self._shape, columns, self._of("left", s), self._of("weight", s)
            )

    # --- displacements

    def local_moves(self) -> NDArray[np.float32]:
        """See ``ScanImages``."""
        self._runner.step(self._at("slopes"), self._sum_slopes)
        return moves_of(self._runner.back(self._room("slope sums", (5, *tile_shape(*self._shape)))))

    def _sum_slopes(self) -> None:
        run, (rows, columns), pixels = self._runner.run, tile_shape(*self._shape), self._shape[1]
        part, out = (
            self._room("slope columns", (5, rows, pixels)),
            self._room("slope sums", (5, rows, columns)),
        )
        for s in range(self._sensors):
            images = self._of("left", s), self._of("weight", s), self._of("light", s)
            run(residuals.slope_columns, (rows, pixels), *images, LOCAL_PIXELS, part)
            run(residuals.slope_tiles, (5 * rows, columns), part, LOCAL_PIXELS, int(s > 0), out)

    def predict_again(self, placement: Placement) -> None:
        """See ``ScanImages``."""
        before, after = self._rounds[:2]
        self._rounds = self._rounds[1:]
        self._predict(placement, after)
        self._runner.step(self._at("anew", after), lambda: self._change(before, after))

    def _change(self, before: str, after: str) -> None:
        for s in range(self._sensors):
            images = self._of("left", s), self._of("weight", s)
            change = self._of(f"mean {before}", s), self._of(f"mean {after}", s)
            self._runner.run(residuals.predicted_again, self._shape, *images, *change)

    def take_moves(self, moves: NDArray[np.float32]) -> None:
        """See ``ScanImages``."""
        room = self._fill("moves", np.asarray(moves, f32))
        for s in range(self._sensors):
            images = self._of("left", s), self._of("weight", s), self._of("light", s)
            self._runner.run(residuals.taken_moves, self._shape, *images, room)

    def residuals(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """See ``ScanImages``."""
        light, left, weight = (self._back(name) for name in ("light", "left", "weight"))
        self._cached_light = light, left, weight
        return self._cached_light

    def _back(self, name: str) -> NDArray[np.float32]:
        return np.stack([self._runner.back(self._of(name, s)) for s in range(self._sensors)])

    # --- sums

    def summed(self, modes: tuple[str, ...]) -> Sums:
        """See ``ScanImages``: those of the screening pass on the card, once, and others on the processor."""
        if modes == SCREEN_MODES and not self._screened:
            return self._screen()
        return sums_of(self._page, self.placed(), *self._cached_light, self._edges, self.unresolved, modes)

    def block_sums(self) -> tuple[FitBlocks, NDArray[np.float32]]:
        """See ``ScanImages``; summed again, as the card's sums differ from the processor's by rounding."""
        placed = self.placed()
        blocks = FitBlocks.of(placed.seen_by_all())
        return blocks, summed_blocks(placed, blocks, self._page.threads)

    def placed(self) -> PlacedScan:
        """See ``ScanImages``."""
        with self._guard:
            return self._on_host()

    def _screen(self) -> Sums:
        """Sum up on the card; its residuals and weight are changed on the way."""
        page = self._page
        of, (lines, pixels) = page.design, self._shape
        side, which = (
            tile_side(of.binned_geometry),
            np.array([MODES.index(name) for name in SCREEN_MODES], np.int64),
        )
        self._fill("which", which)
        self._fill("line shift", -np.rint(page.where.slant()).astype(np.int64))
        self._fill("most edges", np.array(EDGE_CLASSES, f32))
        self._runner.step(self._at("columns"), self._sum_columns)
        gains = own_gains(self._runner.back(self._room("gains", (self._sensors, pixels))), of.binned_geometry)
        for s in range(self._sensors):
            self._fill(f"own gains {s}", gains[s])
        tiles = self._room("tiles", (4, which.size + 1, lines // side, pixels // side))
        cover = self._room("cover", (4, lines // side, pixels // side))
        self._runner.step(self._at("tiles"), lambda: self._sum_tiles(side, tiles, cover))
        columns = self._runner.back(self._room("line sums", self._columns_shape))
        self._screened = True
        return sums_from(
            self._runner.back(tiles),
            columns,
            self._runner.back(cover),
            gains,
            geometry=of.binned_geometry,
            page_width_mm=of.page.width_mm,
            prior=of.prior,
            modes=SCREEN_MODES,
        )

    @property
    def _columns_shape(self) -> tuple[int, ...]:
        return len(EDGE_CLASSES), 4, len(SCREEN_MODES), SEGMENTS, self._shape[1]

    def _sum_columns(self) -> None:
        run, (lines, pixels) = self._runner.run, self._shape
        unresolved = self._page.design.unresolved is not None
        modes, on_card = (
            self._room("modes", self._design.stack.shape),
            f32(1 / self._page.design.prior.column**2),
        )
        out, count_parts = self._room("line sums", self._columns_shape), -(-lines // GAIN_LINES)
        parts = self._room("gain parts", (self._sensors, 2, count_parts, pixels))
        which, shift = (
            self._room("which", (len(SCREEN_MODES),), np.int64),
            self._room("line shift", (lines,), np.int64),
        )
        most = self._room("most edges", (len(EDGE_CLASSES),))
        rows = len(EDGE_CLASSES) * len(SCREEN_MODES) * SEGMENTS
        for s in range(self._sensors):
            left, weight, light, of_edges = self._evidence(s)
            if unresolved:
                run(residuals.resolved, self._shape, modes, self._unresolved_at, f32(UNRESOLVED), weight)
            run(
                sums.line_sums,
                (rows, pixels),
                left,
                weight,
                light,
                of_edges,
                self._design.sensors[s].white,
                which,
                shift,
                most,
                segment_lines(lines),
                int(s > 0),
                out,
            )
            run(sums.gain_parts, (count_parts, pixels), left, weight, light, GAIN_LINES, parts[s])
        run(
            sums.column_gains,
            (self._sensors, pixels),
            parts,
            on_card,
            self._room("gains", (self._sensors, pixels)),
        )

    def _sum_tiles(self, side: int, tiles: Any, cover: Any) -> None:
        run, pixels = self._runner.run, self._shape[1]
        which = self._room("which", (len(SCREEN_MODES),), np.int64)
        for s in range(self._sensors):
            left, weight, light, of_edges = self._evidence(s)
            run(sums.taken_gains, self._shape, left, weight, light, self._room(f"own gains {s}", (pixels,)))
            white = self._design.sensors[s].white
            images = left, weight, light, of_edges, white, which
            run(sums.tile_sums, tiles.shape[2:], *images, side, int(s > 0), tiles)
        modes = self._room("modes", self._design.stack.shape)
        run(sums.tile_cover, (4 * cover.shape[1], cover.shape[2]), modes, self._cover_at, side, cover)

    def _evidence(self, s: int) -> tuple[Any, Any, Any, Any]:
        return self._of("left", s), self._of("weight", s), self._of("light", s), self._of("of edges", s)

    def _on_host(self) -> PlacedScan:
        """Return the scan with all its images brought back, which the full pass needs."""
        if self._whole is None:
            page, of = self._page, self._page.design
            channels = len(of.images.units)
            stack = self._room("modes", self._design.stack.shape)
            images = np.stack([self._runner.back(stack[n]) for n in range(channels)])
            self._edges = self._back("of edges")
            self._whole = PlacedScan(
                measured_dn=self._back("measured"),
                seen=Prediction(
                    expected_dn=self._back("mean first"), variance_dn2=self._back("variance first")
                ),
                modes=Modes(images=images, sensors=self._sensors),
                where=page.where,
                sensors=of.binned_sensors,
                colours=of.colours,
                lost=page.binned_lost(),
            )
        return self._whole

"""Designs on a graphics card: the tables of their sensors, their raster and images, from their first scan on."""

from __future__ import annotations

import threading
import weakref
from dataclasses import dataclass, replace
from itertools import count
from typing import TYPE_CHECKING, Any

import numpy as np

from prooflight.kernels.prediction.lens_correction import NEAR_REACH
from prooflight.prediction.predict import levels_of
from prooflight.prediction.quantised_table import quantised_table

if TYPE_CHECKING:
    from prooflight.detectors.matched_filter.design import PreparedPage
    from prooflight.kernels.gpu.runners import Runner
    from prooflight.prediction.tables import SensorModel

f32 = np.float32
_numbers = count()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SensorOnCard:
    """Tables of a sensor where bodies run."""

    recipe: tuple[Any, ...]
    """What ``lookup`` takes after the planes, but for its light."""
    near: Any
    far: Any
    farther: Any
    levels: tuple[Any, ...]
    """What ``to_levels`` takes after the far light, but for its images."""
    offset: Any
    white: Any
    """(pixels,) light of bare paper."""

    @classmethod
    def of(cls, sensor: SensorModel, runner: Runner) -> SensorOnCard:
        """Put a sensor's tables where bodies run."""
        table, levels, near = quantised_table(sensor.mean_dn), levels_of(sensor), sensor.correction.near
        offset, gain = (runner.put(one) for one in (levels.column_offset, levels.column_gain))
        return cls(
            recipe=(
                runner.put(table.codes.view(np.int64)),
                *(int(one) for one in table.bits),
                f32(table.unit),
                f32(levels.backing + table.offset),
            ),
            near=runner.put(near[NEAR_REACH:, NEAR_REACH:]),
            far=runner.put(sensor.correction.far),
            farther=runner.put(sensor.correction.farther),
            levels=(offset, gain, *(f32(one) for one in levels[2:])),
            offset=offset,
            white=runner.put((sensor.white_dn * sensor.column_gain).astype(f32)),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DesignOnCard:
    """A design where bodies run."""

    number: int
    """Number of no other design, by which steps are recorded."""
    packed: Any
    stack: Any
    """(channels, lines, pixels): ``Modes.images``, then hidden edges, then unresolved places, where there are any."""
    bells: Any
    seen_by: tuple[SensorModel, ...]
    sensors: tuple[SensorOnCard, ...]
    weights: dict[tuple[Any, ...], Any]
    """``phase_weights`` by footprint."""

    @classmethod
    def of(cls, design: PreparedPage, runner: Runner) -> DesignOnCard:
        """Put a design where bodies run."""
        parts = [design.images.values]
        parts += [] if design.hidden is None else [design.hidden]
        parts += [] if design.unresolved is None else [design.unresolved[None]]
        return cls(
            number=next(_numbers),
            packed=runner.put(design.page.packed),
            stack=runner.put(np.concatenate(parts)),
            bells=runner.put(design.colours.bells()),
            seen_by=design.binned_sensors,
            sensors=tuple(SensorOnCard.of(sensor, runner) for sensor in design.binned_sensors),
            weights={},
        )

    def under(self, sensors: tuple[SensorModel, ...], runner: Runner) -> DesignOnCard:
        """Return the same design for other sensors; its own images stay."""
        on_card = tuple(SensorOnCard.of(sensor, runner) for sensor in sensors)
        return replace(self, number=next(_numbers), seen_by=sensors, sensors=on_card)


class Designs:
    """Designs where bodies run, for as long as their images are in this machine's memory."""

    def __init__(self) -> None:
        self._on_card: dict[int, DesignOnCard] = {}
        self._guard = threading.Lock()

    def on_card(self, design: PreparedPage, runner: Runner) -> DesignOnCard:
        """Return a design where bodies run; put there if it is not, or seen by other sensors if its light changed."""
        key = id(design.images.levels)
        with self._guard:
            on_card = self._on_card.get(key)
            if on_card is None:
                on_card = DesignOnCard.of(design, runner)
                weakref.finalize(design.images.levels, self._on_card.pop, key, None)
            elif on_card.seen_by is not design.binned_sensors:
                on_card = on_card.under(design.binned_sensors, runner)
            self._on_card[key] = on_card
            return on_card

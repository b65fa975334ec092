"""What the steps of a set-up share: the camera's lines, the press file, what was found, and what a step found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from prooflight.commissioning.camera.exposures import Exposure

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from prooflight.camera.camera import Camera
    from prooflight.commissioning.camera.fixed_pattern import Measured
    from prooflight.commissioning.line_camera.file_edit import Edit
    from prooflight.commissioning.line_camera.tap import CameraTap
    from prooflight.commissioning.ruler.reading import SensorReading
    from prooflight.press.press_file import PressFile


@dataclass(frozen=True, slots=True, kw_only=True)
class StepResult:
    """What a step found."""

    good: bool
    says: tuple[str, ...]
    """For a person, a line each."""
    edits: tuple[Edit, ...] = ()
    values: dict[str, Measured] = field(default_factory=dict)
    """By name, with the unit in it."""
    unmeasured: tuple[str, ...] = ()
    """What could not be measured, and why."""


@dataclass(slots=True, kw_only=True)
class Bench:
    """What the steps share."""

    tap: CameraTap
    press: PressFile
    """As it stands now."""
    begun: bool
    """Whether the press file was begun for this camera, and states nothing about it yet."""
    described: bool
    """Whether it by now says what a data sheet does."""
    ask: Callable[[str, str, str], str]
    """A question by its key, its words, and what Enter says."""
    dark: dict[float, tuple[Exposure, ...]] = field(default_factory=dict)
    """By exposure time [us], 0 where the camera has none: one statistic a sensor."""
    readings: tuple[SensorReading, ...] = ()
    """Of the last ruler page."""
    columns: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = field(default_factory=list)
    """Of each sensor: offset without light [DN], and signal over the mean of all columns [-]; both (pixels,)."""
    passes: list[float] = field(default_factory=list)
    """Line pitch of each ruler page so far. [mm]"""

    @property
    def where(self) -> str:
        """The camera, in errors."""
        return self.tap.name

    @property
    def top_code_dn(self) -> int:
        """Of the converter, where 16 bits hold fewer. [DN]"""
        return 2 ** self.camera().sensors[0].bits - 1 if self.tap.form.bits == 16 else self.tap.top_code_dn

    def camera(self) -> Camera:
        """The press file's."""
        return self.press.camera()

    def sensor_name(self, at: int) -> str:
        """Of the at-th sensor, before what is said of it; empty: there is but one."""
        return "" if self.tap.sensors == 1 else f"sensor {at + 1}: "

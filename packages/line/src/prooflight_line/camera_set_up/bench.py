"""Result of a set-up's step, and the state that the steps share: camera, press file and measurements."""

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
    from prooflight.commissioning.file_edit import Edit
    from prooflight.press.press_file import PressFile
    from prooflight_line.camera_set_up.line_reader import CameraLineReader
    from prooflight_line.ruler.reading import SensorReading


@dataclass(frozen=True, slots=True, kw_only=True)
class StepResult:
    """Result of a step."""

    good: bool
    remarks: tuple[str, ...]
    """Text for a person, one line each."""
    edits: tuple[Edit, ...] = ()
    values: dict[str, Measured] = field(default_factory=dict)
    """Measured values by name, with the unit in it."""
    unmeasured: tuple[str, ...] = ()
    """Values that could not be measured, and why."""


@dataclass(slots=True, kw_only=True)
class Bench:
    """State that the steps share."""

    line_reader: CameraLineReader
    press: PressFile
    """Press file as it stands now."""
    begun: bool
    """Whether the press file was begun for this camera, and states nothing about it yet."""
    described: bool
    """Whether it holds the values of a data sheet by now."""
    ask: Callable[[str, str, str], str]
    """Function that asks a question, by its key, its text, and the answer that Enter gives."""
    dark: dict[float, tuple[Exposure, ...]] = field(default_factory=dict)
    """Dark exposures by exposure time [us], 0 where the camera has none: one statistic a sensor."""
    readings: tuple[SensorReading, ...] = ()
    """Readings of the last ruler page."""
    columns: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = field(default_factory=list)
    """Columns of each sensor: offset without light [DN], and signal over the mean of all columns [-].

    Both arrays are (pixels,).
    """
    passes: list[float] = field(default_factory=list)
    """Line pitch of each ruler page so far. [mm]"""

    @property
    def where(self) -> str:
        """Return the camera's name, for errors."""
        return self.line_reader.name

    @property
    def top_code_dn(self) -> int:
        """Return the top code of the converter, where 16 bits hold fewer. [DN]"""
        return (
            2 ** self.camera().sensors[0].bits - 1
            if self.line_reader.form.bits == 16
            else self.line_reader.top_code_dn
        )

    def camera(self) -> Camera:
        """Return the press file's camera."""
        return self.press.camera()

    def sensor_name(self, at: int) -> str:
        """Return the prefix of lines about the sensor at index ``at``; empty: there is but one."""
        return "" if self.line_reader.sensors == 1 else f"sensor {at + 1}: "

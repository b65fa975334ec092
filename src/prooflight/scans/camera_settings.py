"""Settings of a line camera as a press file states them; the camera's own features are set by these."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

from prooflight.scans.alignment import SensorOffset

Value = str | int | float | bool

NAMES: Final[Mapping[str, tuple[str, ...]]] = {
    "pixel_format": ("PixelFormat",),
    "block_lines": ("Height",),
    "line_rate_hz": ("AcquisitionLineRate", "AcquisitionLineRateAbs", "LineRate"),
    "exposure_us": ("ExposureTime", "ExposureTimeAbs"),
    "trigger_selector": ("TriggerSelector",),
    "trigger_mode": ("TriggerMode",),
    "trigger_source": ("TriggerSource",),
    "position": ("EncoderValue", "ShaftEncoderModuleCounter", "RotaryEncoderCounterValue"),
}
"""Names of features, the standard's first, then those of makers: Basler's up to GigE ace and runner end in
``Abs``. position: of the encoder, which distinguishes a stopped press from a camera that has hung."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSettings:
    """Section ``[camera]`` of a press file; None leaves the camera's own value."""

    id: str | None = None
    """Name of the camera: ID, serial number or address."""
    pixel_format: str | None = None
    block_lines: int | None = None
    line_rate_hz: float | None = None
    exposure_us: float | None = None
    trigger: Literal["free", "encoder"] | None = None
    """Trigger of a line: only time, or the encoder."""
    trigger_source: str | None = None
    """Trigger source of an encoder, by the camera's name; None: the first of ``ENCODERS`` that it has."""
    encoder_steps: int | None = None
    """Steps of the encoder from line to line; where blocks have its count, requested lines can be derived
    from it."""
    chunks: bool | None = None
    """Whether the camera sends those of ``CHUNKS`` that it has with every block."""
    offset_lines: tuple[float, ...] = ()
    """Offset of each of its sensors: number of lines by which it sees a place of the page later than the
    press's count."""
    offset_pixels: tuple[float, ...] = ()
    """Offset of each of its sensors: number of pixels by which it sees a place of the page further right."""
    features: Mapping[str, Value] = field(default_factory=dict)
    """Other features, by the camera's own names, set before all these and in this order."""
    names: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    """Names of the keys of ``NAMES``, by model."""

    def offsets(self, sensors: int | None = None) -> tuple[SensorOffset, ...]:
        """Return the offsets of the sensors as stated; if none are, zeros for so many sensors, or for one."""
        count = max(len(self.offset_lines), len(self.offset_pixels)) or sensors or 1
        lines, pixels = self.offset_lines or (0.0,) * count, self.offset_pixels or (0.0,) * count
        return tuple(
            SensorOffset(lines=along, pixels=across) for along, across in zip(lines, pixels, strict=False)
        )

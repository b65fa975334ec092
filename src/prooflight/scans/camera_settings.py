"""Settings of a line camera as a press file states them; the camera's own features are set by these."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Final, Literal

from pydantic import Field

from prooflight.files.fields import NO_OTHER_FIELDS, Count, Flag, Positive, ShortText
from prooflight.scans.alignment import SensorOffset

Value = bool | int | float | str
Offset = Annotated[float, Field(strict=True, ge=-100_000, le=100_000)]
"""Offset of a sensor's lines or pixels.

The limit is 10 m between sensors on the page at the prototype's pitch.
"""
Offsets = Annotated[tuple[Offset, ...], Field(max_length=16)]

NAMES: Final[dict[str, tuple[str, ...]]] = {
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
    """Section ``[camera]`` of a press file, or one of ``[[camera]]``; None leaves the camera's own value."""

    __pydantic_config__: ClassVar = NO_OTHER_FIELDS

    id: ShortText | None = None
    """Name of the camera: ID, serial number or address."""
    pixel_format: ShortText | None = None
    block_lines: Count | None = None
    line_rate_hz: Positive | None = None
    exposure_us: Positive | None = None
    trigger: Literal["free", "encoder"] | None = None
    """Trigger of a line: only time, or the encoder."""
    trigger_source: ShortText | None = None
    """Trigger source of an encoder, by the camera's name; None: the first of ``ENCODERS`` that it has."""
    encoder_steps: Count | None = None
    """Steps of the encoder from line to line; where blocks have its count, requested lines can be derived
    from it."""
    chunks: Flag | None = None
    """Whether the camera sends those of ``CHUNKS`` that it has with every block."""
    offset_lines: Offsets = ()
    """Offset of each of its sensors: number of lines by which it sees a place of the page later than the
    press's count."""
    offset_pixels: Offsets = ()
    """Offset of each of its sensors: number of pixels by which it sees a place of the page further right."""
    features: Annotated[dict[ShortText, Value], Field(max_length=1000)] = field(default_factory=dict)
    """Other features, by the camera's own names, set before all these and in this order."""
    names: Annotated[dict[ShortText, dict[ShortText, ShortText]], Field(max_length=100)] = field(
        default_factory=dict
    )
    """Names of the keys of ``NAMES``, by model."""

    def offsets(self, sensors: int | None = None) -> tuple[SensorOffset, ...]:
        """Return the offsets of the sensors as stated; if none are, zeros for so many sensors, or for one."""
        count = max(len(self.offset_lines), len(self.offset_pixels)) or sensors or 1
        lines, pixels = self.offset_lines or (0.0,) * count, self.offset_pixels or (0.0,) * count
        return tuple(
            SensorOffset(lines=along, pixels=across) for along, across in zip(lines, pixels, strict=False)
        )

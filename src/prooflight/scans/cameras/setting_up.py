"""What a user asks of a camera -> its own features by its own names, each checked before any is set.

The standard (EMVA SFNC 2.7) has one name for each thing, older cameras have their maker's: ``NAMES`` lists those that
are known, and a press file adds others by model.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Literal

from prooflight.errors import RequestError, ScanError
from prooflight.scans.alignment import SensorOffset

if TYPE_CHECKING:
    from prooflight.scans.cameras.camera import Camera, Feature

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
"""The standard's name first, then those of makers: Basler's up to GigE ace and runner end in ``Abs``. position: how far
the encoder has gone, which tells a press that stands from a camera that has hung."""
CHUNKS: Final[Mapping[str, tuple[str, ...]]] = {
    "triggers": ("ChunkLineTriggerCount", "ChunkTriggerinputcounter", "ChunkLineTriggerEndToEndCounter"),
    "encoder": ("ChunkEncoderValue", "ChunkShaftEncoderCounter"),
    "frame": ("ChunkFrameID", "ChunkFramecounter"),
    "timestamp": ("ChunkTimestamp",),
}
"""What cameras send with a block: line triggers and encoder steps that they have seen, its number, its time."""
LINE_TRIGGERS: Final = ("LineStart", "LineTrigger")
"""Entries of ``TriggerSelector`` that start a line."""
ENCODERS: Final = (
    "Encoder0",
    "Encoder1",
    "RotaryEncoder",
    "RotaryEncoder1",
    "ShaftEncoderModuleOut",
    "Encoder",
)
"""Entries of ``TriggerSource`` that are an encoder's."""
LOOK: Final = "look at `prooflight camera features`"
MOST_SHOWN: Final = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSettings:
    """``[camera]`` of a press file; None: as the camera stands."""

    id: str | None = None
    """By which it is found: ID, serial number or address."""
    pixel_format: str | None = None
    block_lines: int | None = None
    line_rate_hz: float | None = None
    exposure_us: float | None = None
    trigger: Literal["free", "encoder"] | None = None
    """What starts a line: nothing but time, or the encoder."""
    trigger_source: str | None = None
    """Of an encoder, by the camera's name; None: the first of ``ENCODERS`` that it has."""
    encoder_steps: int | None = None
    """Of the encoder from line to line; where blocks tell its count, lines that it asked for can be told by it."""
    chunks: bool | None = None
    """Whether it is to send what it has of ``CHUNKS`` with every block."""
    offset_lines: tuple[float, ...] = ()
    """Of each of its sensors: how many lines later than in the press's count it sees a place of the page."""
    offset_pixels: tuple[float, ...] = ()
    """Of each of its sensors: how many pixels further right it sees a place of the page."""
    features: Mapping[str, Value] = field(default_factory=dict)
    """Others, by the camera's own names, set before all these and in this order."""
    names: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    """By model: what the words of ``NAMES`` are called there."""

    def offsets(self, sensors: int | None = None) -> tuple[SensorOffset, ...]:
        """Of each of its sensors that offsets are stated of; of none: of so many sensors, or of one."""
        count = max(len(self.offset_lines), len(self.offset_pixels)) or sensors or 1
        lines, pixels = self.offset_lines or (0.0,) * count, self.offset_pixels or (0.0,) * count
        return tuple(
            SensorOffset(lines=along, pixels=across) for along, across in zip(lines, pixels, strict=False)
        )


def set_up(camera: Camera, settings: CameraSettings, *, where: str) -> None:
    """Set a camera as it is asked; where: the press file, in errors.

    RequestError, before anything is set: the camera lacks a feature, or does not take its value.
    """
    wanted = [
        *_own(camera, settings, where),
        *_common(camera, settings, where),
        *_triggered(camera, settings, where),
        *_chunked(camera, settings, where),
    ]
    for name, value in wanted:
        camera.set(name, value)


def refuse_unfit(one: Feature, value: str, *, where: str, camera: str) -> None:
    """RequestError: a feature does not take a value, by the camera's own description."""
    if not one.writable:
        raise RequestError(
            where, f"{camera} does not let {one.name} be set now", remedy="leave it, or stop the camera"
        )
    if one.kind == "enumeration" and value not in one.choices:
        what = f"{camera} has no {one.name} {value!r}"
        raise RequestError(where, what, remedy=f"it has {shown(one.choices)}")
    if one.kind in ("integer", "float"):
        try:
            number = float(value)
        except ValueError as error:
            raise RequestError(where, f"{value!r} is no number for {one.name}", remedy=LOOK) from error
        low, high = one.least, one.greatest
        if (low is not None and number < low) or (high is not None and number > high):
            what = f"{camera} does not take {one.name} {number:g}"
            raise RequestError(where, what, remedy=f"give {low:g} to {high:g}")


def settable(camera: Camera, name: str, value: str) -> Feature:
    """A camera's feature that takes a value, by its own description; RequestError: it has none, or that does not."""
    one = camera.feature(name)
    if one is None:
        raise RequestError(name, f"{camera.found.id} has no such feature", remedy=LOOK)
    refuse_unfit(one, value, where=name, camera=camera.found.id)
    return one


def not_taken(camera: Camera, name: str, value: str, error: Exception) -> RequestError:
    """The camera itself refused a value."""
    return RequestError(name, f"{camera.found.id} does not take {value!r} ({error})", remedy=LOOK)


def chunk(chunks: Mapping[str, int], word: str) -> int | None:
    """What a block's chunks say of one of ``CHUNKS``; None: nothing."""
    return next((chunks[name] for name in CHUNKS[word] if name in chunks), None)


def position(camera: Camera, settings: CameraSettings) -> int | None:
    """How far the encoder has gone, in steps; None: the camera does not say. ScanError: it does not answer."""
    own = settings.names.get(camera.found.model, {}).get("position")
    for name in NAMES["position"] if own is None else (own,):
        one = camera.feature(name)
        if one is not None and one.value:
            return int(float(one.value))
    return None


def value_of(camera: Camera, name: str) -> str:
    """Of a feature that lines cannot be read without; ScanError: the camera does not say it."""
    one = camera.feature(name)
    if one is None or not one.value:
        raise ScanError(camera.found.id, f"does not say its {name}", remedy=LOOK)
    return one.value


def temperature_c(camera: Camera) -> float | None:
    """None: the camera does not say it."""
    one = camera.feature("DeviceTemperature")
    return float(one.value) if one is not None and one.value else None


def gone(camera: str, what: str) -> ScanError:
    """Nothing comes from a camera, by its ID."""
    return ScanError(camera, what, remedy="look at its cable, its power and `prooflight camera list`")


def shown(names: tuple[str, ...]) -> str:
    """Some of many names, for one line."""
    more = len(names) - MOST_SHOWN
    return ", ".join(names[:MOST_SHOWN]) + (f" and {more} more" if more > 0 else "") if names else "nothing"


def _own(camera: Camera, settings: CameraSettings, where: str) -> list[tuple[str, str]]:
    found = []
    for name, value in settings.features.items():
        field_name = f"{where}, camera.features.{name}"
        one = camera.feature(name)
        if one is None:
            raise _lacks(camera, field_name, (name,), nameable=False)
        found.append((one, _text(value), field_name))
    return _checked(camera, found)


def _common(camera: Camera, settings: CameraSettings, where: str) -> list[tuple[str, str]]:
    found = []
    for word in ("pixel_format", "block_lines", "line_rate_hz", "exposure_us"):
        value = getattr(settings, word)
        if value is not None:
            field_name = f"{where}, camera.{word}"
            found.append((_named(camera, settings, word, field_name), _text(value), field_name))
    return _checked(camera, found)


def _triggered(camera: Camera, settings: CameraSettings, where: str) -> list[tuple[str, str]]:
    """What starts a line; a camera without triggers runs free as it is."""
    if settings.trigger is None:
        return []
    field_name = f"{where}, camera.trigger"
    if settings.trigger == "free" and all(camera.feature(name) is None for name in NAMES["trigger_mode"]):
        return []
    selector = _named(camera, settings, "trigger_selector", field_name)
    line = next((name for name in LINE_TRIGGERS if name in selector.choices), None)
    mode = _named(camera, settings, "trigger_mode", field_name)
    if settings.trigger == "free":
        told = [] if line is None else [(selector, line, field_name)]
        return _checked(camera, [*told, (mode, "Off", field_name)])
    if line is None:
        what = f"{camera.found.id} cannot start a line by a trigger: its {selector.name} has {shown(selector.choices)}"
        raise RequestError(field_name, what, remedy='take a line camera, or trigger = "free"')
    source = _named(camera, settings, "trigger_source", field_name)
    encoder = settings.trigger_source or next((name for name in ENCODERS if name in source.choices), None)
    if encoder is None:
        what = (
            f"{camera.found.id} has no encoder known by name: its {source.name} has {shown(source.choices)}"
        )
        raise RequestError(field_name, what, remedy="name it as camera.trigger_source")
    asked = [
        (selector, line, field_name),
        (mode, "On", field_name),
        (source, encoder, f"{where}, camera.trigger_source"),
    ]
    return _checked(camera, asked)


def _chunked(camera: Camera, settings: CameraSettings, where: str) -> list[tuple[str, str]]:
    if settings.chunks is None:
        return []
    field_name = f"{where}, camera.chunks"
    mode = camera.feature("ChunkModeActive")
    if mode is None:
        raise _lacks(camera, field_name, ("ChunkModeActive",), nameable=False)
    told = _checked(camera, [(mode, _text(settings.chunks), field_name)])
    selector = camera.feature("ChunkSelector") if settings.chunks else None
    known = {name.removeprefix("Chunk") for names in CHUNKS.values() for name in names}
    for entry in () if selector is None else selector.choices:
        if entry in known:
            told += [("ChunkSelector", entry), ("ChunkEnable", "true")]
    return told


def _named(camera: Camera, settings: CameraSettings, word: str, where: str) -> Feature:
    """The camera's feature for one of our words."""
    own = settings.names.get(camera.found.model, {}).get(word)
    names = NAMES[word] if own is None else (own,)
    for name in names:
        one = camera.feature(name)
        if one is not None:
            return one
    raise _lacks(camera, where, names)


def _checked(camera: Camera, asked: list[tuple[Feature, str, str]]) -> list[tuple[str, str]]:
    for one, value, where in asked:
        refuse_unfit(one, value, where=where, camera=camera.found.id)
    return [(one.name, value) for one, value, _ in asked]


def _lacks(camera: Camera, where: str, names: tuple[str, ...], *, nameable: bool = True) -> RequestError:
    """Says what the camera lacks, and what it has instead; nameable: whether a press file may name it otherwise."""
    known = tuple(camera.features())
    near = dict.fromkeys(
        [one for name in names for one in difflib.get_close_matches(name, known, n=4, cutoff=0.5)]
    )
    what = f"{camera.found.id} has no feature {' or '.join(filter(None, (', '.join(names[:-1]), names[-1])))}"
    has = f"it has {shown(tuple(near))}" if near else LOOK
    own = f'; name its own under [camera.names."{camera.found.model}"]' if nameable else ""
    return RequestError(where, what, remedy=f"{has}{own}")


def _text(value: Value) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return f"{value:.12g}" if isinstance(value, float) else str(value)

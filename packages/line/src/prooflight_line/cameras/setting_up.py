"""Mapping of a user's settings to a camera's own features, each checked before any is set.

The standard (EMVA SFNC 2.7) has one name for each feature, older cameras have their maker's: ``NAMES`` lists
those that are known, and a press file adds others by model.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from prooflight.errors import RequestError, ScanError
from prooflight.scans.camera_settings import NAMES

if TYPE_CHECKING:
    from prooflight.scans.camera_settings import CameraSettings, Value
    from prooflight_line.cameras.camera import Camera, Feature

CHUNKS: Final[Mapping[str, tuple[str, ...]]] = {
    "triggers": ("ChunkLineTriggerCount", "ChunkTriggerinputcounter", "ChunkLineTriggerEndToEndCounter"),
    "encoder": ("ChunkEncoderValue", "ChunkShaftEncoderCounter"),
    "frame": ("ChunkFrameID", "ChunkFramecounter"),
    "timestamp": ("ChunkTimestamp",),
}
"""Names of values that cameras send with a block: line triggers and encoder steps seen, its number, its
time."""
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
FEATURES_REMEDY: Final = "see `prooflight camera features`"
MOST_SHOWN: Final = 12


def set_up(camera: Camera, settings: CameraSettings, *, where: str) -> None:
    """Set up a camera; where: the press file, in errors.

    RequestError, before anything is set: the camera lacks a feature, or does not accept its value.
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
    """Raise RequestError unless a feature accepts a value, by the camera's own description."""
    if not one.writable:
        raise RequestError(
            where,
            f"{camera} does not allow {one.name} to be set now",
            remedy="leave it out, or stop the camera",
        )
    if one.kind == "enumeration" and value not in one.choices:
        what = f"{camera} has no {one.name} {value!r}"
        raise RequestError(where, what, remedy=f"it has {shown(one.choices)}")
    if one.kind in ("integer", "float"):
        try:
            number = float(value)
        except ValueError as error:
            raise RequestError(
                where, f"{value!r} is not a number, as {one.name} requires", remedy=FEATURES_REMEDY
            ) from error
        low, high = one.least, one.greatest
        if (low is not None and number < low) or (high is not None and number > high):
            what = f"{camera} does not accept {one.name} {number:g}"
            raise RequestError(where, what, remedy=f"give {low:g} to {high:g}")


def settable(camera: Camera, name: str, value: str) -> Feature:
    """Return a camera's feature that accepts a value; RequestError: there is none, or it does not accept the value."""
    one = camera.feature(name)
    if one is None:
        raise RequestError(name, f"{camera.info.id} has no such feature", remedy=FEATURES_REMEDY)
    refuse_unfit(one, value, where=name, camera=camera.info.id)
    return one


def not_taken(camera: Camera, name: str, value: str, error: Exception) -> RequestError:
    """Return the error for a value that the camera itself refused."""
    return RequestError(name, f"{camera.info.id} does not accept {value!r} ({error})", remedy=FEATURES_REMEDY)


def chunk(chunks: Mapping[str, int], key: str) -> int | None:
    """Return a block's value of one of ``CHUNKS``; None if it has none."""
    return next((chunks[name] for name in CHUNKS[key] if name in chunks), None)


def position(camera: Camera, settings: CameraSettings) -> int | None:
    """Return the encoder's position, in steps; None if the camera does not report it. ScanError: it does not answer."""
    own = settings.names.get(camera.info.model, {}).get("position")
    for name in NAMES["position"] if own is None else (own,):
        one = camera.feature(name)
        if one is not None and one.value:
            return int(float(one.value))
    return None


def value_of(camera: Camera, name: str) -> str:
    """Return the value of a feature that is necessary for reading lines; ScanError: the camera does not report it."""
    one = camera.feature(name)
    if one is None or not one.value:
        raise ScanError(camera.info.id, f"does not report its {name}", remedy=FEATURES_REMEDY)
    return one.value


def temperature_c(camera: Camera) -> float | None:
    """Return the camera's temperature; None if it does not report it."""
    one = camera.feature("DeviceTemperature")
    return float(one.value) if one is not None and one.value else None


def disconnected(camera: str, what: str) -> ScanError:
    """Return the error for a camera, by its ID, that sends nothing."""
    return ScanError(camera, what, remedy="check its cable, its power and `prooflight camera list`")


def shown(names: tuple[str, ...]) -> str:
    """Return some of many names, for one line."""
    more = len(names) - MOST_SHOWN
    return ", ".join(names[:MOST_SHOWN]) + (f" and {more} more" if more > 0 else "") if names else "nothing"


def _own(camera: Camera, settings: CameraSettings, where: str) -> list[tuple[str, str]]:
    wanted = []
    for name, value in settings.features.items():
        field_name = f"{where}, camera.features.{name}"
        one = camera.feature(name)
        if one is None:
            raise _lacks(camera, field_name, (name,), nameable=False)
        wanted.append((one, _text(value), field_name))
    return _checked(camera, wanted)


def _common(camera: Camera, settings: CameraSettings, where: str) -> list[tuple[str, str]]:
    wanted = []
    for key in ("pixel_format", "block_lines", "line_rate_hz", "exposure_us"):
        value = getattr(settings, key)
        if value is not None:
            field_name = f"{where}, camera.{key}"
            wanted.append((_named(camera, settings, key, field_name), _text(value), field_name))
    return _checked(camera, wanted)


def _triggered(camera: Camera, settings: CameraSettings, where: str) -> list[tuple[str, str]]:
    """Return the settings of what starts a line; a camera without triggers runs free as it is."""
    if settings.trigger is None:
        return []
    field_name = f"{where}, camera.trigger"
    if settings.trigger == "free" and all(camera.feature(name) is None for name in NAMES["trigger_mode"]):
        return []
    selector = _named(camera, settings, "trigger_selector", field_name)
    line = next((name for name in LINE_TRIGGERS if name in selector.choices), None)
    mode = _named(camera, settings, "trigger_mode", field_name)
    if settings.trigger == "free":
        selection = [] if line is None else [(selector, line, field_name)]
        return _checked(camera, [*selection, (mode, "Off", field_name)])
    if line is None:
        what = f"{camera.info.id} cannot start a line by a trigger: its {selector.name} has {shown(selector.choices)}"
        raise RequestError(field_name, what, remedy='use a line camera, or trigger = "free"')
    source = _named(camera, settings, "trigger_source", field_name)
    encoder = settings.trigger_source or next((name for name in ENCODERS if name in source.choices), None)
    if encoder is None:
        what = (
            f"{camera.info.id} has no encoder of a known name: its {source.name} has {shown(source.choices)}"
        )
        raise RequestError(field_name, what, remedy="state its name as camera.trigger_source")
    wanted = [
        (selector, line, field_name),
        (mode, "On", field_name),
        (source, encoder, f"{where}, camera.trigger_source"),
    ]
    return _checked(camera, wanted)


def _chunked(camera: Camera, settings: CameraSettings, where: str) -> list[tuple[str, str]]:
    if settings.chunks is None:
        return []
    field_name = f"{where}, camera.chunks"
    mode = camera.feature("ChunkModeActive")
    if mode is None:
        raise _lacks(camera, field_name, ("ChunkModeActive",), nameable=False)
    wanted = _checked(camera, [(mode, _text(settings.chunks), field_name)])
    selector = camera.feature("ChunkSelector") if settings.chunks else None
    supported = {name.removeprefix("Chunk") for names in CHUNKS.values() for name in names}
    for entry in () if selector is None else selector.choices:
        if entry in supported:
            wanted += [("ChunkSelector", entry), ("ChunkEnable", "true")]
    return wanted


def _named(camera: Camera, settings: CameraSettings, key: str, where: str) -> Feature:
    """Return the camera's feature for a key of ``NAMES``."""
    own = settings.names.get(camera.info.model, {}).get(key)
    names = NAMES[key] if own is None else (own,)
    for name in names:
        one = camera.feature(name)
        if one is not None:
            return one
    raise _lacks(camera, where, names)


def _checked(camera: Camera, wanted: list[tuple[Feature, str, str]]) -> list[tuple[str, str]]:
    for one, value, where in wanted:
        refuse_unfit(one, value, where=where, camera=camera.info.id)
    return [(one.name, value) for one, value, _ in wanted]


def _lacks(camera: Camera, where: str, names: tuple[str, ...], *, nameable: bool = True) -> RequestError:
    """Return the error for a missing feature, which names similar ones.

    nameable: whether a press file may give the feature another name.
    """
    available = tuple(camera.features())
    near = dict.fromkeys(
        [one for name in names for one in difflib.get_close_matches(name, available, n=4, cutoff=0.5)]
    )
    what = f"{camera.info.id} has no feature {' or '.join(filter(None, (', '.join(names[:-1]), names[-1])))}"
    has = f"it has {shown(tuple(near))}" if near else FEATURES_REMEDY
    own = f'; state its own name under [camera.names."{camera.info.model}"]' if nameable else ""
    return RequestError(where, what, remedy=f"{has}{own}")


def _text(value: Value) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return f"{value:.12g}" if isinstance(value, float) else str(value)

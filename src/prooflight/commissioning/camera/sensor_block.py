"""Sensor block of a press file, from a camera's own exposures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from prooflight.commissioning.camera.fixed_pattern import Measured
from prooflight.commissioning.camera.photon_transfer import (
    CLIPPED_SHARE,
    PhotonTransfer,
    dark_level,
    photon_transfer,
)
from prooflight.commissioning.file_edit import toml_line
from prooflight.errors import RequestError, ScanError
from prooflight.spectra import WAVE_NM

if TYPE_CHECKING:
    from prooflight.camera.sensor import LineSensor
    from prooflight.commissioning.camera.exposures import Exposure

FIELDS = (
    "name",
    "pixels",
    "pixel_pitch_um",
    "fill_factor",
    "tdi_stages",
    "line_rate_hz",
    "conversion_gain_uv_per_e",
    "voltage_swing_v",
    "read_noise_e",
    "dark_current_e_per_s",
    "dsnu_e",
    "prnu_percent",
    "bits",
    "black_level_dn",
    "quantum_efficiency",
)
"""Fields of ``[[sensor]]``, in the order in which a block is written."""
NOT_IN_EXPOSURES = ("pixel_pitch_um", "fill_factor", "tdi_stages", "line_rate_hz", "quantum_efficiency")
"""Fields that exposures to unknown light do not determine; they come from a similar press file."""
LARGE_RESIDUAL = 5.0
LARGE_LINE_NOISE = 0.3
"""Least line noise that is reported, as a share of a pixel's noise.

Squared, it adds a tenth to the variance.
"""
_DIGITS = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Given:
    """Properties of a sensor that are given besides its exposures."""

    like: LineSensor | None = None
    like_name: str = ""
    """Name of the press file of ``like``."""
    voltage_swing_v: float | None = None
    bits: int | None = None

    def with_defaults(self) -> Given:
        """Return the same, with swing and bits of ``like`` where none are given."""
        if self.like is None:
            return self
        swing_v = self.like.voltage_swing_v if self.voltage_swing_v is None else self.voltage_swing_v
        return replace(self, voltage_swing_v=swing_v, bits=self.like.bits if self.bits is None else self.bits)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SensorBlock:
    """Fields of a ``[[sensor]]``, the source of each, and further measurements."""

    fields: dict[str, Any]
    sources: dict[str, str]
    """Source of every field in a few words, and of those that are missing."""
    standard_errors: dict[str, float]
    gain: Measured
    """System gain. [DN/e-]"""
    full_well_e: float | None
    """Signal that fills the converter's range, 2^bits / gain. [e-]"""
    saturation_e: float | None
    """Signal at which temporal variance is greatest (EMVA 1288); None: not reached by these exposures. [e-]"""
    transfer: PhotonTransfer
    notes: tuple[str, ...]

    @property
    def missing(self) -> tuple[str, ...]:
        """Return the fields that neither exposures nor a press file give."""
        return tuple(name for name in FIELDS if name not in self.fields)

    def toml(self) -> str:
        """Return the block as text for a press file; missing fields stand in it as comments."""
        lines = ["[[sensor]]"]
        for name in FIELDS:
            error = self.standard_errors.get(name)
            source = f"+- {error:.2g}, {self.sources[name]}" if error else self.sources[name]
            given = toml_line(name, self.fields[name]) if name in self.fields else f"# {name} ="
            lines.append(f"{given}  # {source}")
        return "\n".join([*(f"# {note}" for note in self.notes), *lines]) + "\n"


def characterise_sensors(
    dark: Sequence[Sequence[Exposure]],
    flat: Sequence[Sequence[Exposure]],
    *,
    given: Given,
    likes: Sequence[LineSensor] = (),
) -> list[SensorBlock]:
    """Characterise each sensor from exposures that hold one statistic a sensor.

    likes: as many sensors, or none.
    """
    sensors = len((*dark, *flat)[0])
    return [
        characterise_sensor(
            [exposure[index] for exposure in dark],
            [exposure[index] for exposure in flat],
            given=replace(given, like=likes[index]) if likes else given,
            number=index + 1,
        )
        for index in range(sensors)
    ]


def characterise_sensor(
    dark: Sequence[Exposure], flat: Sequence[Exposure], *, given: Given, number: int
) -> SensorBlock:
    """Characterise one sensor, the ``number``-th of its camera, from its dark and flat exposures.

    Dark exposures with a line rate of their own serve for dark current and black level only. ScanError or
    RequestError if the exposures do not suffice.
    """
    here, elsewhere = _by_line_rate(dark, given)
    completed = given.with_defaults()
    bits = completed.bits
    transfer = photon_transfer(here, flat, top_code_dn=None if bits is None else 2**bits - 1)
    black, current, how_black, how_current = _black_and_dark_current(transfer, here, elsewhere, given)
    read = transfer.read_noise_e(black.value)
    gain = transfer.gain
    exposures = f"photon transfer, {len(here)} dark and {int(transfer.used.sum())} fitted exposures"
    with_dark = "" if given.like or elsewhere else ", with the dark signal's shot noise"
    measured: dict[str, tuple[Measured, str]] = {
        "read_noise_e": (read, exposures + with_dark),
        "dark_current_e_per_s": (current, how_current),
        "dsnu_e": (_over(transfer.dsnu_dn, gain), f"over {transfer.offset_dn.size} columns"),
        "prnu_percent": (
            transfer.prnu_percent,
            f"over {transfer.offset_dn.size} columns, without lamp and cos^4",
        ),
        "black_level_dn": (black, how_black),
    }
    if bits is not None and completed.voltage_swing_v is not None:
        volts = gain.times(completed.voltage_swing_v / 2**bits * 1e6)
        measured["conversion_gain_uv_per_e"] = (volts, f"{gain.value:.5g} DN/e- at this swing and these bits")
    fields, sources = _given_fields(given, number, pixels=transfer.offset_dn.size)
    errors = {}
    for name, (number_and_error, source) in measured.items():
        fields[name] = _rounded(number_and_error.value)
        errors[name] = _rounded(number_and_error.standard_error)
        sources[name] = f"measured: {source}" if number_and_error.standard_error else source
    return SensorBlock(
        fields={name: fields[name] for name in FIELDS if name in fields},
        sources=sources,
        standard_errors={name: errors[name] for name in FIELDS if name in errors},
        gain=gain,
        full_well_e=None if bits is None else 2**bits / gain.value,
        saturation_e=None
        if transfer.saturation_dn is None
        else (transfer.saturation_dn - transfer.no_light_dn.value) / gain.value,
        transfer=transfer,
        notes=_notes(transfer, here, elsewhere, given),
    )


def _by_line_rate(dark: Sequence[Exposure], given: Given) -> tuple[list[Exposure], list[Exposure]]:
    """Separate dark exposures at the flat ones' line rate from those at others."""
    usual = given.like.line_rate_hz if given.like else None
    elsewhere = [e for e in dark if e.line_rate_hz is not None and e.line_rate_hz != usual]
    if elsewhere and given.like is None:
        remedy = "give --like PRESS.toml, which holds line rate and TDI stages of the other exposures"
        raise RequestError(elsewhere[0].name, "a line rate alone is not an exposure time", remedy=remedy)
    here = [e for e in dark if e not in elsewhere]
    if dark and not here:
        what = f"none is at the line rate of the flat exposures, {usual:g} Hz"
        raise ScanError("dark exposures", what, remedy="record one at that rate as well")
    return here, elsewhere


def _black_and_dark_current(
    transfer: PhotonTransfer, here: Sequence[Exposure], elsewhere: Sequence[Exposure], given: Given
) -> tuple[Measured, Measured, str, str]:
    """Return black level [DN] and dark current [e-/s], and the source of each in a few words.

    With two line rates or more: intercept and slope of the dark level against exposure. With one: the black
    level is the press file's, or, without a press file, holds the dark signal.
    """
    no_light, like, gain = transfer.no_light_dn, given.like, transfer.gain
    # One specimen's columns: their mean offset is off by chance, and looks like black level.
    chance_dn = transfer.dsnu_dn.value / np.sqrt(transfer.offset_dn.size)
    if like is None:
        black = Measured(value=max(no_light.value, 0.0), standard_error=no_light.standard_error)
        return black, Measured(value=0.0, standard_error=0.0), "with the dark signal", "in black_level_dn"
    if not elsewhere:
        error_dn = float(np.hypot(no_light.standard_error, chance_dn))
        signal = _over(Measured(value=no_light.value - like.black_level_dn, standard_error=error_dn), gain)
        current = Measured(
            value=max(signal.value, 0.0) / like.exposure_s,
            standard_error=signal.standard_error / like.exposure_s,
        )
        black = Measured(value=like.black_level_dn, standard_error=0.0)
        return black, current, f"as in {given.like_name}", "one line rate, taking the black level as known"
    levels = [no_light, *(dark_level(transfer, exposure) for exposure in elsewhere)]
    rates = [like.line_rate_hz, *(exposure.line_rate_hz or like.line_rate_hz for exposure in elsewhere)]
    seconds = like.tdi_stages / np.array(rates)
    error = np.array([level.standard_error for level in levels])
    design = np.stack([np.ones_like(seconds), seconds], axis=1) / error[:, None]
    covariance = np.linalg.inv(design.T @ design)
    intercept, slope = covariance @ design.T @ (np.array([level.value for level in levels]) / error)
    rise = Measured(value=max(float(slope), 0.0), standard_error=float(np.sqrt(covariance[1, 1])))
    black = Measured(
        value=max(float(intercept), 0.0), standard_error=float(np.hypot(np.sqrt(covariance[0, 0]), chance_dn))
    )
    how = f"dark level against exposure at {len(set(rates))} line rates"
    return black, _over(rise, gain), how, how


def _given_fields(given: Given, number: int, *, pixels: int) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the fields that are not measured, and their sources."""
    like = given.like
    fields: dict[str, Any] = {"name": like.name if like else f"sensor{number}", "pixels": pixels}
    sources = {"name": f"as in {given.like_name}" if like else "by its place", "pixels": "of the exposures"}
    for name in NOT_IN_EXPOSURES:
        sources[name] = "exposures do not show it: fill it in, or give --like PRESS.toml"
        if like is not None:
            fields[name] = getattr(like, name)
            sources[name] = f"as in {given.like_name}: exposures do not show it"
    if like is not None:
        curve = [round(float(share), _DIGITS) for share in like.quantum_efficiency]
        fields["quantum_efficiency"] = {"wave_nm": [int(wave) for wave in WAVE_NM], "qe": curve}
    for name, option in (("voltage_swing_v", "--voltage-swing-v"), ("bits", "--bits")):
        value = getattr(given.with_defaults(), name)
        sources[name] = f"exposures do not show it: fill it in, or give {option}"
        if value is not None:
            fields[name] = value
            sources[name] = f"as in {given.like_name}" if getattr(given, name) is None else "as given"
    sources["conversion_gain_uv_per_e"] = "needs the voltage swing and the bits"
    return fields, sources


def _notes(
    transfer: PhotonTransfer, here: Sequence[Exposure], elsewhere: Sequence[Exposure], given: Given
) -> tuple[str, ...]:
    notes = []
    dark_sigma = float(np.sqrt(np.mean([exposure.variance_dn2 for exposure in here])))
    if transfer.dark_clipped:
        share = 100 * np.mean([exposure.lowest_share for exposure in here])
        notes.append(
            f"{share:.2g} % of the dark samples are code 0, more than {100 * CLIPPED_SHARE:g} %: read noise, DSNU and "
            "offsets come from the flat exposures; a black level of some codes would measure them directly"
        )
    if given.like and not elsewhere:
        notes.append(
            f"dark current comes from one line rate and the black level of {given.like_name}; dark exposures at a "
            "second rate (FILE@HZ) would measure both"
        )
    if given.like is None:
        notes.append(
            "black level and dark signal are one number here; --like PRESS.toml and a second line rate separate them"
        )
    if transfer.saturation_dn is None:
        notes.append("saturation was not reached")
    if transfer.dark_hidden:
        notes.append(
            "rounding hides the dark exposures' noise: read noise and offsets come from the flat exposures; more bits "
            "or a higher gain would measure them directly"
        )
    if transfer.line_noise_dn > LARGE_LINE_NOISE * dark_sigma:
        notes.append(
            f"whole lines jump by {transfer.line_noise_dn:.2g} DN in the dark: that is not in read_noise_e"
        )
    if transfer.worst_residual > LARGE_RESIDUAL:
        notes.append(
            f"a variance is {transfer.worst_residual:.0f} standard errors from the straight line: the camera is not "
            "linear, or the lamp not steady"
        )
    return tuple(notes)


def _over(signal_dn: Measured, gain: Measured) -> Measured:
    """Convert a signal to electrons."""
    value = signal_dn.value / gain.value
    error = np.hypot(signal_dn.standard_error, value * gain.standard_error) / gain.value
    return Measured(value=value, standard_error=float(error))


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")

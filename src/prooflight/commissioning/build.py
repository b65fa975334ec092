"""Build of a press artefact from a press file."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from prooflight.camera.camera import Camera, with_pixels
from prooflight.camera.lens_correction import SHORT_REACH_PIXELS, lens_correction
from prooflight.camera.sensor import LineSensor, draw_fixed_pattern
from prooflight.cmyk import INKS
from prooflight.commissioning.characterise import (
    ColumnCalibration,
    appearance_srgb,
    calibrate_columns,
    clipped_share,
    signal_dn,
    tables,
    variance_dn2,
)
from prooflight.commissioning.inks import packed
from prooflight.errors import PressFileError
from prooflight.inks.ink_model import InkModel
from prooflight.prediction.tables import SensorModel
from prooflight.press.artefact import Press
from prooflight.press.spot_units import SpotUnit, SpotUnits
from prooflight.rng import stream
from prooflight.spectra import BANDS

if TYPE_CHECKING:
    from prooflight.inks.reflectance import ReflectanceModel
    from prooflight.press.press_file import PressFile
    from prooflight.scans.geometry import ScanGeometry

SUPERSAMPLING = 2
"""Number of raster pixels across one camera pixel.

At 1 an edge may lie half a camera pixel from its printed place.
"""
CALIBRATION_LINES = 4096
WHITE_TILE = 0.85
"""Reflectance of the white tile. assumed: ceramic."""
LEAST_TILE_DN = 0.1
"""Least signal of the white tile; below, digital numbers hold no information on a page."""


def build_press(
    press_file: PressFile,
    *,
    seed: int,
    pixels: int | None = None,
    columns: Sequence[ColumnCalibration] | None = None,
    progress: Callable[[str], None] = lambda _step: None,
) -> Press:
    """Build a press from its press file.

    columns: of the real camera, one a sensor (``measured_columns``); None: a simulated
    specimen's. seed: of the simulated specimen's fixed pattern and of its calibration exposures. pixels:
    longer line sensors than the file's, for jobs wider than its field. PressFileError if white paper would
    saturate the sensor.
    """
    camera = press_file.camera()
    if pixels is not None:
        camera = with_pixels(camera, pixels)
    inks = press_file.inks(progress=lambda model: progress(f"trying ink models, {model}"))
    refuse_light(press_file, camera)
    if columns is None:
        progress("calibrating columns")
        columns = _specimen_columns(camera, seed=seed)
    else:
        _refuse_columns(press_file, camera, columns)
    progress("characterising colours")
    geometry = press_file.geometry(camera)
    sensors = _sensor_models(press_file, camera, inks, columns, geometry)
    progress("picturing colours")
    ink_arrays, ink_facts = packed(inks)
    units = press_file.spot_units()
    return Press(
        name=press_file.name,
        geometry=geometry,
        sensors=sensors,
        supersampling=SUPERSAMPLING,
        variation=press_file.variation(),
        fringes=press_file.fringes,
        rip_dpi=press_file.rip_dpi,
        rip_engine=press_file.rip_engine,
        rip_model=press_file.rip_model,
        screen=press_file.screen,
        spot_units=None if not units else spot_units(camera, inks, units),
        appearance_srgb=appearance_srgb(inks),
        costs=press_file.costs(),
        good_pages_per_false_alarm=press_file.good_pages_per_false_alarm,
        floor_share=press_file.floor_share,
        origin=_origin(press_file, inks, seed=seed),
        ink_arrays=ink_arrays,
        ink_facts=ink_facts,
        clipped=tuple(
            clipped_share(sensor, model.mean_dn)
            for sensor, model in zip(camera.sensors, sensors, strict=True)
        ),
    )


def _specimen_columns(camera: Camera, *, seed: int) -> Sequence[ColumnCalibration]:
    """Return the calibration of a simulated specimen's columns, from simulated exposures of a white tile."""
    rng = stream(seed, "specimen")
    patterns = [draw_fixed_pattern(sensor, rng) for sensor in camera.sensors]
    white = np.full(BANDS, WHITE_TILE)
    return calibrate_columns(
        camera, patterns=patterns, white_reflectance=white, lines=CALIBRATION_LINES, rng=rng
    )


def _origin(press_file: PressFile, inks: ReflectanceModel, *, seed: int) -> dict[str, str]:
    """Return what the artefact says of its own making."""
    return {
        "press_file": press_file.text,
        "press_file_sha256": hashlib.sha256(press_file.text.encode()).hexdigest(),
        "inks": inks.name,
        "chart_digest": inks.chart_digest if isinstance(inks, InkModel) else "",
        "seed": str(seed),
        **press_file.print_condition.facts,
    }


def _sensor_models(
    press_file: PressFile,
    camera: Camera,
    inks: ReflectanceModel,
    columns: Sequence[ColumnCalibration],
    geometry: ScanGeometry,
) -> tuple[SensorModel, ...]:
    """Return the tables of every sensor, where the press file places it; PressFileError: paper saturates one."""
    backing = np.full(BANDS, press_file.backing_reflectance)
    sensors = [
        _sensor_model(camera, sensor, calibration, of_colours, backing_reflectance=backing)
        for sensor, calibration, of_colours in zip(camera.sensors, columns, tables(camera, inks), strict=True)
    ]
    for model in sensors:
        _refuse_saturation(press_file, model)
    return tuple(
        replace(model, footprint=offset.of_fraction(model.footprint, geometry))
        for model, offset in zip(sensors, press_file.sensor_offsets(), strict=True)
    )


def _sensor_model(
    camera: Camera,
    sensor: LineSensor,
    calibration: ColumnCalibration,
    of_colours: tuple[NDArray[np.float32], NDArray[np.float32]],
    *,
    backing_reflectance: NDArray[np.float64],
) -> SensorModel:
    """Build one sensor's model for prediction, from its tables of mean and variance and its columns."""
    mean, variance = of_colours
    backing_e = sensor.electrons(camera.irradiance_photons(backing_reflectance))
    footprint = camera.footprint(sensor, reach_pixels=SHORT_REACH_PIXELS)
    return SensorModel(
        name=sensor.name,
        mean_dn=mean,
        variance_dn2=variance,
        footprint=footprint,
        correction=lens_correction(camera, sensor, footprint),
        column_offset_dn=calibration.offset_dn,
        column_gain=calibration.gain,
        dark_variance_dn2=float(variance_dn2(sensor, np.zeros(()))),
        backing_dn=float(signal_dn(sensor, backing_e)),
        backing_variance_dn2=float(variance_dn2(sensor, backing_e)),
        top_code_dn=sensor.top_code_dn,
    )


def spot_units(camera: Camera, inks: ReflectanceModel, units: Sequence[SpotUnit]) -> SpotUnits:
    """Return units that print spot inks, with the response of a camera and the paper of an ink model."""
    bands = camera.irradiance_photons(np.eye(BANDS))  # light is linear in reflectance, band by band
    return SpotUnits(
        units=tuple(units),
        response_dn=tuple(tuple(signal_dn(one, one.electrons(bands)).tolist()) for one in camera.sensors),
        paper=tuple(inks.reflectance(np.zeros(INKS)).tolist()),
    )


def refuse_light(press_file: PressFile, camera: Camera) -> None:
    """Raise PressFileError if the white tile saturates (5 % above its mean, for bright columns) or has no signal."""
    tile = camera.irradiance_photons(np.full(BANDS, WHITE_TILE))
    for sensor in camera.sensors:
        level = float(signal_dn(sensor, sensor.electrons(tile)))
        dark = sensor.dark_e * sensor.dn_per_e + sensor.black_level_dn
        if dark >= sensor.top_code_dn:
            fault = f"sensor {sensor.name}: without light it would read {dark:.0f} DN of {sensor.top_code_dn}"
            remedy = "lower dark_current_e_per_s or black_level_dn, or raise the line rate"
            raise PressFileError(press_file.path, fault, remedy=remedy)
        if 1.05 * level > sensor.top_code_dn:
            raise _saturates(press_file, sensor.name, "the white tile", 1.05 * level, sensor.top_code_dn)
        if level < LEAST_TILE_DN:
            fault = f"sensor {sensor.name}: the white tile would read {level:.2g} DN above dark"
            remedy = "raise light.luminance_cd_m2, the conversion gain or bits, or lower the line rate"
            raise PressFileError(press_file.path, fault, remedy=remedy)


def _refuse_columns(press_file: PressFile, camera: Camera, columns: Sequence[ColumnCalibration]) -> None:
    """Raise PressFileError if columns were measured of another camera."""
    wanted = [sensor.pixels for sensor in camera.sensors]
    given = [one.gain.size for one in columns]
    if given != wanted:
        what = f"describes sensors of {wanted} pixels, columns were measured of {given}"
        raise PressFileError(
            press_file.path, what, remedy="set this camera up again, or build without --columns"
        )


def _refuse_saturation(press_file: PressFile, model: SensorModel) -> None:
    """Raise PressFileError if any column saturates on paper."""
    paper_dn = float((model.column_offset_dn + model.column_gain * model.mean_dn.max()).max())
    if paper_dn > model.top_code_dn:
        raise _saturates(press_file, model.name, "white paper", paper_dn, model.top_code_dn)


def _saturates(press_file: PressFile, name: str, what: str, level_dn: float, top_dn: int) -> PressFileError:
    fault = f"sensor {name}: {what} would reach {level_dn:.0f} DN of {top_dn}"
    remedy = "lower light.luminance_cd_m2 or the conversion gain, or raise the line rate"
    return PressFileError(press_file.path, fault, remedy=remedy)

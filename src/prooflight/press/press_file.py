"""Press file (TOML): one press and its camera, as a user describes them.

Units are part of the names; unknown fields are refused.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from prooflight import spectra
from prooflight.camera.camera import Camera
from prooflight.camera.optics import Lens, Light
from prooflight.camera.sensor import LineSensor
from prooflight.detectors.cost import RunningCosts
from prooflight.errors import ChartError, PressFileError
from prooflight.files.fields import GREATEST, LEAST
from prooflight.files.given import GivenFiles, shortly
from prooflight.inks.built_in import built_in_inks
from prooflight.inks.cgats import number
from prooflight.inks.chart import read_chart
from prooflight.inks.ink_model import InkModel
from prooflight.inks.selection import AUTO, MODELS
from prooflight.pages.pdf.engine import RipEngine
from prooflight.pages.spots.cxf import read_cxf, read_spot_ink
from prooflight.press.blocks import IN_IDEAL, SensorBlock, checked
from prooflight.press.print_condition import PrintCondition
from prooflight.press.spot_units import SpotUnit
from prooflight.scans.alignment import SensorOffset
from prooflight.scans.camera_settings import NAMES, CameraSettings
from prooflight.scans.geometry import ScanGeometry
from prooflight.spectra import BANDS

if TYPE_CHECKING:
    from pydantic import BaseModel

    from prooflight.inks.reflectance import ReflectanceModel
    from prooflight.pages.pdf.rip_model import RipModel
    from prooflight.pages.screen import Screen
    from prooflight.press.gate import GateSettings
    from prooflight.press.outlets import PlantBlock
    from prooflight.press.parts import PartsBlock
    from prooflight.scans.scanner.feeder import FeederPrior

PRESS_FILES: Final = GivenFiles(
    error=PressFileError, remedy="give the path of a press file (TOML, UTF-8)", largest_mb=0.25
)
CURVE_FILES: Final = GivenFiles(
    error=PressFileError, remedy="name a file of wavelengths and values", largest_mb=0.25
)
TWO_SENSORS: Final = "two-sensors.toml"
"""Preset of the paper's camera with its second sensor."""
LINE_CAMERA_PRESETS: Final = ("prototype", "two-sensors", "rgb-line")
"""Names of the presets of presses with a line camera."""
EITHER_WORLD: Final = """
[variation]
world = "either"                   # "press" or "measured" is enough if you know which of them your press is like
"""
"""Block that presets lack, since their own prints are simulated in a known world, and files for actual presses need."""
FINEST_MM: Final = 0.001
COARSEST_MM: Final = 5.0
"""Greatest extent of a pixel or a line on the page; office-class cameras see 0.02 to 0.3 mm."""
LONGEST_BLUR_PIXELS: Final = 256.0
"""Greatest blur by motion, binning and TDI smear combined.

Its footprint takes 150 MB to compute, and the exact camera as many times a page's memory as it has pixels.
"""
LARGEST_SCAN_GB: Final = 2.0
"""Greatest size of the scan of an A4 page."""
_A4_LENGTH_MM: Final = 297.0
_FEWEST_ELECTRONS: Final = 1e-3
"""Least electrons of white paper in a line: no sensor has so little noise that less could be seen."""


def line_camera_press_text(name: str) -> str:
    """Return the text of one of ``LINE_CAMERA_PRESETS`` for a press of which it is unknown how its sheets vary."""
    return preset_text(f"{name}.toml") + EITHER_WORLD


def preset_text(file_name: str) -> str:
    """Return the text of a preset of the package."""
    return resources.files("prooflight.press").joinpath("presets", file_name).read_text(encoding="utf-8")


class PressFile:
    """Press file that has been read and checked; builds the values that the stages work with."""

    def __init__(self, path: Path, text: str) -> None:
        """Check ``text``; ``path`` is named in errors, and relative file names start from it."""
        self.path, self.text = path, text
        self._document = checked(path, text)
        self._inks: ReflectanceModel | None = None

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle by path and text, so that worker processes parse it again."""
        return type(self), (self.path, self.text)

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read a file; PressFileError names the wrong field and a valid value."""
        path = Path(path)
        try:
            text = PRESS_FILES.read_text(path)
        except OSError as error:
            raise PressFileError(path, "cannot be read", remedy=PRESS_FILES.remedy) from error
        return cls(path, text)

    @classmethod
    def preset(cls, name: str) -> Self:
        """Read a preset of the package; errors name it without its folder."""
        return cls(Path(name), preset_text(name))

    @classmethod
    def prototype(cls) -> Self:
        """Read the paper's rig with the built-in inks."""
        return cls.preset("prototype.toml")

    @property
    def name(self) -> str:
        """Return the press's name: the file's."""
        return self.path.stem

    @property
    def good_pages_per_false_alarm(self) -> float:
        """Return the good pages per false alarm of ``[decision]``, or chi-square's where none is stated."""
        return self._document.decision.good_pages_per_false_alarm or IN_IDEAL

    @property
    def states_rate(self) -> bool:
        """Return whether ``[decision]`` states the false-alarm rate."""
        return self._document.decision.good_pages_per_false_alarm is not None

    @property
    def floor_share(self) -> float:
        """Return the floor of ``[decision]`` as a share of paper white; 0: there is none."""
        return self._document.decision.floor_percent_of_white / 100

    @property
    def fringes(self) -> bool:
        """Return whether prediction follows planes that share edges, from ``[inspection]``."""
        return self._document.inspection.fringes

    @property
    def rip_dpi(self) -> float | None:
        """Return the resolution of ``[rip]`` at which the press rips PDFs; None: not stated. [pixels/inch]"""
        return self._document.rip.dpi

    @property
    def rip_engine(self) -> RipEngine:
        """Return the engine of ``[rip]`` that draws the pages of PDFs."""
        block = self._document.rip
        return RipEngine(name=block.engine, command=block.command)

    @property
    def rip_model(self) -> RipModel:
        """Return the parameters that ``[rip]`` states of how the press's RIP makes pixels of shapes."""
        return self._document.rip.model

    @property
    def screen(self) -> Screen | None:
        """Return the screen of ``[screen]``; None: not stated."""
        return self._document.screen

    @property
    def backing_reflectance(self) -> float:
        """Return the reflectance of the backing beyond the page, the same at every wavelength. [-]"""
        return self._document.transport.backing_reflectance

    def costs(self) -> RunningCosts:
        """Return the costs of ``[costs]``."""
        return self._document.costs

    def variation(self) -> dict[str, Any]:
        """Return ``[variation]`` as it stands in the file: only given amounts, nested alike, ranges as lists."""
        given: BaseModel = self._document.variation
        return given.model_dump(mode="json", by_alias=True, exclude_unset=True)

    def camera_settings(self) -> CameraSettings:
        """Return ``[camera]``, or the first of ``[[camera]]``; errors as of ``cameras``."""
        return (*self.cameras(), CameraSettings())[0]

    def cameras(self) -> tuple[CameraSettings, ...]:
        """Return the settings of each line camera; PressFileError: it holds an unknown name."""
        cameras = self._document.camera
        for settings in cameras:
            for model, names in settings.names.items():
                for feature in names:
                    if feature not in NAMES:
                        what = f"camera.names.{shortly(model)}.{shortly(feature)} is not a feature that can be renamed"
                        raise PressFileError(self.path, what, remedy=f"name {', '.join(NAMES)}")
        return cameras

    def sensor_offsets(self) -> tuple[SensorOffset, ...]:
        """Return the offset of each sensor's lines from the press's; PressFileError: they are not of its sensors.

        One entry for each ``[[sensor]]``; none where the file states no offset.
        """
        sensors, cameras = len(self._document.sensor), self.cameras()
        stated = [camera.offset_lines or camera.offset_pixels for camera in cameras]
        if not any(stated):
            return (SensorOffset(),) * sensors
        offsets = [
            offset for camera in cameras for offset in camera.offsets(sensors if len(cameras) == 1 else None)
        ]
        if len(offsets) != sensors:
            what = f"camera.offset_lines and offset_pixels are of {len(offsets)} sensors"
            raise PressFileError(self.path, what, remedy=f"give one each of the file's {sensors} sensors")
        return tuple(offsets)

    def gate_settings(self) -> GateSettings | None:
        """Return ``[gate]``, the gate at which bad sheets leave the paper path.

        None: the press has no gate.
        """
        return self._document.gate

    @property
    def feeder(self) -> FeederPrior | None:
        """Return the feeder of ``[geometry]``; None: the press is not seen by an office scanner."""
        return self._document.geometry

    @property
    def plant(self) -> PlantBlock:
        """Return ``[plant]``, the receivers of a run's events."""
        return self._document.plant

    @property
    def parts(self) -> PartsBlock:
        """Return ``[press]``, the rollers and print heads by which causes are named."""
        return self._document.press

    @property
    def print_condition(self) -> PrintCondition:
        """Return the condition of ``[inks]`` and the paper of ``[substrate]``, as far as the file states them."""
        block = self._document.substrate
        return PrintCondition(
            name=self._document.inks.condition or "", brand=block.brand or "", weight_gsm=block.weight_gsm
        )

    def inks(self, progress: Callable[[str], None] | None = None) -> ReflectanceModel:
        """Return the ink model of ``[inks]``: the built-in press where no chart is named.

        Fitting takes up to half a minute, so ``progress`` is called with each step, and the model is cached.
        ChartError: the chart cannot be used.
        """
        if self._inks is None:
            block = self._document.inks
            if block.chart is None:
                self._inks = built_in_inks()
            else:
                if block.model not in (AUTO, *MODELS):
                    what = f"inks.model: there is no ink model {shortly(block.model)!r}"
                    remedy = f"take {AUTO}, {', '.join(MODELS)}"
                    raise PressFileError(self.path, what, remedy=remedy)
                chart = read_chart(self.path.parent / block.chart)
                self._inks = InkModel.fit(chart, block.model, progress=progress)
        return self._inks

    def spot_units(self) -> tuple[SpotUnit, ...]:
        """Return the units of ``[[inks.spot]]``, with the spectra of the CxF files that it names.

        ChartError: a file cannot be used, or holds no spectrum of the ink.
        """
        units = []
        for block in self._document.inks.spot:
            if block.cxf is None:
                units.append(SpotUnit(name=block.name))
                continue
            path = self.path.parent / block.cxf
            try:
                units.append(SpotUnit.of(read_spot_ink(read_cxf(path), block.name)))
            except ChartError as error:
                what = f"{path}: {error.what}"
                raise ChartError(f"{self.path}: spot ink {block.name}", what, remedy=error.remedy) from error
        return tuple(units)

    def camera(self) -> Camera:
        """Build the camera from ``[light]``, ``[lens]``, ``[[sensor]]`` and the speed of ``[transport]``."""
        document = self._document
        try:
            camera = Camera(
                light=self._light(),
                lens=Lens(**document.lens.model_dump()),
                sensors=tuple(self._sensor(index, block) for index, block in enumerate(document.sensor)),
                speed_mm_s=document.transport.speed_mm_s,
                binning_along=document.transport.binning_along,
            )
        except PressFileError:
            raise
        except ValueError as error:
            raise PressFileError(self.path, str(error), remedy="change that field") from error
        refuse_unworkable(self.path, camera)
        return camera

    def geometry(self, camera: Camera) -> ScanGeometry:
        """Return how ``camera`` samples a page on this transport."""
        transport = self._document.transport
        return ScanGeometry(
            pixels=camera.sensors[0].pixels,
            pixel_pitch_mm=camera.pixel_pitch_mm,
            line_pitch_mm=camera.line_pitch_mm,
            lead_in_mm=transport.lead_in_mm,
            lead_out_mm=transport.lead_out_mm,
        )

    def _light(self) -> Light:
        block = self._document.light
        if block.file is not None:
            power = self._curve("light.file", block.file)
            if power.max() < LEAST:
                what = f"light.file: {self.path.parent / block.file} holds no light from 380 to 730 nm"
                raise PressFileError(self.path, what, remedy="give its relative power")
            name = Path(block.file).stem
        else:
            name = str(block.illuminant)
            power = _illuminant(self.path, name)
        return Light(name=name, relative_power=power, luminance_cd_m2=block.luminance_cd_m2)

    def _sensor(self, index: int, block: SensorBlock) -> LineSensor:
        where = f"sensor.{index + 1}.quantum_efficiency"
        curve = block.quantum_efficiency
        if curve.file is not None:
            qe = self._curve(where, curve.file)
            if qe.max() > 1:
                what = f"{where}: {self.path.parent / curve.file} goes up to {qe.max():g}"
                raise PressFileError(self.path, what, remedy="give electrons per photon, 0..1")
        else:
            qe = self._on_grid(where, np.array(curve.wave_nm), np.array(curve.qe))
        return LineSensor(**block.model_dump(exclude={"quantum_efficiency"}), quantum_efficiency=qe)

    def _curve(self, where: str, name: str) -> NDArray[np.float64]:
        """Read a two-column file (wavelength nm, value), comma, semicolon, tab or blank between, header lines allowed.

        PressFileError names the line that is neither.
        """
        path = self.path.parent / name
        try:
            text = CURVE_FILES.read_text(path)
        except (OSError, PressFileError) as error:
            why = (
                f" ({error.what.removeprefix('cannot be read: ')})"
                if isinstance(error, PressFileError)
                else ""
            )
            what = f"{where}: {path} cannot be read{why}"
            raise PressFileError(self.path, what, remedy=CURVE_FILES.remedy) from error
        try:
            rows = _pairs(text)
        except ValueError as error:
            raise PressFileError(
                self.path, f"{where}: {path} {error}", remedy="give lines of wavelength [nm] and value"
            ) from None
        table = np.array(rows)
        return self._on_grid(f"{where}: {path}", table[:, 0], table[:, 1])

    def _on_grid(
        self, where: str, wave_nm: NDArray[np.float64], values: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        try:
            return spectra.resample(wave_nm, values)
        except ValueError as error:
            raise PressFileError(
                self.path, f"{where}: {error}", remedy="give values from 380 to 730 nm"
            ) from error


def _pairs(text: str) -> list[tuple[float, float]]:
    """Read the rows of a curve's file; lines before the first number are its header.

    ValueError names the wrong line.
    """
    rows: list[tuple[float, float]] = []
    for at, line in enumerate(text.split("\n"), start=1):
        cells = [
            cell.strip()
            for cell in re.split(r"[;\t]" if re.search(r"[;\t]", line) else r"[,\s]+", line.strip())
        ]
        values = [number(cell) for cell in cells[:2]]
        if not any(cells) or cells[0].startswith("#") or _is_header(cells[0], rows):
            continue
        if len(values) < 2 or np.isnan(values).any():
            message = f"line {at}: {shortly(line.strip())!r} is not a wavelength and a finite value"
            raise ValueError(message)
        wave, value = values
        if rows and wave <= rows[-1][0]:
            message = f"line {at}: {wave:g} nm does not follow {rows[-1][0]:g} nm, wavelengths must increase"
            raise ValueError(message)
        if not 0 < wave <= GREATEST:
            message = f"line {at}: {wave:g} nm is not a wavelength"
            raise ValueError(message)
        if not 0 <= value <= GREATEST:
            message = f"line {at}: {value:g} is not in 0..{GREATEST:g}"
            raise ValueError(message)
        rows.append((wave, value))
    if len(rows) < 2:
        message = "has no two columns of numbers"
        raise ValueError(message)
    return rows


def _is_header(cell: str, rows: list[tuple[float, float]]) -> bool:
    return not rows and not cell[:1].isdecimal() and np.isnan(number(cell))


def _illuminant(path: Path, name: str) -> NDArray[np.float64]:
    illuminants = {"A": "A", "C": "C", "E": "E", "D50": "D50", "D55": "D55", "D65": "D65", "D75": "D75"}
    illuminants |= {f"F{number}": f"FL{number}" for number in range(1, 13)}
    if name not in illuminants:
        what = f"light.illuminant: there is no illuminant {shortly(name)!r}"
        raise PressFileError(path, what, remedy=f"choose one of {', '.join(illuminants)}, or give file")
    return spectra.illuminant(illuminants[name])


def refuse_unworkable(path: Path, camera: Camera) -> None:
    """Refuse a camera of valid numbers that together are too fine, too blurred or too dark to compute.

    It is called before anything is computed; PressFileError names the fields of the press file and valid values.
    """
    _refuse_pitches(path, camera)
    _refuse_blur(path, camera)
    _refuse_large_scans(path, camera)
    _refuse_darkness(path, camera)


def _refuse_pitches(path: Path, camera: Camera) -> None:
    pitch = camera.pixel_pitch_mm
    if not FINEST_MM <= pitch <= COARSEST_MM:
        what = f"a pixel would see {pitch:.3g} mm of the page"
        remedy = (
            "choose lens.focal_length_mm, lens.object_distance_mm and sensor.pixel_pitch_um so that it sees"
            f" {FINEST_MM:g} to {COARSEST_MM:g} mm"
        )
        raise PressFileError(path, what, remedy=remedy)
    if not FINEST_MM <= camera.line_pitch_mm <= COARSEST_MM:
        what = f"lines would be {camera.line_pitch_mm:.3g} mm apart on the page"
        raise PressFileError(path, what, remedy=_line_rate(camera))


def _line_rate(camera: Camera) -> str:
    """Return the setting that would make lines as far apart as pixels are wide."""
    if camera.speed_mm_s is None:
        return "lower transport.binning_along"
    wanted = camera.speed_mm_s / camera.pixel_pitch_mm
    return f"at transport.speed_mm_s = {camera.speed_mm_s:g} give a sensor.line_rate_hz of about {wanted:.4g}"


def _refuse_blur(path: Path, camera: Camera) -> None:
    travel = camera.travel_pixels
    for sensor in camera.sensors:
        blur = camera.binning_along * travel + camera.smear_pixels(sensor)
        if blur > LONGEST_BLUR_PIXELS:
            what = (
                f"a line of sensor {sensor.name} would be smeared over {blur:.4g} pixels: the paper moves by"
                f" {travel:.4g} in a line, sensor.tdi_stages = {sensor.tdi_stages}"
            )
            raise PressFileError(path, what, remedy=_line_rate(camera))


def _refuse_large_scans(path: Path, camera: Camera) -> None:
    lines = math.ceil(_A4_LENGTH_MM / camera.line_pitch_mm)
    pixels = camera.sensors[0].pixels
    size_gb = 2e-9 * len(camera.sensors) * pixels * lines
    if size_gb > LARGEST_SCAN_GB:
        what = f"a scan of an A4 page would take {size_gb:.3g} GB: {lines} lines of {pixels} pixels"
        remedy = f"take fewer sensor.pixels or coarser ones; {LARGEST_SCAN_GB:g} GB are the most"
        raise PressFileError(path, what, remedy=remedy)


def _refuse_darkness(path: Path, camera: Camera) -> None:
    white = camera.irradiance_photons(np.ones(BANDS))
    for sensor in camera.sensors:
        if not sensor.electrons(white) >= _FEWEST_ELECTRONS:
            what = f"sensor {sensor.name} is not sensitive to this light"
            remedy = "raise light.luminance_cd_m2, or give it a quantum_efficiency where the light is"
            raise PressFileError(path, what, remedy=remedy)

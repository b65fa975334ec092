"""The press file (TOML): one press and its camera in a user's words.

Units stand in the names; unknown fields are refused.
"""

from __future__ import annotations

import csv
import difflib
import tomllib
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Self, get_args

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model, model_validator

from prooflight import spectra
from prooflight.acquiring.geometry import ScanGeometry
from prooflight.deciding.cost import RunningCosts
from prooflight.errors import PressFileError
from prooflight.printing.built_in import built_in_inks
from prooflight.printing.chart import read_chart
from prooflight.printing.ink_model import InkModel
from prooflight.sensing.camera import Camera
from prooflight.sensing.light import Light
from prooflight.sensing.optics import Lens
from prooflight.sensing.sensor import LineSensor

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.printing.reflectance import ReflectanceModel

# Strict: text and booleans are no numbers.
Positive = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(strict=True, ge=0, allow_inf_nan=False)]
Share = Annotated[float, Field(strict=True, gt=0, le=1)]
Count = Annotated[int, Field(strict=True, gt=0)]
Range = tuple[Positive, Positive]
TWO_SENSORS: Final = "two-sensors.toml"
"""The paper's camera with its second sensor, among the presets."""


class _Block(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class LightBlock(_Block):
    """``[light]``."""

    illuminant: str | None = None
    file: str | None = None
    luminance_cd_m2: Positive

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.illuminant is None) == (self.file is None):
            message = "needs either illuminant or file"
            raise ValueError(message)
        return self


class LensBlock(_Block):
    """``[lens]``."""

    focal_length_mm: Positive
    f_number: Positive
    transmittance: Share = 1.0
    object_distance_mm: Positive


class QuantumEfficiencyBlock(_Block):
    """``quantum_efficiency = { wave_nm, qe }`` or ``{ file }``."""

    wave_nm: tuple[Positive, ...] | None = None
    qe: tuple[Annotated[float, Field(strict=True, ge=0, le=1)], ...] | None = None
    file: str | None = None

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.file is None) == (self.wave_nm is None) or (self.wave_nm is None) != (self.qe is None):
            message = "needs either wave_nm and qe, or file"
            raise ValueError(message)
        return self


class SensorBlock(_Block):
    """One ``[[sensor]]``."""

    name: Annotated[str, Field(min_length=1)]
    pixels: Annotated[int, Field(strict=True, ge=16, le=65536)]
    pixel_pitch_um: Positive
    fill_factor: Share
    tdi_stages: Count
    line_rate_hz: Positive
    conversion_gain_uv_per_e: Positive
    voltage_swing_v: Positive
    read_noise_e: NotNegative
    dark_current_e_per_s: NotNegative
    dsnu_e: NotNegative
    prnu_percent: NotNegative
    bits: Annotated[int, Field(strict=True, ge=1, le=16)]
    black_level_dn: NotNegative = 0
    quantum_efficiency: QuantumEfficiencyBlock


class TransportBlock(_Block):
    """``[transport]``; lead-in, lead-out and backing are of the simulated drum."""

    speed_mm_s: Positive | None = None
    binning_along: Count = 1
    lead_in_mm: NotNegative = 2.0
    lead_out_mm: NotNegative = 2.0
    backing_reflectance: Share = 0.05
    """assumed: a black anodised or rubber drum."""


class InksBlock(_Block):
    """``[inks]``; absent: the built-in press."""

    chart: str | None = None
    model: str = "auto"


class CostsBlock(_Block):
    """``[costs]``."""

    misprint_rate: Annotated[float, Field(strict=True, gt=0, lt=1)] = 0.01
    false_alarm_cents: Positive = 0.01
    missed_misprint_cents: Positive = 0.1


class DecisionBlock(_Block):
    """``[decision]``."""

    good_pages_per_false_alarm: Annotated[float, Field(strict=True, gt=1, allow_inf_nan=False)] = 100_000.0
    """assumed: a press of 100 pages a minute then stops for nothing about once in two shifts."""


class _Amounts(_Block):
    """A block of amounts; those that are absent are ``worlds.toml``'s."""

    @model_validator(mode="after")
    def _ranges_rise(self) -> Self:
        for name in type(self).model_fields:
            given = getattr(self, name)
            if isinstance(given, tuple) and given[0] > given[1]:
                message = f"{name} must be [least, greatest]"
                raise ValueError(message)
        return self


VARIATION = {
    "page": ("shift_mm", "skew_deg", "scale_percent", "warp_across_um", "warp_along_um"),
    "register": ("plane_um", "plane_clip_um"),
    "ink": (
        "gain_session_percent",
        "gain_print_percent",
        "gain_tilt_percent",
        "dot_gain_percent",
        "halftone_contrast",
    ),
    "paper": (
        "white_percent",
        "white_channel_percent",
        "cloudiness_percent",
        "specks_per_page",
        "specks_ink_percent",
        "specks_diameter_mm",
    ),
    "lamp": ("profile_percent", "profile_print_percent", "flicker_percent"),
    "camera": ("column_gain_percent", "sigma_error", "table_gain_percent", "table_shape_percent"),
}
"""The amounts of ``worlds.toml``'s ``[press.*]``, which ``[variation.*]`` may state anew."""
VARIATION_RANGES = ("specks_ink_percent", "specks_diameter_mm", "sigma_error")
"""Those of them that are [least, greatest]."""


def _variation_block() -> type[_Block]:
    """``[variation]``: ``all_times``, a factor on the amounts that are not given, and the amounts that are."""
    blocks: dict[str, Any] = {"all_times": (NotNegative, 1.0)}
    for block, names in VARIATION.items():
        fields: dict[str, Any] = {
            name: (Range if name in VARIATION_RANGES else NotNegative, None) for name in names
        }
        of_block = create_model(f"Variation{block.title()}Block", __base__=_Amounts, **fields)
        # Under another name inside: ``register`` is also a method of every class of pydantic's.
        blocks[f"of_{block}"] = (of_block, Field(of_block(), alias=block))
    return create_model("VariationBlock", __base__=_Block, **blocks)


VariationBlock = _variation_block()


class _Document(_Block):
    light: LightBlock
    lens: LensBlock
    sensor: Annotated[tuple[SensorBlock, ...], Field(min_length=1)]
    transport: TransportBlock = TransportBlock()
    inks: InksBlock = InksBlock()
    costs: CostsBlock = CostsBlock()
    decision: DecisionBlock = DecisionBlock()
    variation: VariationBlock = VariationBlock()  # type: ignore[valid-type]


class PressFile:
    """A press file that has been read and checked; builds the values that the stages work with."""

    def __init__(self, path: Path, text: str) -> None:
        """``path`` is named in errors and is where relative file names start from."""
        self.path, self.text = path, text
        self._document = _checked(path, text)
        self._inks: ReflectanceModel | None = None

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a file; PressFileError names the field that is wrong and what would be right."""
        try:
            text = path.read_text(encoding="utf-8")
        except OSError as error:
            raise PressFileError(
                path, "cannot be read", remedy="give the path of a press file (TOML)"
            ) from error
        except UnicodeDecodeError as error:
            raise PressFileError(path, "is not text", remedy="give a press file (TOML, UTF-8)") from error
        return cls(path, text)

    @classmethod
    def preset(cls, name: str) -> Self:
        """One that comes with the package."""
        return cls.read(Path(str(resources.files("prooflight").joinpath(name))))

    @classmethod
    def prototype(cls) -> Self:
        """The paper's rig with the built-in inks."""
        text = resources.files("prooflight").joinpath("prototype.toml").read_text(encoding="utf-8")
        return cls(Path("prototype.toml"), text)

    @property
    def name(self) -> str:
        """The press's name: the file's."""
        return self.path.stem

    @property
    def good_pages_per_false_alarm(self) -> float:
        """The promise of ``[decision]``."""
        return self._document.decision.good_pages_per_false_alarm

    @property
    def backing_reflectance(self) -> float:
        """Reflectance of what lies beyond the page, the same at every wavelength. [-]"""
        return self._document.transport.backing_reflectance

    def costs(self) -> RunningCosts:
        """``[costs]``."""
        return RunningCosts(**self._document.costs.model_dump())

    def variation(self) -> dict[str, Any]:
        """``[variation]`` as it stands in the file: only what is given, nested alike, ranges as lists."""
        given: _Block = self._document.variation
        return given.model_dump(mode="json", by_alias=True, exclude_unset=True)

    def inks(self, progress: Callable[[str], None] | None = None) -> ReflectanceModel:
        """``[inks]``: the built-in press where no chart is named. ChartError: the chart cannot be used.

        Fitting takes up to half a minute, so ``progress`` is told what is tried, and the model is kept.
        """
        if self._inks is None:
            block = self._document.inks
            if block.chart is None:
                self._inks = built_in_inks()
            else:
                chart = read_chart(self.path.parent / block.chart)
                self._inks = InkModel.fit(chart, block.model, progress=progress)
        return self._inks

    def camera(self) -> Camera:
        """``[light]``, ``[lens]``, ``[[sensor]]`` and the speed of ``[transport]``."""
        document = self._document
        try:
            return Camera(
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

    def geometry(self, camera: Camera) -> ScanGeometry:
        """How ``camera`` samples a page on this transport."""
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
        else:
            qe = self._on_grid(where, np.array(curve.wave_nm), np.array(curve.qe))
        return LineSensor(**block.model_dump(exclude={"quantum_efficiency"}), quantum_efficiency=qe)

    def _curve(self, where: str, name: str) -> NDArray[np.float64]:
        """A two-column file (wavelength nm, value), comma, tab or blank between, header lines allowed."""
        path = self.path.parent / name
        try:
            text = path.read_text(encoding="utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
            what = f"{where}: {path} cannot be read"
            raise PressFileError(self.path, what, remedy="name a file of wavelengths and values") from error
        rows = []
        for row in csv.reader(" ".join(line.replace(",", " ").split()) for line in text.splitlines()):
            try:
                wave, value = (float(cell) for cell in row[0].split()[:2])
            except (ValueError, IndexError):
                continue
            rows.append((wave, value))
        if len(rows) < 2:
            what = f"{where}: {path} has no two columns of numbers"
            raise PressFileError(self.path, what, remedy="give lines of wavelength [nm] and value")
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


def _illuminant(path: Path, name: str) -> NDArray[np.float64]:
    known = {"A": "A", "C": "C", "E": "E", "D50": "D50", "D55": "D55", "D65": "D65", "D75": "D75"}
    known |= {f"F{number}": f"FL{number}" for number in range(1, 13)}
    if name not in known:
        what = f"light.illuminant: there is no illuminant {name!r}"
        raise PressFileError(path, what, remedy=f"choose one of {', '.join(known)}, or give file")
    return spectra.illuminant(known[name])


def _checked(path: Path, text: str) -> _Document:
    try:
        return _Document.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise PressFileError(path, f"is not TOML ({error})", remedy="mend that line") from error
    except ValidationError as error:
        raise _first_fault(path, error) from error


def _first_fault(path: Path, error: ValidationError) -> PressFileError:
    faults = error.errors()
    if len(faults) > 1:  # a list whose only member is faulty is also called too short
        faults = [fault for fault in faults if fault["type"] != "too_short"]
    # A misspelt field is missing as well: its wrong name says more.
    fault = next((fault for fault in faults if fault["type"] == "extra_forbidden"), faults[0])
    place = [str(part + 1) if isinstance(part, int) else part for part in fault["loc"]]
    field = ".".join(place) or "file"
    others = len(faults) - 1
    more = f" (and {others} more)" if others else ""
    match fault["type"]:
        case "missing":
            return PressFileError(path, f"{field} is missing{more}", remedy="add it")
        case "extra_forbidden":
            names = _names_beside(fault["loc"])
            near = difflib.get_close_matches(str(fault["loc"][-1]), names, n=1)
            meant = f"did you mean {near[0]}?" if near else f"known here: {', '.join(names)}"
            return PressFileError(path, f"{field} is not a known field{more}", remedy=meant)
        case _:
            text = fault["msg"].removeprefix("Value error, ")
            given = "" if isinstance(fault["input"], dict) else f", got {fault['input']!r}"
            return PressFileError(
                path, f"{field}: {text[0].lower()}{text[1:]}{given}{more}", remedy="change that value"
            )


def _names_beside(place: tuple[Any, ...]) -> list[str]:
    """Fields that are allowed where an unknown one stood."""
    block: type[BaseModel] = _Document
    for part in place[:-1]:
        if isinstance(part, str):
            fields = {field.alias or name: field for name, field in block.model_fields.items()}
            block = _block_of(fields[part].annotation)
    return [field.alias or name for name, field in block.model_fields.items()]


def _block_of(annotation: Any) -> type[BaseModel]:
    """The block that a field holds: itself, or each of several."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return _block_of(get_args(annotation)[0])

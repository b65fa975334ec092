"""Schema of a press file (TOML), and the error messages for values that it does not allow."""

from __future__ import annotations

import dataclasses
import difflib
import re
import tomllib
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self, get_args, get_type_hints

from pydantic import (
    BaseModel,
    BeforeValidator,
    Field,
    ValidationError,
    create_model,
    model_validator,
)
from pydantic_core import ArgsKwargs

from prooflight.detectors.cost import FLOOR_SHARE, RunningCosts
from prooflight.errors import PressFileError
from prooflight.files.fields import (
    NO_OTHER_FIELDS,
    Count,
    Lead,
    NotNegative,
    Number,
    Positive,
    Share,
    ShortText,
)
from prooflight.files.given import shortly
from prooflight.pages.pdf.engine import RipEngine
from prooflight.pages.pdf.rip_model import UNSTATED, RipModel
from prooflight.pages.screen import Screen
from prooflight.press.gate import GateSettings
from prooflight.press.outlets import PlantBlock
from prooflight.press.parts import PartsBlock
from prooflight.press.spot_units import MOST_UNITS
from prooflight.scans.camera_settings import CameraSettings
from prooflight.scans.scanner.feeder import FeederPrior

Amount = Annotated[float, Field(strict=True, ge=0, le=1000)]
"""Amount of variation of good prints: per cent, micrometres, millimetres."""
Range = tuple[
    Annotated[float, Field(strict=True, ge=1e-3, le=1000)], Annotated[float, Field(strict=True, le=1000)]
]

LEAST_RIP_DPI, MOST_RIP_DPI = 100, 5080
"""Range of resolutions of a press's RIP: fax to film."""
_DEEPEST = 8
"""Greatest depth of tables in tables: ``[sensor.quantum_efficiency]`` has three levels, with its numbers four."""
_LONG_KEY = re.compile(r"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){32}""")
"""Keys such as ``a.b.c`` of many parts: tomllib takes time and memory in the square of their number."""


UNKNOWN_FIELD = ("extra_forbidden", "unexpected_keyword_argument")
"""Pydantic's kinds of a fault for a field that a block, or a dataclass that is one, does not have."""


class _Block(BaseModel):
    model_config = NO_OTHER_FIELDS


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

    name: Annotated[str, Field(min_length=1, max_length=100)]
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

    @model_validator(mode="after")
    def _black_is_a_code(self) -> Self:
        if self.black_level_dn >= 2**self.bits - 1:
            message = f"black_level_dn must be below the greatest code, {2**self.bits - 1}"
            raise ValueError(message)
        return self


class TransportBlock(_Block):
    """``[transport]``; lead-in, lead-out and backing are of the simulated drum."""

    speed_mm_s: Positive | None = None
    binning_along: Count = 1
    lead_in_mm: Lead = 2.0
    lead_out_mm: Lead = 2.0
    backing_reflectance: Share = 0.05
    """assumed: a black anodised or rubber drum."""


class RipBlock(_Block):
    """``[rip]``: conversion of PDF pages to pixels by the press."""

    dpi: Annotated[float, Field(strict=True, ge=LEAST_RIP_DPI, le=MOST_RIP_DPI)] | None = None
    """Resolution of the press's RIP; None: unknown."""
    engine: Literal["mupdf", "ghostscript", "command"] = "mupdf"
    command: tuple[str, ...] = ()
    fill: Literal["centre", "any-part", "area"] | None = None
    least_line_um: Number | None = None
    offset_um: tuple[Number, ...] | None = None
    offset_sd_um: Number = 0.0
    growth_um: tuple[Number, ...] | None = None
    growth_sd_um: tuple[Number, ...] = (0.0, 0.0, 0.0, 0.0)
    edge_sd_um: Number | None = None

    @model_validator(mode="after")
    def _is_a_rip(self) -> Self:
        RipEngine(name=self.engine, command=self.command)
        model = self.model
        if model.shapes_mupdf and self.engine != "mupdf":
            message = f'fill, least_line_um and offset_um go with engine = "mupdf": {self.engine} draws by its own rule'
            raise ValueError(message)
        if model != UNSTATED and self.dpi is None:
            message = "dpi must be stated with fill, least_line_um, offset_um, growth_um and edge_sd_um"
            raise ValueError(message)
        return self

    @property
    def model(self) -> RipModel:
        """Return the parameters of the RIP; ValueError names the one that can be none."""
        fields: dict[str, Any] = {
            field.name: getattr(self, field.name) for field in dataclasses.fields(RipModel)
        }
        return RipModel(**fields)


class SpotBlock(_Block):
    """One ``[[inks.spot]]``: a unit that prints a spot ink of its own."""

    name: Annotated[str, Field(strict=True, min_length=1, max_length=255)]
    cxf: str | None = None


class InksBlock(_Block):
    """``[inks]``; absent: the built-in press."""

    chart: str | None = None
    model: str = "auto"
    condition: ShortText | None = None
    """Name of the printing condition that inks and paper meet, such as FOGRA51."""
    spot: Annotated[tuple[SpotBlock, ...], Field(max_length=MOST_UNITS)] = ()

    @model_validator(mode="after")
    def _differ(self) -> Self:
        names = [unit.name for unit in self.spot]
        if len(set(names)) < len(names) or not set(names).isdisjoint(NO_SPOTS):
            message = f"spot: names must differ from each other and from {', '.join(NO_SPOTS)}"
            raise ValueError(message)
        return self


NO_SPOTS: Final = ("Cyan", "Magenta", "Yellow", "Black", "All", "None")
"""Names of colorants that are no spot inks (ISO 32000-2, 8.6.6.4)."""


class SubstrateBlock(_Block):
    """``[substrate]``: the paper for which the press was characterised."""

    brand: ShortText | None = None
    weight_gsm: Annotated[float, Field(strict=True, ge=10, le=2000)] | None = None


IN_IDEAL: Final = 100_000.0
"""Good pages per false alarm where they are as predicted.

assumed: a press of 100 pages a minute then stops without cause about once in two shifts.
"""


class DecisionBlock(_Block):
    """``[decision]``."""

    good_pages_per_false_alarm: Annotated[float, Field(strict=True, gt=1, le=1e9)] | None = None
    """Good pages per false alarm.

    None: the matched-filter detector's target is the rate that counts support
    (``training.train.DEFAULT_RATE``), and chi-square's is ``IN_IDEAL``.
    """
    floor_percent_of_white: Annotated[float, Field(strict=True, ge=0, le=100)] = 100 * FLOOR_SHARE
    """Least difference from the expected light of a flat place, over 0.1 mm2, that is always a misprint.

    0: none is.
    """


class InspectionBlock(_Block):
    """``[inspection]``: settings of the matched-filter detector."""

    fringes: Annotated[bool, Field(strict=True)] = True
    """Whether prediction follows planes that share edges.

    Decision 15: at a target false-alarm rate of 1 %, 15 % of misprints are missed without it and 10 % with it.
    """


class _Amounts(_Block):
    """Block of amounts; those that are absent are ``worlds.toml``'s."""

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
"""Amounts of ``worlds.toml``'s ``[press.*]``, which ``[variation.*]`` may override."""
StatedWorld = Literal["press", "measured", "either"]
"""Worlds of which a press may state that its good prints vary as theirs do; either: as in one of the others."""
VARIATION_RANGES = ("specks_ink_percent", "specks_diameter_mm", "sigma_error")
"""Amounts among them that are given as [least, greatest]."""


def _variation_block() -> type[_Block]:
    """Build ``[variation]``: the world, a factor on the amounts that are not given, and the amounts that are."""
    blocks: dict[str, Any] = {
        "world": (StatedWorld, "press"),
        "all_times": (Annotated[float, Field(strict=True, ge=0, le=100)], 1.0),
    }
    for block, names in VARIATION.items():
        fields: dict[str, Any] = {
            name: (Range if name in VARIATION_RANGES else Amount, None) for name in names
        }
        of_block = create_model(f"Variation{block.title()}Block", __base__=_Amounts, **fields)
        # Under another name inside: ``register`` is also a method of every class of pydantic's.
        blocks[f"of_{block}"] = (of_block, Field(of_block(), alias=block))
    return create_model("VariationBlock", __base__=_Block, **blocks)


VariationBlock = _variation_block()


class Document(_Block):
    """Complete press file."""

    light: LightBlock
    lens: LensBlock
    sensor: Annotated[tuple[SensorBlock, ...], Field(min_length=1, max_length=16)]
    transport: TransportBlock = TransportBlock()
    camera: Annotated[
        tuple[CameraSettings, ...],
        BeforeValidator(lambda given: [given] if isinstance(given, dict) else given),
        Field(max_length=16),
    ] = ()
    rip: RipBlock = RipBlock()
    screen: Screen | None = None
    inks: InksBlock = InksBlock()
    substrate: SubstrateBlock = SubstrateBlock()
    costs: RunningCosts = RunningCosts()
    decision: DecisionBlock = DecisionBlock()
    inspection: InspectionBlock = InspectionBlock()
    variation: VariationBlock = VariationBlock()  # type: ignore[valid-type]
    geometry: FeederPrior | None = None
    gate: GateSettings | None = None
    plant: PlantBlock = PlantBlock()
    press: PartsBlock = PartsBlock()

    @model_validator(mode="after")
    def _spots_are_drawn(self) -> Self:
        if self.inks.spot and self.rip.engine != "mupdf":
            message = f'inks.spot goes with rip.engine = "mupdf": {self.rip.engine} mixes spot colours itself'
            raise ValueError(message)
        return self


def checked(path: Path, text: str) -> Document:
    """Return a file's text as a checked document; PressFileError names the wrong field and a valid value."""
    tree = _tree(path, text)
    _refuse_what_no_field_holds(path, tree)
    try:
        return Document.model_validate(tree)
    except ValidationError as error:
        raise _first_fault(path, error, one_camera=isinstance(tree.get("camera"), dict)) from error


def _tree(path: Path, text: str) -> dict[str, Any]:
    key = _LONG_KEY.search(text)
    if key:
        line = text.count("\n", 0, key.start()) + 1
        raise PressFileError(
            path, f"line {line} has a name of more than 32 parts", remedy="correct that line"
        )
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise PressFileError(path, f"is not TOML ({str(error)[:200]})", remedy="correct that line") from error
    except RecursionError:
        raise PressFileError(path, "has lists nested too deeply", remedy="take them out") from None
    except ValueError:  # of int(): more digits than it takes
        what = "has a number of thousands of digits"
        raise PressFileError(path, what, remedy="give a number of ordinary size") from None


def _refuse_what_no_field_holds(path: Path, tree: dict[str, Any]) -> None:
    """Refuse numbers too long and tables too deep: neither can be checked field by field, or even be shown."""
    level: list[tuple[str, Any]] = list(tree.items())
    for _ in range(_DEEPEST):
        for field, value in level:
            if isinstance(value, int) and abs(value) >= 2**63:
                what = f"{shortly(field)} is a number of more than 18 digits"
                raise PressFileError(path, what, remedy="change that value")
        level = [inner for field, value in level for inner in _inside(field, value)]
    if level:
        field = shortly(".".join(level[0][0].split(".")[:2]))
        raise PressFileError(path, f"{field} holds tables in tables", remedy="change that value")


def _inside(field: str, value: Any) -> list[tuple[str, Any]]:
    match value:
        case dict():
            return [(f"{field}.{name}", inner) for name, inner in value.items()]
        case list():
            return [(f"{field}.{at}", inner) for at, inner in enumerate(value, start=1)]
        case _:
            return []


def _first_fault(path: Path, error: ValidationError, *, one_camera: bool) -> PressFileError:
    faults = error.errors()
    if len(faults) > 1:  # a list whose only member is faulty is also called too short
        faults = [fault for fault in faults if fault["type"] != "too_short"]
    # A misspelt field is missing as well: its wrong name says more.
    fault = next((fault for fault in faults if fault["type"] in UNKNOWN_FIELD), faults[0])
    place = [str(part + 1) if isinstance(part, int) else shortly(part) for part in fault["loc"]]
    if one_camera and place[:2] == ["camera", "1"]:
        del place[1]  # ``[camera]`` is a list of one
    field = ".".join(place) or "file"
    others = len(faults) - 1
    more = f" (and {others} more)" if others else ""
    match fault["type"]:
        case "missing":
            return PressFileError(path, f"{field} is missing{more}", remedy="add it")
        case kind if kind in UNKNOWN_FIELD:
            names = _allowed_names(fault["loc"])
            near = difflib.get_close_matches(place[-1], names, n=1)
            meant = f"did you mean {near[0]}?" if near else f"known here: {', '.join(names)}"
            return PressFileError(path, f"{field} is not a known field{more}", remedy=meant)
        case _:
            text = fault["msg"].removeprefix("Value error, ")
            given = (
                ""
                if isinstance(fault["input"], dict | ArgsKwargs)
                else f", got {shortly(repr(fault['input']))}"
            )
            return PressFileError(
                path, f"{field}: {text[0].lower()}{text[1:]}{given}{more}", remedy="change that value"
            )


def _allowed_names(place: tuple[Any, ...]) -> list[str]:
    """Return the names of the fields that are allowed at the place of an unknown one."""
    block: type[Any] = Document
    for part in place[:-1]:
        if isinstance(part, str):
            block = _block_of(_fields_of(block)[part])
    return list(_fields_of(block))


def _fields_of(block: type[Any]) -> dict[str, Any]:
    """Return the annotations of a block's fields, by the names that files give them."""
    if issubclass(block, BaseModel):
        return {field.alias or name: field.annotation for name, field in block.model_fields.items()}
    types = get_type_hints(block)
    return {field.name: types[field.name] for field in dataclasses.fields(block)}


def _block_of(annotation: Any) -> type[Any]:
    """Return the block that a field holds: itself, or each of several."""
    if isinstance(annotation, type) and (
        issubclass(annotation, BaseModel) or dataclasses.is_dataclass(annotation)
    ):
        return annotation
    return _block_of(get_args(annotation)[0])

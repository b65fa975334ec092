"""Simulated worlds in which figures are measured, as ``worlds.toml`` defines them.

``ideal``: a good scan is the expected one plus sensor noise. ``press``: a good print also moves, drifts and
scatters within tolerance, by the amounts of ``[press.*]``, which a press file's ``[variation]`` may override.
``measured``: the same with what public series of real sheets show, as ``measured.toml`` has it: less from sheet to
sheet, more from place to place, and a screen.
"""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Any, Final, Literal, Self, get_args

from prooflight.errors import RequestError
from prooflight.files.given import shortly
from prooflight.pages.screen import Screen

if TYPE_CHECKING:
    from prooflight.press.artefact import Press

World = Literal["ideal", "press", "measured"]
WORLDS: Final[tuple[World, ...]] = get_args(World)
RANGES = ("specks_ink_percent", "specks_diameter_mm")
"""Amounts that describe specks, not an extent of variation: ``all_times`` does not scale them."""


def worlds_text() -> bytes:
    """Return the package's own copy of ``worlds.toml``."""
    return resources.files("prooflight.simulation").joinpath("worlds.toml").read_bytes()


def worlds_digest() -> str:
    """Return the SHA-256 of it; published figures name it."""
    return hashlib.sha256(worlds_text()).hexdigest()


@cache
def worlds() -> dict[str, Any]:
    """Return its content."""
    return tomllib.loads(worlds_text().decode())


def measured_text() -> bytes:
    """Return ``measured.toml``."""
    return resources.files("prooflight.simulation").joinpath("measured.toml").read_bytes()


def measured_digest() -> str:
    """Return the SHA-256 of it; figures of the world ``measured`` name it beside that of ``worlds.toml``."""
    return hashlib.sha256(measured_text()).hexdigest()


@cache
def measured() -> dict[str, Any]:
    """Return its content."""
    return tomllib.loads(measured_text().decode())


def world_named(name: str) -> World:
    """Return ``name``, if there is such a world; RequestError otherwise."""
    for world in WORLDS:
        if name == world:
            return world
    remedy = f"choose {', '.join(WORLDS[:-1])} or {WORLDS[-1]}"
    raise RequestError("world", f"there is no {shortly(name)!r}", remedy=remedy)


@dataclass(frozen=True, slots=True, kw_only=True)
class PageAmounts:
    """``[press.page]``: placement of the page, per print."""

    shift_mm: float
    """Bound of the uniform distribution in x and in y."""
    skew_deg: float
    """Bound of the uniform distribution."""
    scale_percent: float
    """Bound of the uniform distributions across and along, each independent."""
    warp_across_um: float
    warp_along_um: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RegisterAmounts:
    """``[press.register]``: register of each ink plane on the page, per print."""

    plane_um: float
    plane_clip_um: float


@dataclass(frozen=True, slots=True, kw_only=True)
class InkAmounts:
    """``[press.ink]``."""

    gain_session_percent: float
    gain_print_percent: float
    gain_tilt_percent: float
    dot_gain_percent: float
    halftone_contrast: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperAmounts:
    """``[press.paper]``, per print."""

    white_percent: float
    white_channel_percent: float
    cloudiness_percent: float
    specks_per_page: float
    specks_ink_percent: tuple[float, float]
    specks_diameter_mm: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class LampAmounts:
    """``[press.lamp]``."""

    profile_percent: float
    profile_print_percent: float
    flicker_percent: float


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraAmounts:
    """``[press.camera]``, per session."""

    column_gain_percent: float
    sigma_error: tuple[float, float]
    table_gain_percent: float
    table_shape_percent: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetAmounts:
    """``[sheet]`` of ``measured.toml``: what varies from place to place and from sheet to sheet."""

    solid_percent: float
    """Between places, on every sheet alike, of the ink of a solid; of that of a mid-tint ``tint_percent``."""
    tint_percent: float
    zone_share: float
    zone_mm: float
    place_mm: float
    residual_solid_percent: float
    residual_tint_percent: float
    residual_mm: float
    drift_share: float
    drift_sheets: float

    def times(self, factor: float) -> Self:
        """Return the same with ``factor`` times the variation."""
        varying = {name: value * factor for name, value in asdict(self).items() if name.endswith("_percent")}
        return replace(self, **varying)


BLOCKS: Final = {
    "page": PageAmounts,
    "register": RegisterAmounts,
    "ink": InkAmounts,
    "paper": PaperAmounts,
    "lamp": LampAmounts,
    "camera": CameraAmounts,
}
"""Tables of ``[press.*]``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Amounts:
    """Variation of one press's good prints: ``[press.*]``, overridden by a press file's ``[variation]``."""

    page: PageAmounts
    register: RegisterAmounts
    ink: InkAmounts
    paper: PaperAmounts
    lamp: LampAmounts
    camera: CameraAmounts
    sheet: SheetAmounts | None = None
    """What varies from place to place and from sheet to sheet; None: not of this world."""
    screen: Screen | None = None
    """Screen of the prints; None: tints are printed continuously."""

    @classmethod
    def stated(cls, variation: Mapping[str, Any] | None = None, world: World = "press") -> Self:
        """Return a world's amounts, each replaced by ``variation``'s (``PressFile.variation``) where given.

        ``all_times`` multiplies amounts that it does not give; a ratio such as ``sigma_error`` is raised to
        that power.
        """
        given = variation or {}
        times = float(given.get("all_times", 1.0))
        blocks: dict[str, Any] = {}
        seen = measured() if world == "measured" else {}
        for block, kind in BLOCKS.items():
            of_world = worlds()["press"][block] | seen.get(block, {})
            of_file = {name: _times(name, value, times) for name, value in of_world.items()}
            of_press = {
                name: tuple(value) if isinstance(value, list) else value
                for name, value in given.get(block, {}).items()
            }
            blocks[block] = kind(**(of_file | of_press))
        if seen:
            angles = tuple(seen["screen"]["angles_deg"])
            blocks["sheet"] = SheetAmounts(**seen["sheet"]).times(times)
            blocks["screen"] = Screen(**seen["screen"] | {"angles_deg": angles})
        return cls(**blocks)

    @property
    def exact(self) -> bool:
        """Return whether good prints differ in nothing but the camera's noise."""
        amounts = [amount for block in BLOCKS for amount in asdict(getattr(self, block)).items()]
        return self.sheet is None and not any(
            value for name, value in amounts if name not in (*RANGES, "sigma_error")
        )


def amounts_of(press: Press, world: World = "press") -> Amounts:
    """Return the variation of good prints of ``press``: its press file's ``[variation]`` over the world's.

    In the world ``press`` a press varies as it states, in the first of ``stated_amounts``.
    """
    return stated_amounts(press)[0] if world == "press" else Amounts.stated(press.variation, world)


def stated_amounts(press: Press) -> tuple[Amounts, ...]:
    """Return the variation of good prints in each of the worlds that a press states.

    Sheets of the world ``measured`` come without its screen, since the press file says how a press screens.
    """
    measured = replace(Amounts.stated(press.variation, "measured"), screen=None)
    world = press.variation.get("world", "press")
    if world == "measured":
        return (measured,)
    amounts = Amounts.stated(press.variation)
    return (amounts, measured) if world == "either" else (amounts,)


def _times(name: str, value: Any, times: float) -> Any:
    if isinstance(value, list):
        return tuple(value) if name in RANGES else tuple(bound**times for bound in value)
    return value * times


@dataclass(frozen=True, slots=True, kw_only=True)
class Gate:
    """Least change by a misprint.

    A drawn misprint that reaches neither amount has no visible effect and is drawn again.
    """

    blurred_peak_percent: float
    rms_percent: float


def gate() -> Gate:
    """Return ``[gate]``."""
    return Gate(**worlds()["gate"])


def entry(kind: str) -> dict[str, Any]:
    """Return the entry of a kind of misprint."""
    (matching,) = (one for one in worlds()["misprint"] if one["kind"] == kind)
    return dict(matching)


def amount(kind: str, field: str, severity: float) -> float:
    """Return an amount of a misprint kind at severity 0..1: from at_0 to at_1, geometrically unless stated linear."""
    spec = entry(kind)[field]
    low, high = spec["at_0"], spec["at_1"]
    if spec.get("scale") == "linear":
        return float(low + (high - low) * severity)
    return float(low * (high / low) ** severity)

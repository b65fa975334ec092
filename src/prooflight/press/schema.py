"""Schema of a press artefact: every number of its document and of its arrays, checked at save and at load.

Detectors check their own parts (``deciding``), ink models theirs (``ink_schema``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Final, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from prooflight.detectors.cost import RunningCosts
from prooflight.detectors.registry import entry
from prooflight.errors import RequestError
from prooflight.files.ink_schema import check_inks, check_score
from prooflight.files.schema import (
    ArraySpec,
    Block,
    Misfit,
    Name,
    Positive,
    Share,
    check_arrays,
    checked,
    parsed,
    part_of,
)
from prooflight.kernels.prediction.lens_correction import NEAR_REACH
from prooflight.kernels.prediction.lookup import NODES
from prooflight.pages.pdf.engine import RipEngine
from prooflight.pages.pdf.rip_model import RipModel
from prooflight.pages.raster import MM_PER_INCH
from prooflight.pages.screen import Screen
from prooflight.prediction.tables import ClippedShare
from prooflight.press.blocks import LEAST_RIP_DPI, MOST_RIP_DPI, StatedWorld
from prooflight.press.spot_units import SpotUnits
from prooflight.scans.geometry import ScanGeometry

LONGEST_PAGE_MM: Final = 420.0
"""Length of an A3 page, from which the memory for a geometry is estimated. [mm]"""
MOST_SCAN_BYTES: Final = 2 << 30
"""Greatest size of the prediction of such a page: 4 bytes a camera pixel and sensor."""
MOST_RASTER_BYTES: Final = 4 << 30
"""Greatest size of the raster of such a page as wide as the field: 4 bytes a raster pixel."""
FARTHEST: Final = 64.0
"""Greatest reach of a footprint in pixel pitches; built presses have 2 to 6."""
MOST_CODE: Final = 65535
"""Greatest code of 16 bits. [DN]"""
EVEN: Final = 1e-3
"""Tolerance of weights that sum to 1: rounding of float32 comes to 1e-6."""

MODELS: Final = "detectors."
"""Beginning of the names of the tensors of detectors' models; the detector's name follows, and a full stop."""

ModelName = Annotated[str, Field(strict=True, pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$")]
Text = Annotated[str, Field(strict=True, max_length=4_000_000)]
Level = Annotated[float, Field(strict=True, ge=0, le=16 * MOST_CODE, allow_inf_nan=False)]
Variance = Annotated[float, Field(strict=True, gt=0, le=MOST_CODE**2, allow_inf_nan=False)]


class SensorFacts(Block):
    """Fields of a ``SensorModel`` that are not arrays."""

    name: Name
    footprint_reach_mm: Positive
    dark_variance_dn2: Variance
    backing_dn: Level
    backing_variance_dn2: Variance
    top_code_dn: Annotated[int, Field(strict=True, ge=1, le=MOST_CODE)]


class PressFacts(Block):
    """All fields of a press that are not arrays."""

    name: Name
    geometry: ScanGeometry
    sensors: Annotated[tuple[SensorFacts, ...], Field(min_length=1, max_length=16)]
    supersampling: Annotated[int, Field(strict=True, ge=1, le=16)]
    costs: RunningCosts
    good_pages_per_false_alarm: Annotated[float, Field(strict=True, gt=1, le=1e12, allow_inf_nan=False)]
    origin: Annotated[dict[Name, Text], Field(max_length=1000)]
    ink_facts: Annotated[dict[Name, Text], Field(max_length=100)]
    clipped: tuple[ClippedShare, ...]
    variation: dict[Name, Any]
    detectors: Annotated[dict[ModelName, dict[str, Any]], Field(max_length=100)]
    """Models of detectors; each checks its own fields."""
    floor_share: Share
    fringes: Annotated[bool, Field(strict=True)] = False
    rip_engine: RipEngine | None = None
    rip_dpi: Annotated[float, Field(strict=True, ge=LEAST_RIP_DPI, le=MOST_RIP_DPI)] | None = None
    rip_model: RipModel | None = None
    screen: Screen | None = None
    spot_units: SpotUnits | None = None


def check_press(document: str, arrays: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Return the content of ``document``.

    Misfit, with the field's name, unless it and ``arrays`` are a valid press.
    """
    raw = parsed(document)
    facts = checked(PressFacts, raw)
    _check_geometry(facts)
    variation = dict(raw["variation"])
    if variation.pop("world", "press") not in (stated := get_args(StatedWorld)):
        raise Misfit("variation.world", f"must be one of {', '.join(stated)}")
    _check_amounts(variation, "variation")
    if facts.clipped and len(facts.clipped) != len(facts.sensors):
        raise Misfit("clipped", f"is of {len(facts.clipped)} sensors of {len(facts.sensors)}")
    if facts.spot_units is not None and len(facts.spot_units.response_dn) != len(facts.sensors):
        of = len(facts.spot_units.response_dn)
        raise Misfit("spot_units.response_dn", f"is of {of} sensors of {len(facts.sensors)}")
    sizes = {"nodes": NODES, "pixels": facts.geometry.pixels, "neighbours": 2 * NEAR_REACH + 1}
    parts = [f"sensor{index}." for index in range(len(facts.sensors))]
    for sensor, part in zip(facts.sensors, parts, strict=True):
        own = part_of(arrays, part)
        check_arrays(own, SENSOR, sizes, under=part)
        _check_sensor(sensor, own, under=part)
    elsewhere = (*parts, "inks.", MODELS)
    rest = {name: array for name, array in arrays.items() if not name.startswith(elsewhere)}
    check_arrays(rest, {"appearance_srgb": APPEARANCE}, {})
    _check_inks(facts.ink_facts, part_of(arrays, "inks."))
    _check_detectors(facts, raw["detectors"], arrays)
    return dict(raw)


def _check_geometry(facts: PressFacts) -> None:
    at = facts.geometry
    shortest, longest = sorted((at.pixel_pitch_mm, at.line_pitch_mm))
    for index, sensor in enumerate(facts.sensors):
        if not shortest / 2 <= sensor.footprint_reach_mm <= FARTHEST * longest:
            what = f"is {sensor.footprint_reach_mm:g} mm, of pixels {at.pixel_pitch_mm:g} mm apart"
            raise Misfit(f"sensors.{index + 1}.footprint_reach_mm", what)
    length_mm = at.lead_in_mm + LONGEST_PAGE_MM + at.lead_out_mm
    scan = 4 * len(facts.sensors) * at.pixels * math.ceil(length_mm / at.line_pitch_mm)
    pitch_mm = at.pixel_pitch_mm / facts.supersampling
    raster = 4 * at.pixels * facts.supersampling * math.ceil(LONGEST_PAGE_MM / pitch_mm)
    for what, size, most in (("scan", scan, MOST_SCAN_BYTES), ("raster", raster, MOST_RASTER_BYTES)):
        if size > most:
            dpi = MM_PER_INCH / pitch_mm
            demand = f"asks for {size / 2**30:.1f} GiB for the {what} of a page {LONGEST_PAGE_MM:g} mm long"
            raise Misfit("geometry", f"{demand} at {dpi:.0f} dpi, must be {most / 2**30:g} at most")


def _check_amounts(amounts: Any, field: str, depth: int = 0) -> None:
    """Check amounts of ``[variation]``: numbers, [least, greatest], and blocks of them."""
    if isinstance(amounts, dict) and depth < 4:
        for name, amount in amounts.items():
            _check_amounts(amount, f"{field}.{name}", depth + 1)
    elif isinstance(amounts, list) and len(amounts) == 2 and depth < 4:
        for amount in amounts:
            _check_amounts(amount, field, 4)
    elif isinstance(amounts, bool) or not isinstance(amounts, int | float) or not 0 <= amounts <= 1e6:
        raise Misfit(field, f"is {str(amounts)[:40]}, must be an amount of 0 or more, or [least, greatest]")


def _check_sensor(facts: SensorFacts, arrays: Mapping[str, NDArray[Any]], *, under: str) -> None:
    weights = [arrays[f"correction_{name}"] for name in ("near", "far", "farther")]
    if abs(sum(float(each.sum()) for each in weights) - 1) > EVEN:
        raise Misfit(f"{under}correction_near", "must sum to 1, together with far and farther")
    reach = 2 * facts.top_code_dn
    for name in ("mean_dn", "column_offset_dn"):
        most = float(np.abs(arrays[name]).max())
        if most > reach:
            raise Misfit(under + name, f"holds {most:.6g}, must be within {reach} DN of 0")
    white = float(arrays["mean_dn"][0, 0, 0, 0])
    if white <= 0:
        raise Misfit(f"{under}mean_dn", f"gives bare paper {white:.6g} DN, must give it light")
    gain = arrays["column_gain"].astype(np.float64)
    least = facts.dark_variance_dn2 + float(gain.max()) * (
        float(arrays["variance_dn2"].min()) - facts.dark_variance_dn2
    )
    if least <= 0:
        raise Misfit(f"{under}variance_dn2", "is so far below dark_variance_dn2 that columns have none")


def _check_inks(facts: Mapping[str, str], arrays: Mapping[str, NDArray[Any]]) -> None:
    if not arrays:  # of a press that a chart's scans taught
        return
    scored = "score" in facts
    check_inks(facts.get("model", ""), arrays, spread=scored, under="inks.")
    if scored:
        check_score(facts["score"], under="ink_facts.")
    for name, there in (("name", True), ("why", scored), ("chart_digest", scored)):
        if (name in facts) != there:
            raise Misfit(f"ink_facts.{name}", "is missing" if there else "is not known without a score")


def _check_detectors(
    facts: PressFacts, detectors: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> None:
    owned: set[str] = set()
    for name in facts.detectors:
        under = f"{MODELS}{name}."
        owned |= {array for array in arrays if array.startswith(under)}
        try:
            model = entry(name).model
        except RequestError as error:
            raise Misfit(
                f"detectors.{name}", f"is of a detector that is not installed here ({error.what})"
            ) from error
        if model is None:
            raise Misfit(f"detectors.{name}", "is of a detector that needs no training")
        model.check(part_of(arrays, under), detectors[name], sensors=len(facts.sensors), under=under)
    if strange := sorted(name for name in arrays if name.startswith(MODELS) and name not in owned):
        raise Misfit(strange[0], "belongs to a detector that is not described")


def _no_edge(cumulative: NDArray[np.floating]) -> str:
    if cumulative.size < 3 or cumulative.size % 2 == 0:
        return "must be an odd number of values"
    ends = abs(cumulative[0]) < EVEN and abs(cumulative[-1] - 1) < EVEN
    return "" if ends and (np.diff(cumulative) > -EVEN).all() else "must rise from 0 to 1"


def _not_odd(weights: NDArray[np.floating]) -> str:
    return "" if len(weights) % 2 else "must be of an odd number of weights either way"


APPEARANCE: Final = ArraySpec(dtype="uint8", shape=("steps",) * 4 + (3,))
SENSOR: Final = {
    "mean_dn": ArraySpec(dtype="float32", shape=("nodes",) * 4),
    "variance_dn2": ArraySpec(dtype="float32", shape=("nodes",) * 4, above=0, high=MOST_CODE**2),
    "column_offset_dn": ArraySpec(dtype="float32", shape=("pixels",)),
    "column_gain": ArraySpec(dtype="float32", shape=("pixels",), low=1e-3, high=1e3),
    "footprint_across": ArraySpec(dtype="float64", shape=("offsets",), rule=_no_edge),
    "footprint_along": ArraySpec(dtype="float64", shape=("offsets",), rule=_no_edge),
    "correction_near": ArraySpec(dtype="float32", shape=("neighbours", "neighbours"), low=-10, high=10),
    "correction_far": ArraySpec(dtype="float32", shape=("far", "far"), low=-10, high=10, rule=_not_odd),
    "correction_farther": ArraySpec(
        dtype="float32", shape=("farther", "farther"), low=-10, high=10, rule=_not_odd
    ),
}
"""Arrays of one sensor; each sensor has its own extents of footprint and correction."""

"""Press artefact: all data that inspection needs of one press, in one versioned, digested file.

``press_schema`` defines its contents; nothing else is written or read. Schema history:

- 1: geometry, sensors (tables, footprints, columns, backing), appearance, costs, promise, supersampling, origin.
- 2: the inks that it was made from (tensors ``inks.*``, ``ink_facts``) and ``clipped``, where noise is not Gaussian.
- 3: short footprints with their lens corrections (tensors ``correction_*``), and ``variation``.
- 4: the detectors trained for this press (tensors ``ours.*``, ``bayes.*``, and ``detectors``); each may be absent.
- 5: in the matched-filter detector (``ours``), forests that separate each kind of misprint from good pages (tensors
  ``ours.tolerance.kind*``).
- 6: in it, the threshold above which the score that was trained on no misprint decides alone (``outright``). Stored
  only where they differ from the behaviour of earlier presses, so that the digests of those stay: ``fringes``,
  ``rip_dpi``, ``rip_engine``, ``rip_model``, ``screen``, ``spot_units``, and ``prior`` in the matched-filter detector.
- 7: the matched-filter detector is a ranking that was trained once, adapted to the press by its own good pages
  (``ours.values``, ``ours.page_features``, ``ours.own``, ``ours.reference``, ``ours.tolerance.shift`` and ``.scale``).
- 8: reference scores of other presses by the number of pages that adapted the ranking (``ours.reference``,
  ``ours.reference_pages``).
- 9: the same, from statistics of pages that are predicted again at their measured position; scores of schema 8 would
  not fit these.
- 10: in the matched-filter detector, statistics of small windows by class of place (``statistics.marks``), and a screen
  that decides alone; and ``floor_share``.
- 11: the same under other names: any detector's model is stored under the detector's name
  (tensors ``detectors.NAME.*``), the matched-filter detector is ``matched_filter``, and its recalibrations are
  ``labelled``.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import save

from prooflight.artefact import Damaged, Tensors
from prooflight.detectors.base import PressContext
from prooflight.detectors.cost import FLOOR_SHARE, RunningCosts
from prooflight.detectors.optional import FollowsCosts, StatesPrintPrior
from prooflight.detectors.print_prior import PrintPrior
from prooflight.detectors.registry import entry
from prooflight.errors import PressError
from prooflight.files.atomic import whole_file
from prooflight.files.schema import Misfit, part_of
from prooflight.pages.lens_correction import LensCorrection
from prooflight.pages.pdf.engine import RipEngine
from prooflight.pages.pdf.rip_model import UNSTATED, RipModel
from prooflight.pages.sampling import Footprint
from prooflight.pages.screen import Screen
from prooflight.prediction.tables import ClippedShare, SensorModel, node_fractions
from prooflight.press.print_condition import PrintCondition
from prooflight.press.schema import MODELS, check_press
from prooflight.press.spot_units import SpotUnits
from prooflight.scans.geometry import ScanGeometry
from prooflight.shown import Shown

if TYPE_CHECKING:
    from prooflight.detectors.entry import TrainedModel
    from prooflight.pages.pdf.area_averages import InkLight

SCHEMA = 11
KIND = "prooflight press"
TEXTS = frozenset({"kind", "schema", "digest", "document"})
TABLES = ("mean_dn", "variance_dn2", "column_offset_dn", "column_gain")
NUMBERS = ("name", "dark_variance_dn2", "backing_dn", "backing_variance_dn2", "top_code_dn")
CORRECTION = ("near", "far", "farther")
INK_ARRAYS = "inks."
REBUILD = "build it again with `prooflight press build`"

MUPDF: Final = RipEngine()
COSTS_BEFORE: Final = "costs_before"
"""Name in ``Press.origin`` of the digests of presses that differ from this one in their costs alone, the latest first.

It is absent where costs were never changed, so that digests stay."""
MOST_BEFORE: Final = 30
"""Number of such digests that are stored; assumed: labels of runs under earlier costs are too old to count."""
LIGHT_STEPS: Final = 18
"""Steps of ink, 15 bytes apart, so that no ink and full ink are both among them."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Press(Shown):
    """One press with its camera, ready to predict, compare and decide."""

    name: str
    geometry: ScanGeometry
    sensors: tuple[SensorModel, ...]
    supersampling: int
    """Number of raster pixels across one camera pixel at which PDF pages are ripped."""
    appearance_srgb: NDArray[np.uint8]
    """Appearance of recipes at n even steps of each ink, (n, n, n, n, 3) sRGB, paper shown white.

    It is for pictures only.
    """
    costs: RunningCosts
    good_pages_per_false_alarm: float
    """Inverse of the target false-alarm rate: one good page in this number may alarm."""
    floor_share: float = FLOOR_SHARE
    """Least difference from the expected light, as a share of paper white, that is a misprint in flat places.

    0: none is.
    """
    origin: Mapping[str, str] = field(default_factory=dict)
    """Origin of the press: texts, digests, seed."""
    ink_arrays: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    """Arrays of the ink model that the tables were made from.

    ``commissioning.inks`` rebuilds the model from them.
    """
    ink_facts: Mapping[str, str] = field(default_factory=dict)
    """Name, kind and cross-validation score of the ink model."""
    clipped: tuple[ClippedShare, ...] = ()
    """Clipped shares of each sensor; empty where they were not determined."""
    variation: Mapping[str, Any] = field(default_factory=dict)
    """Variation of this press's good prints, as far as it is known, in types that JSON can hold."""
    fringes: bool = False
    """Whether the matched-filter detector predicts planes that share edges at the positions that their fringes show.

    The detector is trained with the same setting.
    """
    rip_dpi: float | None = None
    """Resolution at which the press itself rips PDFs; None: unknown. [pixels/inch]"""
    rip_engine: RipEngine = MUPDF
    """Engine that draws the pages of PDFs: MuPDF, or the one that the press file names."""
    rip_model: RipModel = UNSTATED
    """Parameters of the press's RIP, by which PDFs are drawn in its place."""
    screen: Screen | None = None
    """Screen by which the press prints tints; None: unknown."""
    spot_units: SpotUnits | None = None
    """Units that print spot inks of their own; None: the press prints all colours by its process inks."""
    detectors: Mapping[str, TrainedModel] = field(default_factory=dict)
    """Models of the detectors that were trained for this press, by the detector's name."""

    @property
    def print_condition(self) -> PrintCondition:
        """Return the printing condition and the paper that the press was built for, as far as its file stated them."""
        return PrintCondition.of_origin(self.origin)

    @property
    def dpi(self) -> float:
        """Return the resolution at which PDF pages are ripped for this press. [pixels/inch]"""
        return self.geometry.raster_dpi(self.supersampling)

    @property
    def ink_light(self) -> InkLight:
        """Return the light that each ink absorbs at even steps, printed alone: shares of white, mean over sensors."""
        absorbed, steps = [], np.linspace(0, 1, LIGHT_STEPS)
        for ink in range(4):
            alone = [
                np.moveaxis(one.mean_dn, ink, 0)[:, 0, 0, 0].astype(np.float64) / one.white_dn
                for one in self.sensors
            ]
            along = np.mean(alone, axis=0)
            taken = np.maximum.accumulate(along[0] - np.interp(steps, node_fractions(), along))
            absorbed.append(tuple(taken.tolist()))
        return tuple(absorbed)

    def press_context(self, threads: int | None = None) -> PressContext:
        """Return the part of the press that a detector needs.

        threads: number of threads that one page may use; None: one a core.
        """
        return PressContext(
            name=self.name,
            sensors=self.sensors,
            geometry=self.geometry,
            costs=self.costs,
            fringes=self.fringes,
            floor_share=self.floor_share,
            screen=None if self.screen is None else (self.screen, self.ink_light),
            own_light=None if self.rip_dpi is None else self.ink_light,
            threads=threads,
        )

    @property
    def print_prior(self) -> PrintPrior:
        """Return how good prints vary: as a detector's model states it, else as those of an office-class press do."""
        models = self.detectors.values()
        return next((one.print_prior for one in models if isinstance(one, StatesPrintPrior)), PrintPrior())

    def with_detector(self, name: str, model: TrainedModel) -> Self:
        """Return the press with this model of a detector."""
        origin = {key: text for key, text in self.origin.items() if key != COSTS_BEFORE}
        return replace(self, detectors={**self.detectors, name: model}, origin=origin)

    def with_threshold(self, name: str, model: TrainedModel) -> Self:
        """Return the press with this model of a detector, which differs from its own in the threshold alone."""
        return replace(self, detectors={**self.detectors, name: model})

    def with_costs(self, *, false_alarm_cents: float, missed_misprint_cents: float) -> Self:
        """Return the press with other costs of errors; its scores stay, and thresholds that follow from costs change.

        The rate of misprints stays as well, since detectors were trained by it. ValueError: a cost is not above 0.
        """
        costs = replace(
            self.costs, false_alarm_cents=false_alarm_cents, missed_misprint_cents=missed_misprint_cents
        )
        models = {
            name: model.at_costs(costs) if isinstance(model, FollowsCosts) else model
            for name, model in self.detectors.items()
        }
        before = [self.digest, *self.origin.get(COSTS_BEFORE, "").split()][:MOST_BEFORE]
        return replace(
            self, costs=costs, detectors=models, origin={**self.origin, COSTS_BEFORE: " ".join(before)}
        )

    @property
    def digest(self) -> str:
        """Return the SHA-256 of everything in it; equal digests, equal verdicts."""
        arrays, document = self._parts()
        return _digest(arrays, document)

    @property
    def scored_alike(self) -> frozenset[str]:
        """Return the digests of the presses whose scores are its own: its digest, and those of other costs."""
        return frozenset({self.digest}) | frozenset(self.origin.get(COSTS_BEFORE, "").split())

    def check(self) -> None:
        """Raise PressError, with the field's name, if it holds a value that no artefact may hold."""
        arrays, document = self._parts()
        _checked(f"press {self.name}", document, arrays)

    def save(self, path: str | Path) -> str:
        """Write to ``path``, whole or not at all, and return the digest.

        PressError: ``load`` would refuse it.
        """
        path = Path(path)
        arrays, document = self._parts()
        _checked(path, document, arrays)
        digest = _digest(arrays, document)
        metadata = {"kind": KIND, "schema": str(SCHEMA), "digest": digest, "document": document}
        with whole_file(path) as unfinished:
            unfinished.write_bytes(save(arrays, metadata))
        return digest

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a press artefact.

        PressError if it is none, damaged, of another schema, or holds a value that none may hold.
        """
        path = Path(path)
        if not path.is_file():
            raise PressError(path, "there is no such file", remedy=f"{REBUILD} or give the right path")
        try:
            document, arrays = _read(path)
        except Damaged as error:
            raise PressError(path, "is damaged or not a press artefact", remedy=REBUILD) from error
        except Misfit as error:
            raise PressError(path, str(error), remedy=REBUILD) from error
        return cls._from_parts(arrays, _checked(path, document, arrays))

    def _parts(self) -> tuple[dict[str, NDArray[Any]], str]:
        arrays: dict[str, NDArray[Any]] = {"appearance_srgb": self.appearance_srgb}
        arrays |= {INK_ARRAYS + name: np.ascontiguousarray(array) for name, array in self.ink_arrays.items()}
        for name, model in self.detectors.items():
            under = f"{MODELS}{name}."
            arrays |= {under + of: np.ascontiguousarray(array) for of, array in model.arrays().items()}
        sensors = []
        for index, sensor in enumerate(self.sensors):
            for name in TABLES:
                arrays[f"sensor{index}.{name}"] = np.ascontiguousarray(getattr(sensor, name))
            arrays[f"sensor{index}.footprint_across"] = sensor.footprint.across
            arrays[f"sensor{index}.footprint_along"] = sensor.footprint.along
            for name in CORRECTION:
                arrays[f"sensor{index}.correction_{name}"] = getattr(sensor.correction, name)
            numbers = {name: getattr(sensor, name) for name in NUMBERS}
            sensors.append(numbers | {"footprint_reach_mm": sensor.footprint.reach_mm})
        document = {
            "name": self.name,
            "geometry": asdict(self.geometry),
            "sensors": sensors,
            "supersampling": self.supersampling,
            "costs": asdict(self.costs),
            "good_pages_per_false_alarm": self.good_pages_per_false_alarm,
            "floor_share": self.floor_share,
            "origin": dict(self.origin),
            "ink_facts": dict(self.ink_facts),
            "clipped": [asdict(share) for share in self.clipped],
            "variation": dict(self.variation),
            "detectors": {name: model.facts() for name, model in self.detectors.items()},
        }
        if self.fringes:  # a press that does without is what it was before there was this
            document["fringes"] = True
        if self.rip_dpi is not None:
            document["rip_dpi"] = self.rip_dpi
        if self.rip_engine != MUPDF:
            document["rip_engine"] = asdict(self.rip_engine)
        if self.rip_model != UNSTATED:
            document["rip_model"] = asdict(self.rip_model)
        if self.screen is not None:
            document["screen"] = asdict(self.screen)
        if self.spot_units is not None:
            document["spot_units"] = asdict(self.spot_units)
        return arrays, json.dumps(document, sort_keys=True)

    @classmethod
    def _from_parts(cls, arrays: dict[str, NDArray[Any]], document: dict[str, Any]) -> Self:
        sensors = []
        for index, scalars in enumerate(document["sensors"]):
            of_sensor = f"sensor{index}."
            footprint = Footprint(
                reach_mm=scalars.pop("footprint_reach_mm"),
                across=arrays[of_sensor + "footprint_across"],
                along=arrays[of_sensor + "footprint_along"],
            )
            tables: dict[str, Any] = {name: arrays[of_sensor + name] for name in TABLES}
            correction = LensCorrection(
                **{name: arrays[f"{of_sensor}correction_{name}"] for name in CORRECTION}
            )
            sensors.append(SensorModel(footprint=footprint, correction=correction, **tables, **scalars))
        detectors: dict[str, TrainedModel] = {}
        for name, facts in document["detectors"].items():
            model = entry(name).model
            assert model is not None  # ``check_press`` refuses it
            detectors[name] = model.from_parts(part_of(arrays, f"{MODELS}{name}."), facts)
        return cls(
            name=document["name"],
            geometry=ScanGeometry(**document["geometry"]),
            sensors=tuple(sensors),
            supersampling=document["supersampling"],
            appearance_srgb=arrays["appearance_srgb"],
            costs=RunningCosts(**document["costs"]),
            good_pages_per_false_alarm=document["good_pages_per_false_alarm"],
            floor_share=document["floor_share"],
            origin=document["origin"],
            ink_arrays=part_of(arrays, INK_ARRAYS),
            ink_facts=document["ink_facts"],
            clipped=tuple(ClippedShare(**share) for share in document["clipped"]),
            variation=document["variation"],
            fringes=document.get("fringes", False),
            rip_dpi=document.get("rip_dpi"),
            rip_engine=_engine(document.get("rip_engine")),
            rip_model=RipModel(**_values(document.get("rip_model") or {})),
            screen=Screen(**_values(document["screen"])) if document.get("screen") else None,
            spot_units=SpotUnits.from_plain(document["spot_units"]) if document.get("spot_units") else None,
            detectors=detectors,
        )


def _engine(facts: Mapping[str, Any] | None) -> RipEngine:
    return MUPDF if facts is None else RipEngine(name=facts["name"], command=tuple(facts["command"]))


def _values(facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return fields of a dataclass as JSON has them, lists as tuples."""
    return {name: tuple(value) if isinstance(value, list) else value for name, value in facts.items()}


def _read(path: Path) -> tuple[str, dict[str, NDArray[Any]]]:
    """Read document and arrays whose digest is right, yet unchecked. Damaged, Misfit: see ``Tensors``."""
    file = Tensors(path)
    if file.texts.get("kind") != KIND:
        raise PressError(path, "is not a press artefact", remedy=REBUILD)
    schema = file.texts.get("schema")
    if schema != str(SCHEMA):
        what = f"has schema {schema}, this version reads schema {SCHEMA}"
        raise PressError(path, what, remedy=REBUILD)
    if unknown := sorted(set(file.texts) - TEXTS):
        raise Misfit(unknown[0], "is not known here")
    arrays, document = file.arrays(), file.texts.get("document", "")
    if _digest(arrays, document) != file.texts.get("digest"):
        raise PressError(path, "is damaged: its digest does not match its content", remedy=REBUILD)
    return document, arrays


def _checked(where: object, document: str, arrays: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Return the content of ``document``, after all of it and of ``arrays`` has been checked."""
    try:
        return check_press(document, arrays)
    except Misfit as error:
        raise PressError(where, str(error), remedy=REBUILD) from error


def _digest(arrays: Mapping[str, NDArray[Any]], document: str) -> str:
    sha = hashlib.sha256(document.encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        sha.update(f"{name} {array.dtype} {array.shape}".encode())
        sha.update(array.tobytes())
    return sha.hexdigest()

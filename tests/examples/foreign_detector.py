"""A detector of another package: it is trained, knows zones, follows labels, and tests runs, all by its own means.

It knows of Prooflight the contract alone (``detectors.base``, ``entry`` and ``optional``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

import prooflight as pf
from prooflight.detectors.base import StoredArrays
from prooflight.detectors.entry import DetectorPress, Entry, Training
from prooflight.detectors.false_alarm_rate import Guarantee
from prooflight.detectors.optional import GoodPrint
from prooflight.detectors.verdict import Region
from prooflight.detectors.weighted_conformal import LabelledPages
from prooflight.errors import RequestError
from prooflight.files.schema import Misfit, part_of
from prooflight.pages.zones.zone import Calibration, Kind, PageZones

NAME = "worst_square"
SIDE = 8
FEWEST = 12


@dataclass(frozen=True, kw_only=True, eq=False)
class Model:
    """Scores of good pages of the press, and the threshold above all of them."""

    good: NDArray[np.float64]
    recalibrations: tuple[LabelledPages, ...] = ()

    @property
    def guarantee(self) -> Guarantee:
        if self.recalibrations:
            return Guarantee(
                rate=self.recalibrations[-1].rate,
                simulated=0,
                real=len(self.recalibrations[-1].score),
                label_source="labels",
            )
        return Guarantee(rate=1 / (self.good.size + 1), simulated=self.good.size)

    @property
    def threshold(self) -> float:
        return self.recalibrations[-1].threshold if self.recalibrations else float(self.good.max())

    def recalibrated(self, labelled: LabelledPages) -> Self:
        _ = labelled.threshold  # refused where the pages are too few
        return replace(self, recalibrations=(*self.recalibrations, labelled))

    def before_recalibration(self) -> Self | None:
        return replace(self, recalibrations=self.recalibrations[:-1]) if self.recalibrations else None

    def arrays(self) -> Mapping[str, NDArray[Any]]:
        labels = {
            f"{at}.{n}": a for at, one in enumerate(self.recalibrations) for n, a in one.arrays().items()
        }
        return {"good": self.good, **labels}

    def facts(self) -> Mapping[str, Any]:
        return {"labels": [one.facts() for one in self.recalibrations]}

    @staticmethod
    def check(
        arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any], *, sensors: int, under: str = ""
    ) -> None:
        if "good" not in arrays or not np.isfinite(arrays["good"]).all():
            raise Misfit(f"{under}good", "is missing or not finite")

    @classmethod
    def from_parts(cls, arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]) -> Self:
        labels = [
            LabelledPages.from_parts(part_of(arrays, f"{at}."), of) for at, of in enumerate(facts["labels"])
        ]
        return cls(good=arrays["good"], recalibrations=tuple(labels))


@dataclass(frozen=True, slots=True, kw_only=True)
class WorstSquare(pf.ContextDetector):
    """Alarms where the worst square of 8 x 8 pixels is off by more than on any good page."""

    model: Model
    name: str = NAME

    @property
    def guarantee(self) -> str:
        return str(self.model.guarantee)

    @property
    def false_alarm_rate(self) -> float:
        return self.model.guarantee.rate

    @property
    def zone_kinds(self) -> frozenset[Kind]:
        return frozenset({"ignore", "normal"})

    @property
    def zone_pricing(self) -> Pricing:
        return Pricing(model=self.model)

    def run_test(self, *, seed: int) -> RunTest:
        return RunTest(usual=float(np.median(self.model.good)))

    def prepare(self, planned: pf.PlannedPage) -> Prepared:
        return Prepared(detector=self, planned=planned)

    def decision(self, worst: float) -> pf.Decision:
        limit = self.model.threshold
        return pf.Decision(
            misprint=worst > limit, score=worst, threshold=limit, p_value=None, probability=None
        )

    def decided_again(self, stored: StoredArrays) -> pf.Decision:
        return self.decision(float(stored.array("worst", "f", (), finite=True)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Prepared(pf.PreparedOnly):
    detector: WorstSquare
    planned: pf.PlannedPage

    def inspect(self, scan: pf.Scan, *, seed: int = 0) -> pf.Inspection:
        page, press_context = self.planned.page, self.detector.press_context
        area = press_context.geometry.on_page(page.width_mm, page.height_mm)
        measured, expected = (
            scan.dn[(slice(None), *area)],
            self.planned.expected.expected_dn[(slice(None), *area)],
        )
        off = squares(measured - expected) / press_context.sensors[0].white_dn
        share = np.abs(off).max(axis=0)
        wide_mm, high_mm = (
            SIDE * press_context.geometry.pixel_pitch_mm,
            SIDE * press_context.geometry.line_pitch_mm,
        )
        if (zones := self.planned.zones) is not None:
            share = np.where(ignored(zones, share.shape, (wide_mm, high_mm)), 0.0, share)
        row, column = np.unravel_index(share.argmax(), share.shape)
        worst = float(share.max())
        decision = self.detector.decision(worst)
        at = {"x_mm": column * wide_mm, "y_mm": row * high_mm, "width_mm": wide_mm, "height_mm": high_mm}
        verdict = pf.Verdict.from_decision(
            page.name,
            decision,
            kind="spots-voids" if decision.misprint else None,
            regions=(Region(**at, score=worst, kind="spots-voids"),) if decision.misprint else (),
            shift_mm=(0.0, 0.0),  # it looks for no page, and takes each to lie where it should
            detector=NAME,
            family="worst",
        )
        return pf.Inspection(
            verdict=verdict,
            placement=pf.IN_PLACE,
            area=area,
            measured_dn=measured,
            block_z=off.astype(np.float32),
            expect=lambda: pf.Prediction(expected_dn=expected, variance_dn2=np.ones_like(expected)),
            stored_arrays={"wrong_page": np.array(False), "worst": np.array(worst)},
            summary=np.array([worst]),
        )


def squares(image: NDArray[Any]) -> NDArray[np.float64]:
    """Means over squares of (sensors, lines, pixels)."""
    sensors, lines, pixels = image.shape[0], image.shape[1] // SIDE, image.shape[2] // SIDE
    whole = image[:, : lines * SIDE, : pixels * SIDE].reshape(sensors, lines, SIDE, pixels, SIDE)
    return np.asarray(whole.mean(axis=(2, 4), dtype=np.float64))


def ignored(zones: PageZones, shape: tuple[int, ...], size_mm: tuple[float, float]) -> NDArray[np.bool_]:
    """Squares (rows, columns) whose middle is ignored."""
    x_mm, y_mm = ((np.arange(n) + 0.5) * side for n, side in zip(shape[::-1], size_mm, strict=True))
    return zones.holds("ignore", x_mm, y_mm)


@dataclass(frozen=True, kw_only=True)
class Pricing:
    """Zones are ignored places, so that a good page alarms no more often with them."""

    model: Model

    @property
    def rate(self) -> float:
        return self.model.guarantee.rate

    def fewest_prints(self, careful_share: float) -> int:
        return FEWEST

    def score(self, inspection: pf.Inspection) -> float:
        return float(inspection.stored_arrays["worst"])

    def alarms(self, score: float) -> bool:
        return score > self.model.threshold

    def calibration(self, prints: Sequence[GoodPrint]) -> Calibration:
        scores = tuple(one.after for one in prints)
        return Calibration(page_scores=scores, careful_scores=(), careful_mean=(), careful_sd=())

    def alarmed(
        self, prints: Sequence[GoodPrint], calibration: Calibration, share: float
    ) -> tuple[list[tuple[GoodPrint, bool]], float]:
        return [(one, self.alarms(one.after)) for one in prints], 0.0


@dataclass(kw_only=True)
class RunTest:
    """Suspends the promise once five pages in a row are worse than the median of good ones."""

    usual: float
    strangest: str = "their worst squares"
    remedy: str = "train the press again"
    seen: list[float] = field(default_factory=list)

    def add(self, summary: NDArray[np.float64]) -> None:
        self.seen.append(float(summary[0]))

    @property
    def suspended(self) -> bool:
        return len(self.seen) >= 5 and min(self.seen[-5:]) > self.usual


def train(press: pf.Press, names: Sequence[str], training: Training) -> Mapping[str, Model]:
    """Print as many good pages in the ideal world as asked for."""
    if tuple(names) != (NAME,):
        raise RequestError("detector", f"is {names}", remedy=f"give {NAME}")
    rng = np.random.default_rng(training.seed)
    bare = WorstSquare(press_context=press.press_context(), model=Model(good=np.array([np.inf])))
    scores = []
    for number in training.shown(range(1, training.designs + 1), training.designs, "printing good pages"):
        cmyk = np.zeros((240, 400, 4), np.uint8)
        cmyk[..., 3] = rng.integers(0, 200, (6, 10)).astype(np.uint8).repeat(40, 0).repeat(40, 1)
        page = pf.Page(cmyk=cmyk, dpi=press.dpi / 2, name=f"d{number}", number=number)
        prepared = bare.prepare(pf.PlannedPage(page, press.press_context()))
        scores.append(prepared.inspect(pf.simulate(page, press, seed=number)).stored_arrays["worst"])
    return {NAME: Model(good=np.sort(np.array(scores, np.float64)))}


def detector(press: DetectorPress) -> pf.Detector:
    """Make the detector of a press that holds its model."""
    model = press.detectors[NAME]
    assert isinstance(model, Model)
    return WorstSquare(press_context=press.press_context(), model=model)


ENTRY = Entry(
    detector=detector,
    model=Model,
    train=f"{__name__}:train",
    family_text=lambda family: "the worst square" if family == "worst" else None,
)

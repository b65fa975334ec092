"""Figures of the press study's page from its findings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.rng import stream
from prooflight.simulation.misprints.kinds import KINDS
from prooflight.simulation.worlds import worlds, worlds_digest
from prooflight_studies.harness.operating import bootstrap_cost
from prooflight_studies.harness.paper_detectors import THIRDS, thirds
from prooflight_studies.press.judging import (
    ALPHAS,
    FALSE_ALARM_RATE,
    FOREST_OF_FAMILIES,
    MATCHED_FILTER,
    alarms_by_others,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from prooflight_studies.harness.operating import Interval
    from prooflight_studies.harness.result_cache import Rows
    from prooflight_studies.press.findings import PressFindings
    from prooflight_studies.press.judging import MethodResult

NEAR_MM: Final = 5.0
"""Tolerance of a reported position: greatest distance of its middle from the misprint (assumed: what a person sees)."""
SIGMA_OFF: Final = 1.3
ALARMED: Final = 0.5
REAL_RATE: Final = 0.05
"""Target rate on real pages; for so few pages a lower one would not let more than one exceed the threshold."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Share:
    """A count out of a total."""

    count: int
    of: int

    @classmethod
    def where(cls, alarm: NDArray[np.bool_]) -> Share:
        """Count the true elements."""
        return cls(count=int(alarm.sum()), of=alarm.size)


@dataclass(frozen=True, slots=True, kw_only=True)
class Method:
    """Figures of one method."""

    name: str
    good: int
    bad: int
    costs: list[Interval]
    """Cost c at each of ``ALPHAS``; the counts at these thresholds follow."""
    alarms: list[int]
    missed: list[int]
    promised_alarms: int
    promised_missed: int
    """Good pages that alarm and misprints that are missed at the target rate of 1 %."""
    caught: float
    area: float

    @classmethod
    def of(cls, name: str, one: MethodResult, rng: np.random.Generator) -> Method:
        """Compute the figures of a method; rng: resamples the press days for the intervals."""
        bad = one.scored.bad
        return cls(
            name=name,
            good=int((~bad).sum()),
            bad=int(bad.sum()),
            costs=[
                bootstrap_cost(one.at(alarm), alpha, threshold=ALARMED, rng=rng)
                for alarm, alpha in zip(one.alarms, ALPHAS, strict=True)
            ],
            alarms=[int((alarm & ~bad).sum()) for alarm in one.alarms],
            missed=[int((~alarm & bad).sum()) for alarm in one.alarms],
            promised_alarms=int((one.nominal_alarms & ~bad).sum()),
            promised_missed=int((~one.nominal_alarms & bad).sum()),
            caught=one.caught,
            area=one.area,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class RateRow:
    """A target false-alarm rate and the observed alarms."""

    rate: float
    basis: str
    pages: int
    alarms: int
    caught: Share | None
    """Share of misprints that are caught; None: there were none."""

    @classmethod
    def of(
        cls, rate: float, basis: str, alarms: NDArray[np.bool_], caught: NDArray[np.bool_] | None = None
    ) -> RateRow:
        """Count alarms; alarms: of good pages; caught: alarms of misprints."""
        return cls(
            rate=rate,
            basis=basis,
            pages=alarms.size,
            alarms=int(alarms.sum()),
            caught=None if caught is None else Share.where(caught),
        )


def press_results(findings: PressFindings) -> dict[str, Any]:
    """Return all figures of the page."""
    rows, verdicts, plan = findings.main, findings.verdicts, findings.plan
    matched_filter = verdicts.methods[MATCHED_FILTER]
    rng = stream(plan.seed, "press-bootstrap")
    return {
        "pitch_mm": findings.pitch_mm,
        "fringes": findings.fringes,
        "plan": plan,
        "days": len(np.unique(rows["day"])),
        "unmade": rows["unmade_kind"].size,
        "worlds": worlds_digest(),
        "alphas": ALPHAS,
        "thirds": THIRDS,
        "matched_filter": MATCHED_FILTER,
        "methods": [Method.of(name, one, rng) for name, one in verdicts.methods.items()],
        "forest": FOREST_OF_FAMILIES if FOREST_OF_FAMILIES in verdicts.methods else None,
        "caught": [
            {"at": "the promised 1 %", **_by_severity(rows, matched_filter.nominal_alarms)},
            {"at": "alpha = 1", **_by_severity(rows, matched_filter.alarms[ALPHAS.index(1.0)])},
        ],
        "where": _places_and_kinds(rows, matched_filter.nominal_alarms, verdicts.kinds, verdicts.boxes),
        "promises": list(_rate_rows(findings)),
        "real": None if findings.real is None else _real(findings.real, matched_filter, plan.seed),
        "ideal_days": len(np.unique(findings.ideal.methods[MATCHED_FILTER].scored.day)),
        "ideal": Method.of(
            MATCHED_FILTER, findings.ideal.methods[MATCHED_FILTER], stream(plan.seed, "press-bootstrap-ideal")
        ),
    }


def _by_severity(rows: Rows, alarm: NDArray[np.bool_]) -> dict[str, Any]:
    """Return the misprints caught by kind and severity third."""
    kind = rows["kind"]
    third = thirds(rows["severity"])
    kinds = []
    for one in (*KINDS, "all"):
        here = (kind != "") if one == "all" else (kind == one)
        shares = [Share.where(alarm[here & (third == place)]) for place in range(len(THIRDS))]
        kinds.append({"kind": one, "shares": [*shares, Share.where(alarm[here])]})
    return {"kinds": kinds, "upper": Share.where(alarm[(kind != "") & (third > 0)])}


def _places_and_kinds(
    rows: Rows, alarm: NDArray[np.bool_], kinds: NDArray[np.str_], boxes: NDArray[np.float32]
) -> dict[str, Any]:
    """Return how often position and kind of caught misprints are right."""
    scope = {entry["kind"]: entry["scope"] for entry in worlds()["misprint"]}
    local = np.array([scope.get(kind) == "local" for kind in rows["kind"].tolist()])
    caught = alarm & (rows["kind"] != "")
    right = near(boxes, rows["places"])
    of_kinds = []
    for one in KINDS:
        here = caught & (rows["kind"] == one)
        wrong = kinds[here & (kinds != one)]
        names, count = np.unique(wrong, return_counts=True)
        of_kinds.append(
            {
                "kind": one,
                "place": Share.where(right[here]) if scope[one] == "local" else None,
                "named": Share.where(kinds[here] == one),
                "taken_for": {"kind": names[count.argmax()], "times": count.max()} if wrong.size else None,
            }
        )
    return {
        "near_mm": NEAR_MM,
        "place": Share.where(right[caught & local]),
        "named": Share.where((kinds == rows["kind"])[caught]),
        "kinds": of_kinds,
    }


def near(boxes: NDArray[np.float32], places: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return whether the middle of each box (n, 4) is within ``NEAR_MM`` of one of the places (n, m, 4). [mm]"""
    middle = boxes[:, None, :2] + boxes[:, None, 2:] / 2
    low, high = places[..., :2], places[..., :2] + places[..., 2:]
    with np.errstate(invalid="ignore"):
        off = np.maximum(np.maximum(low - middle, middle - high), 0)
        return np.asarray((np.hypot(off[..., 0], off[..., 1]) <= NEAR_MM).any(axis=1))


def _rate_rows(findings: PressFindings) -> Iterator[RateRow]:
    matched_filter, rows = findings.verdicts.methods[MATCHED_FILTER], findings.main
    good = ~matched_filter.scored.bad
    setting = round(int(good.sum()) / len(np.unique(matched_filter.part))) + findings.plan.promise
    for kept in findings.kept:
        basis = f"{kept.designs} designs that did nothing else"
        yield RateRow.of(kept.rate, basis, kept.alarms[good], kept.alarms[~good])
    for tried in findings.tried:
        basis = f"{tried.designs} designs that did nothing else, tried on others of which only good prints were made"
        yield RateRow.of(tried.rate, basis, tried.alarms)
    basis = f"{setting} designs, these and those of another part"
    yield RateRow.of(
        FALSE_ALARM_RATE, basis, matched_filter.nominal_alarms[good], matched_filter.nominal_alarms[~good]
    )
    off = (np.abs(np.log(rows["sigma_error"])) > np.log(SIGMA_OFF)).any(axis=1)
    about = f"{SIGMA_OFF - 1:.0%}"
    yield RateRow.of(
        FALSE_ALARM_RATE,
        f"the same, a sensor's sigma wrong by more than {about}",
        matched_filter.nominal_alarms[good & off],
    )
    yield RateRow.of(
        FALSE_ALARM_RATE,
        f"the same, all sigmas right within {about}",
        matched_filter.nominal_alarms[good & ~off],
    )
    for what, alarms in findings.looser.items():
        yield RateRow.of(FALSE_ALARM_RATE, what, alarms)


def _real(real: MethodResult, matched_filter: MethodResult, seed: int) -> dict[str, Any]:
    """Return the figures of real pages and of composed ones, and the alarms of real pages calibrated on each other."""
    rng = stream(seed, "press-bootstrap-real")
    bad = real.scored.bad
    rate = max(REAL_RATE, 1.01 / int((~bad).sum()))
    alarms = alarms_by_others(real.scored, rate)
    return {
        "pages": len(np.unique(real.scored.design)),
        "methods": [
            Method.of(name, one, rng) for name, one in (("real", real), ("composed", matched_filter))
        ],
        "rate": rate,
        "days": len(np.unique(real.scored.day)),
        "alarms": int(alarms[~bad].sum()),
        "missed": int((~alarms[bad]).sum()),
    }

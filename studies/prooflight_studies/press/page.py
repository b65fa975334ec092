"""The page of results of the press study, ``press.md`` or ``press-without-fringes.md``: what it found, in tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy import special

from prooflight.detectors.operating import at_threshold, bootstrap_cost, false_alarms_in_words
from prooflight.rng import stream
from prooflight.simulation.misprints.kinds import KINDS
from prooflight.simulation.worlds import worlds, worlds_digest
from prooflight_studies.press.judging import (
    ALPHAS,
    FALSE_ALARM_RATE,
    FOREST_OF_FAMILIES,
    OURS,
    promised_by_others,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from prooflight_studies.harness.result_cache import Rows
    from prooflight_studies.press.findings import PressFindings
    from prooflight_studies.press.judging import MethodResult, Verdicts

THIRDS: Final = ("mild", "middle", "severe")
NEAR_MM: Final = 5.0
"""A place that is said lies right if its middle is no further from the misprint (assumed: what a person sees)."""
SIGMA_OFF: Final = 1.3
ALARMED: Final = 0.5
REAL_PROMISE: Final = 0.05
"""What so few real pages can promise with more than one of them above the threshold."""


def page_lines(found: PressFindings) -> Iterator[str]:
    """The whole page."""
    rows, verdicts, plan = found.main, found.verdicts, found.plan
    ours = verdicts.methods[OURS]
    good, bad = int((~ours.scored.bad).sum()), int(ours.scored.bad.sum())
    yield "# Our detector in the press world"
    yield ""
    yield (
        f"Camera pixels of {found.pitch_mm:.3f} mm, two sensors; {plan.designs} composed designs on "
        f"{len(np.unique(rows['day']))} press days: {good} good prints and {bad} misprints, kinds in turn, severity "
        f"even from 0 to 1. The days are cut into five parts. Each is judged by a detector that three others taught, "
        f"together with {plan.teaching} designs that are not judged, of {plan.teaching_misprints} misprints each, and "
        f"with {plan.learning} designs that were only printed well. "
        f"Thresholds are set by the fifth and by {plan.promise} good prints of designs that do nothing else. Nothing "
        f"that a page is judged by has seen its design or its day. How statistics scatter was learned from "
        f"{plan.pilot} further designs. `worlds.toml` {worlds_digest()[:12]}, seed {plan.seed}. "
        f"{rows['unmade_kind'].size} misprints stayed below the gate in nine draws and were left out. 95 % intervals "
        f"over designs. Never alarming costs alpha."
    )
    yield ""
    if found.fringes:
        yield (
            "Planes that share edges are found by their fringes, and predicted where they lie. Without: "
            "[press-without-fringes.md](press-without-fringes.md)."
        )
    else:
        yield (
            "The press file has `[inspection] fringes = false`: planes that share edges are predicted where "
            "registration finds them. All else is as with: [press.md](press.md)."
        )
    yield ""
    yield "The paper's detectors and the usual ones, raw and registered, on such pages: [paper.md](paper.md)."
    yield ""
    yield from _methods(verdicts, stream(plan.seed, "press-bootstrap"))
    yield from _by_severity(rows, ours)
    yield from _places_and_kinds("composed designs", rows, ours.promised, verdicts.kinds, verdicts.boxes)
    yield from _promises(found)
    yield from _others(found)


def _methods(verdicts: Verdicts, rng: np.random.Generator) -> Iterator[str]:
    yield "## Costs"
    yield ""
    yield (
        "| method | "
        + " | ".join(f"c({alpha:g})" for alpha in ALPHAS)
        + " | caught at promised 1 % | F there "
        "| caught at F = 1 % (oracle) | AUC |"
    )
    yield "|---" * (len(ALPHAS) + 5) + "|"
    for name, one in verdicts.methods.items():
        cells = []
        for row, alpha in enumerate(ALPHAS):
            cost = bootstrap_cost(one.at(one.alarms[row]), alpha, threshold=ALARMED, rng=rng)
            cells.append(f"{cost.value:.3f} [{cost.low:.3f}-{cost.high:.3f}]")
        rates = at_threshold(one.at(one.promised), ALARMED)
        cells += [
            f"{1 - rates.misses:.1%}",
            f"{rates.false_alarms:.1%}",
            f"{one.caught:.1%}",
            f"{one.area:.4f}",
        ]
        yield f"| {name} | " + " | ".join(cells) + " |"
    yield ""
    compared = f"Rows that begin with *forest* are to be compared with *{FOREST_OF_FAMILIES}*. "
    yield (
        compared if FOREST_OF_FAMILIES in verdicts.methods else ""
    ) + "The oracle's column is the mean over parts."
    yield ""


def _thirds(severity: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.minimum((severity * len(THIRDS)).astype(np.int64), len(THIRDS) - 1)


def _by_severity(rows: Rows, ours: MethodResult) -> Iterator[str]:
    """Caught by kind and severity third, at the promise and at the least cost."""
    kind, third = rows["kind"], _thirds(rows["severity"])
    for title, alarm in (
        ("at the promised 1 %", ours.promised),
        ("at alpha = 1", ours.alarms[ALPHAS.index(1.0)]),
    ):
        yield f"## Caught {title}"
        yield ""
        yield "| kind | " + " | ".join(THIRDS) + " | all |"
        yield "|---" * (len(THIRDS) + 2) + "|"
        for one in (*KINDS, "all"):
            here = (kind != "") if one == "all" else (kind == one)
            cells = [_share(alarm[here & (third == place)]) for place in range(len(THIRDS))]
            yield f"| {one} | " + " | ".join([*cells, _share(alarm[here])]) + " |"
        upper = (kind != "") & (third > 0)
        yield ""
        yield f"Of the upper two thirds of severity: {_share(alarm[upper])}."
        yield ""


def _share(alarm: NDArray[np.bool_]) -> str:
    return f"{alarm.mean():.0%} ({alarm.size})" if alarm.size else "-"


def _places_and_kinds(
    of: str, rows: Rows, alarm: NDArray[np.bool_], kinds: NDArray[np.str_], boxes: NDArray[np.float32]
) -> Iterator[str]:
    scope = {entry["kind"]: entry["scope"] for entry in worlds()["misprint"]}
    local = np.array([scope.get(kind) == "local" for kind in rows["kind"].tolist()])
    caught = alarm & (rows["kind"] != "")
    right = near(boxes, rows["places"])
    yield f"## Where and what, {of}"
    yield ""
    yield (
        f"Of the misprints caught at the promised 1 %: the place lies right for {_share(right[caught & local])} of the "
        f"local ones (its middle within {NEAR_MM:g} mm of one of the misprint's places), the kind is right for "
        f"{_share((kinds == rows['kind'])[caught])}."
    )
    yield ""
    yield "| kind | place right | kind right | most often taken for |"
    yield "|---|---|---|---|"
    for one in KINDS:
        here = caught & (rows["kind"] == one)
        wrong = kinds[here & (kinds != one)]
        names, count = np.unique(wrong, return_counts=True)
        taken = f"{names[count.argmax()]} ({count.max()})" if wrong.size else "-"
        place = _share(right[here]) if scope[one] == "local" else "-"
        yield f"| {one} | {place} | {_share(kinds[here] == one)} | {taken} |"
    yield ""


def near(boxes: NDArray[np.float32], places: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Whether the middle of each box (n, 4) lies within ``NEAR_MM`` of one of the places (n, m, 4). [mm]"""
    middle = boxes[:, None, :2] + boxes[:, None, 2:] / 2
    low, high = places[..., :2], places[..., :2] + places[..., 2:]
    with np.errstate(invalid="ignore"):
        off = np.maximum(np.maximum(low - middle, middle - high), 0)
        return np.asarray((np.hypot(off[..., 0], off[..., 1]) <= NEAR_MM).any(axis=1))


def _promises(found: PressFindings) -> Iterator[str]:
    ours, rows = found.verdicts.methods[OURS], found.main
    good = ~ours.scored.bad
    setting = round(int(good.sum()) / len(np.unique(ours.part))) + found.plan.promise
    yield "## What was promised, and what came"
    yield ""
    yield "In brackets: what the rate lies below with 95 % certainty."
    yield ""
    yield "| promised | on what | good pages judged | false alarms | rate | misprints caught |"
    yield "|---|---|---|---|---|---|"
    for kept in found.kept:
        basis = f"{kept.designs} designs that did nothing else"
        yield _promise(f"{100 * kept.rate:.3g} %", basis, kept.alarms[good], kept.alarms[~good])
    for tried in found.tried:
        basis = f"{tried.designs} designs that did nothing else, tried on others of which only good prints were made"
        yield _promise(f"{100 * tried.rate:.3g} %", basis, tried.alarms)
    basis = f"{setting} designs, these and those of another part"
    yield _promise("1 %", basis, ours.promised[good], ours.promised[~good])
    off = (np.abs(np.log(rows["sigma_error"])) > np.log(SIGMA_OFF)).any(axis=1)
    about = f"{SIGMA_OFF - 1:.0%}"
    yield _promise("1 %", f"the same, a sensor's sigma wrong by more than {about}", ours.promised[good & off])
    yield _promise("1 %", f"the same, all sigmas right within {about}", ours.promised[good & ~off])
    for what, alarms in found.looser.items():
        yield _promise("1 %", what, alarms)
    yield ""


def _promise(
    rate: str, basis: str, alarms: NDArray[np.bool_], caught: NDArray[np.bool_] | None = None
) -> str:
    """The rate with the upper end of its exact 95 % interval (Clopper and Pearson 1934, one-sided)."""
    count, pages = int(alarms.sum()), max(alarms.size, 1)
    most = float(special.betaincinv(count + 1, pages - count, 0.95)) if count < pages else 1.0
    share = "-" if caught is None else f"{caught.mean():.1%}"
    return f"| {rate} | {basis} | {pages} | {count} | {count / pages:.2%} (< {most:.2%}) | {share} |"


def _others(found: PressFindings) -> Iterator[str]:
    if found.real is not None:
        yield from _real(found)
    yield "## The ideal world, one sensor"
    yield ""
    ours = found.ideal.methods[OURS]
    rng = stream(found.plan.seed, "press-bootstrap-ideal")
    good = int((~ours.scored.bad).sum())
    alarms = [int((alarm & ~ours.scored.bad).sum()) for alarm in ours.alarms]
    yield f"{good} good scans, {int(ours.scored.bad.sum())} misprints; parts as above."
    yield ""
    yield "| | " + " | ".join(f"alpha = {alpha:g}" for alpha in ALPHAS) + " |"
    yield "|---" * (len(ALPHAS) + 1) + "|"
    costs: list[Any] = [
        bootstrap_cost(ours.at(alarm), alpha, threshold=ALARMED, rng=rng)
        for alarm, alpha in zip(ours.alarms, ALPHAS, strict=True)
    ]
    yield "| c | " + " | ".join(f"{c.value:.4f} [{c.low:.4f}-{c.high:.4f}]" for c in costs) + " |"
    misses = [at_threshold(ours.at(alarm), ALARMED).misses for alarm in ours.alarms]
    yield "| M | " + " | ".join(f"{miss:.2%}" for miss in misses) + " |"
    yield "| F | " + " | ".join(false_alarms_in_words(count, good) for count in alarms) + " |"
    yield ""


def _real(found: PressFindings) -> Iterator[str]:
    real = found.real
    assert real is not None
    rng = stream(found.plan.seed, "press-bootstrap-real")
    yield "## Real pages"
    yield ""
    yield (
        f"{len(np.unique(real.scored.design))} pages of real documents, judged by the first part's detector and "
        f"thresholds, beside the composed designs."
    )
    yield ""
    yield (
        "| pages | "
        + " | ".join(f"c({alpha:g})" for alpha in ALPHAS)
        + " | caught at promised 1 % | F there | AUC |"
    )
    yield "|---" * (len(ALPHAS) + 4) + "|"
    for name, one in (("real", real), ("composed", found.verdicts.methods[OURS])):
        cells = []
        for row, alpha in enumerate(ALPHAS):
            cost = bootstrap_cost(one.at(one.alarms[row]), alpha, threshold=ALARMED, rng=rng)
            cells.append(f"{cost.value:.3f} [{cost.low:.3f}-{cost.high:.3f}]")
        rates = at_threshold(one.at(one.promised), ALARMED)
        good = int((~one.scored.bad).sum())
        cells += [f"{1 - rates.misses:.1%}", f"{rates.false_alarms:.1%} of {good}", f"{one.area:.4f}"]
        yield f"| {name} | " + " | ".join(cells) + " |"
    yield ""
    bad = real.scored.bad
    rate = max(REAL_PROMISE, 1.01 / int((~bad).sum()))
    alarms = promised_by_others(real.scored, rate)
    yield (
        f"Designs composed to teach promise little for pages unlike them. Where each page meets the threshold that the "
        f"other {int((~bad).sum()) - 1} real pages set at {rate:.0%}, {alarms[~bad].mean():.1%} of good ones alarm and "
        f"{alarms[bad].mean():.1%} of {int(bad.sum())} misprints are caught."
    )
    yield ""


__all__ = ["FALSE_ALARM_RATE", "near", "page_lines"]

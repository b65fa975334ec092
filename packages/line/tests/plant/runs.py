"""Records, outcomes and events as runs have them."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import numpy as np

from prooflight.detectors.verdict import Ink, Region, Verdict
from prooflight_line.journal.records import PageRecord, RunFacts
from prooflight_line.plant.events import Event, Noticed
from prooflight_line.run.monitor.run import PageEvidence
from prooflight_line.run.outcomes import Outcome

if TYPE_CHECKING:
    from collections.abc import Callable

FACTS = RunFacts(
    job="brochure.pdf",
    job_digest="",
    press="rig",
    press_digest="",
    detector="matched_filter",
    source="drum:5",
    started_s=0.0,
    sheets=2000,
)
GOOD = Verdict(page="p0001", verdict="good", detector="matched_filter", score=1.0, threshold=3.0)
STREAK = Region(x_mm=119.5, y_mm=0.0, width_mm=1.0, height_mm=297.0, score=9.0, kind="streak")
MISPRINT = Verdict(
    page="p0002",
    verdict="misprint",
    kind="streak",
    regions=(STREAK,),
    reason="streak at x = 120 mm in black",
    detector="matched_filter",
    score=7.5,
    threshold=3.0,
    probability=0.99,
    shift_mm=(0.12, -0.04),
    inks={"K": Ink(gain_percent=1.5, dot_gain_percent=0.2, register_mm=(0.03, -0.02))},
)


def record(sheet: int, verdict: Verdict = GOOD, **told: Any) -> PageRecord:
    facts: dict[str, Any] = {"job_page": sheet, "late": False, "first_line": 100 * sheet, "time_s": sheet / 5}
    return PageRecord(sheet=sheet, verdict=verdict, **(facts | told))


def outcome(sheet: int, verdict: Verdict = GOOD, *, came: bool = True, **told: Any) -> Outcome:
    return Outcome(
        record=record(sheet, verdict, **told), evidence=PageEvidence(), came=came, latency_s=0.0123
    )


def event(number: int, text: str = "") -> Event:
    body = Noticed(kind="silent", text=text or f"event {number}")
    return Event(stream="s", number=number, time_s=1e9 + number, press="rig", run=3, body=body)


LONGEST_S = 120.0
"""After which what a test waits for will not come; a busy machine takes half a minute to start a server."""
REASONS = "", "streak at x = 120 mm", '<Comment> & "quotes" \u00e4\u00f6 ]]>', "line\nbreak", "x" * 900
KINDS = (
    *("missing-plane", "swapped-planes", "density", "plane-register", "streak", "banding", "spots-voids"),
    *("ghost-smear", "local-blur", "missing-content", "wrong-page", "scum", "unknown", "of somebody's own"),
)


def random_outcome(sheet: int, rng: np.random.Generator) -> Outcome:
    """Anything that a run may say of a sheet."""

    def number() -> float | None:
        drawn = [None, 0.0, -1.5, 1e-300, 1e9, float(rng.normal(scale=30))]
        return drawn[int(rng.integers(len(drawn)))]

    word = ("good", "misprint", "not-inspected")[int(rng.integers(3))]
    kinds = [KINDS[int(k)] for k in rng.integers(len(KINDS), size=int(rng.integers(6)))]
    regions = tuple(
        Region.rounded(
            tuple(float(v) for v in rng.uniform(0, 300, 4)), score=float(rng.uniform(0, 99)), kind=kind
        )
        for kind in kinds
    )
    inks = {
        letter: Ink(
            gain_percent=float(rng.normal()),
            dot_gain_percent=0.0,
            register_mm=(float(rng.normal()), float(rng.normal())),
        )
        for letter in "CMYK"[: int(rng.integers(5))]
    }
    reason = REASONS[int(rng.integers(len(REASONS)))]
    verdict = Verdict(
        page=f"p{sheet:04}",
        verdict=word,
        kind=kinds[0] if kinds and word == "misprint" else None,
        regions=regions if word == "misprint" else (),
        inks=inks,
        reason=reason,
        score=number(),
        threshold=number(),
        probability=number() and 0.5,
        shift_mm=None if rng.random() < 0.5 else (float(rng.normal()), float(rng.normal())),
        detector="matched_filter" if word != "not-inspected" else "",
    )
    faults = (("lost-lines",), (), ("missing",))[int(rng.integers(3))]
    return outcome(
        sheet, verdict, late=bool(rng.random() < 0.1), faults=faults, came=bool(rng.random() < 0.9)
    )


class Heard:
    """Collects what is told, and lets a test wait for it."""

    def __init__(self) -> None:
        self.all: list[Any] = []
        self._changed = threading.Condition()

    def __call__(self, told: Any) -> None:
        with self._changed:
            self.all.append(told)
            self._changed.notify_all()

    def until(self, enough: Callable[[list[Any]], bool], within_s: float = LONGEST_S) -> list[Any]:
        """All that has been told, as soon as it is enough; nothing never is."""
        with self._changed:
            assert self._changed.wait_for(lambda: bool(self.all) and enough(self.all), within_s), self.all
            return list(self.all)

    def count(self, number: int) -> list[Any]:
        return self.until(lambda told: len(told) >= number)

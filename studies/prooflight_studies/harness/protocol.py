"""The sampling plan of the studies: disjoint page designs and press days to learn, to tune and to test.

A study is a list of ``Day`` pieces; each is a press day with some page designs, of which good copies and misprints are
printed, scanned and measured. Rows depend on the plan and its seed alone, not on the process that computes them or on
their order.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.camera.sensor import ROUNDING_DN2
from prooflight.prediction.predict import Prediction
from prooflight.registration.register import prepare, register
from prooflight.rng import stream
from prooflight.simulation.captures import Printed, SimulatedDay
from prooflight.simulation.misprints.kinds import KINDS
from prooflight.simulation.session import true_sensors
from prooflight.simulation.worlds import World, world_named, worlds_digest
from prooflight_studies.harness.baselines import VariationModel, variation_moments
from prooflight_studies.harness.measures import measure
from prooflight_studies.harness.result_cache import digest_of, run_pieces
from prooflight_studies.harness.versions import ALGORITHMS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.pages.parallel import Processes
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.registration.register import Landmarks
    from prooflight.simulation.corpus.corpus import Designs
    from prooflight_studies.harness.result_cache import Rows

JUDGED: Final = ("learn", "tune", "test")
SETS: Final = ("pilot", *JUDGED)
"""Names of the sets. The variation model is trained on the pilot's good copies; the others are named by their use."""
OTHERS: Final = 3
"""Number of designs of the same day that a wrong page may come from."""
FRAMES: Final[dict[World, tuple[str, ...]]] = {
    "ideal": ("raw",),
    "press": ("raw", "registered"),
    "measured": ("raw", "registered"),
}
"""Predictions that scans are compared with: of a page at its nominal position, or at its registered position."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """Numbers of designs, copies and days."""

    seed: int
    world: World
    pilot: int
    learn: int
    tune: int
    test: int
    good_copies: int = 1
    misprints: int = 2
    """Number of copies of each design with a misprint; kinds take turns."""
    designs_per_day: int = 10
    noises: tuple[float, ...] = (1.0,)
    """Factors on the camera's temporal sigma at which every print is scanned; baselines see the first alone."""

    def designs(self, of: str) -> range:
        """Return the numbers of the designs of a set; no design is in two sets."""
        counts = [int(getattr(self, name)) for name in SETS]
        place = SETS.index(of)
        return range(sum(counts[:place]), sum(counts[: place + 1]))

    def kind(self, index: int, copy: int) -> str:
        """Return the kind of misprint of a copy of design ``index``; the first copies are good, ""."""
        turn = index * self.misprints + copy - self.good_copies
        return KINDS[turn % len(KINDS)] if copy >= self.good_copies else ""

    def days(self, *sets: str) -> list[Day]:
        """Return the pieces of these sets; a day belongs to one set alone."""
        return [day for of in sets for day in in_days(of, self.designs(of), self.designs_per_day)]

    def day_of(self, of: str, designs: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the press days, named by their first designs, of some designs of a set; both (n,)."""
        first = self.designs(of).start
        return first + (designs - first) // self.designs_per_day * self.designs_per_day

    def facts(self, press: Press, source: str) -> dict[str, Any]:
        """Return everything that rows depend on; source: which page designs."""
        of_press = {"press": press.digest, "worlds": worlds_digest(), "designs": source}
        return asdict(self) | of_press | {"algorithms": dict(ALGORITHMS)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Day:
    """A press day and the designs printed on it."""

    of: str
    designs: tuple[int, ...]


def in_days(of: str, designs: Sequence[int], per_day: int) -> list[Day]:
    """Divide the designs of a set into press days of ``per_day`` designs; the last may have fewer."""
    return [
        Day(of=of, designs=tuple(designs[start : start + per_day]))
        for start in range(0, len(designs), per_day)
    ]


def in_both_worlds(ideal: Plan, *, world: str | None, **in_press: Any) -> list[Plan]:
    """Return a plan of the ideal world, and the same in the press world with these numbers changed.

    world: one alone. RequestError: there is no such world.
    """
    plans = [ideal, replace(ideal, world="press", **in_press)]
    return [plan for plan in plans if world is None or plan.world == world_named(world)]


@dataclass(frozen=True, slots=True, kw_only=True)
class PilotWork:
    """Measurement of good copies of the pilot's designs, from which variation models learn."""

    press: Press
    pages: Designs
    plan: Plan

    def __call__(self, day: Day, /) -> Rows:
        """Return the rows of a day: ``moments`` (designs, frames, 4, 4)."""
        bench = Bench.of(day, self.press, self.pages, self.plan)
        white = bench.white_dn
        moments = []
        for index in day.designs:
            rng = stream(self.plan.seed, "pilot-print", index)
            design = bench.design(index)
            noise = self.plan.noises[0]
            scan = bench.day.recorded(noisier(bench.day, bench.day.seen(design.good, rng), noise), rng)
            moments.append(
                [
                    variation_moments(measured, seen.expected_dn, seen.variance_dn2, white_dn=white, rng=rng)
                    for measured, seen in bench.compared(design, scan, noise)
                ]
            )
        return {"moments": np.array(moments)}


def rows_of_copies(
    bench: Bench,
    day: Day,
    plan: Plan,
    measured: Callable[[Bench, Design, Printed, int, np.random.Generator], Iterator[dict[str, Any]]],
) -> Rows:
    """Return the rows of all copies of a day's designs, and ``unmade_kind`` of misprints that could not be made.

    measured: yields the rows of one print of a design, whose number in the plan it is given.
    """
    columns: dict[str, list[Any]] = defaultdict(list)
    unmade: list[str] = []
    for index in day.designs:
        design = bench.design(index)
        for copy in range(plan.good_copies + plan.misprints):
            rng = stream(plan.seed, "study-print", index, copy)
            kind = plan.kind(index, copy)
            printed = bench.printed(design.good, kind, day, index, rng)
            if printed is None:
                unmade.append(kind)
                continue
            for row in measured(bench, design, printed, index, rng):
                for name, value in row.items():
                    columns[name].append(value)
    rows = {name: np.array(values) for name, values in columns.items()}
    return rows | {"kind": rows["kind"].astype("U16"), "unmade_kind": np.array(unmade, "U16")}


def variation_models(rows: Rows) -> tuple[VariationModel, ...]:
    """Return one model for each frame, from the pilot's rows."""
    return tuple(VariationModel.learn(list(of_frame)) for of_frame in rows["moments"].swapaxes(0, 1))


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchWork:
    """Measurement of a day's good copies and misprints, with a row for each scan.

    Columns: design, kind ("" where good), severity, draws, noise, and those of ``measures.measure`` with frames as
    their first axis; baselines at the first noise alone. Column ``unmade_kind`` has an entry for each misprint of which
    nine draws did not reach the least effect that counts.
    """

    press: Press
    pages: Designs
    plan: Plan
    variations: tuple[VariationModel, ...]

    def __call__(self, day: Day, /) -> Rows:
        """Return the rows of a day."""
        return rows_of_copies(Bench.of(day, self.press, self.pages, self.plan), day, self.plan, self._rows)

    def _rows(
        self, bench: Bench, design: Design, printed: Printed, index: int, rng: np.random.Generator
    ) -> Iterator[dict[str, Any]]:
        seen = bench.day.seen(printed, rng)
        for noise in self.plan.noises:
            scan = bench.day.recorded(noisier(bench.day, seen, noise), rng)
            of_frames = [
                measure(
                    measured,
                    expected,
                    top_codes_dn=bench.top_codes_dn,
                    white_dn=bench.white_dn,
                    variation=variation if noise == self.plan.noises[0] else None,
                    seed=index,
                )
                for (measured, expected), variation in zip(
                    bench.compared(design, scan, noise), self.variations, strict=True
                )
            ]
            facts = {"design": index, "kind": printed.kind, "severity": printed.severity}
            measured_as = {name: np.stack([row[name] for row in of_frames]) for name in of_frames[0]}
            yield facts | {"draws": printed.draws, "noise": noise} | measured_as


def watched_rows(
    press: Press,
    pages: Designs,
    plan: Plan,
    cache: Path,
    *,
    processes: Processes,
    progress_of: Callable[[str], Callable[[int, int], None]],
) -> Rows:
    """Return a plan's rows of ``WatchWork``, of the days to learn, tune and test.

    cache: folder of these rows and the pilot's. progress_of: returns the progress callback of a step, ``pilot`` or
    ``scans``, which is called with the number of days done and of all days. Others: as for ``run_pieces``.
    """
    digest = digest_of(plan.facts(press, repr(pages)))
    pilot = run_pieces(
        PilotWork(press=press, pages=pages, plan=plan),
        plan.days("pilot"),
        cache / "pilot",
        digest=digest,
        processes=processes,
        progress=progress_of("pilot"),
    )
    return run_pieces(
        WatchWork(press=press, pages=pages, plan=plan, variations=variation_models(pilot)),
        plan.days(*JUDGED),
        cache / "rows",
        digest=digest,
        processes=processes,
        progress=progress_of("scans"),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Design:
    """A page with its expected signal and the landmarks to register it."""

    good: Printed
    landmarks: Landmarks | None
    """None in the ideal world, where pages are at their nominal position."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bench:
    """A press day with its page designs."""

    day: SimulatedDay
    pages: Designs

    @classmethod
    def of(cls, day: Day, press: Press, pages: Designs, plan: Plan) -> Bench:
        """Begin a press day."""
        # Days are seeded by their set and first design, so that no day is in two sets.
        rng = stream(plan.seed, "study-session", SETS.index(day.of), day.designs[0])
        return cls(day=SimulatedDay.begin(plan.world, press, rng), pages=pages)

    @property
    def white_dn(self) -> list[float]:
        """Signal of bare paper of each sensor. [DN]"""
        return [sensor.white_dn for sensor in self.day.press.sensors]

    @property
    def top_codes_dn(self) -> list[int]:
        """Greatest digital number of each sensor. [DN]"""
        return [sensor.top_code_dn for sensor in self.day.press.sensors]

    def placed_page(self, index: int) -> Page:
        """Return a design as it enters the press."""
        return self.day.press.geometry.lay(self.pages.page(index))

    def design(self, index: int) -> Design:
        """Return a design's good print with the landmarks to register it."""
        press, good = self.day.press, self.day.good(self.placed_page(index))
        if self.day.session is None:
            return Design(good=good, landmarks=None)
        landmarks = prepare(good.page, good.expected, sensors=press.sensors, geometry=press.geometry)
        return Design(good=good, landmarks=landmarks)

    def printed(
        self, good: Printed, kind: str, day: Day, index: int, rng: np.random.Generator
    ) -> Printed | None:
        """Return the good print of design ``index``, or one with a misprint.

        Returns None if no draw of the misprint has the least effect that counts.
        """
        if not kind:
            return good
        others = rng.permutation([other for other in day.designs if other != index])[:OTHERS].tolist()
        return self.day.wrong(good, kind, others=others, fetch=self.placed_page, rng=rng)

    def area(self, page: Page) -> tuple[slice, slice, slice]:
        """Return the slices of a scan that show the page."""
        return slice(None), *self.day.press.geometry.on_page(page.width_mm, page.height_mm)

    def compared(
        self, design: Design, scan: NDArray[np.uint16], noise: float = 1.0
    ) -> Iterator[tuple[NDArray[np.uint16], Prediction]]:
        """Yield the page's area of a scan and of its prediction, one pair for each frame."""
        page, expected = design.good.page, design.good.expected
        area = self.area(page)
        measured = np.ascontiguousarray(scan[area])
        yield measured, on_area(noisier_tables(expected, noise), area)
        if design.landmarks is not None:
            registration = register(design.landmarks, scan)
            if registration.located:
                expected = self.day.expected(page, registration.placement)
            yield measured, on_area(noisier_tables(expected, noise), area)


def on_area(seen: Prediction, area: tuple[slice, slice, slice]) -> Prediction:
    """Return one area of a prediction, each of its arrays contiguous in memory."""
    expected, variance = (np.ascontiguousarray(a[area]) for a in (seen.expected_dn, seen.variance_dn2))
    return Prediction(expected_dn=expected, variance_dn2=variance)


def noisier(day: SimulatedDay, seen: Prediction, times: float) -> Prediction:
    """Return what ``day.seen`` gives for a camera of ``times`` the temporal sigma (shot, dark and read together).

    Rounding, fixed patterns and all effects of printing stay as they are.
    """
    if day.session is None or times == 1:
        return noisier_tables(seen, times)
    variance = seen.variance_dn2.copy()
    for index, sensor in enumerate(true_sensors(day.session, day.press)):
        light = seen.expected_dn[index] - sensor.model.column_offset_dn
        steps = np.linspace(0, sensor.noise_top_dn, sensor.noise_dn2.size)
        variance[index] += (times**2 - 1) * np.interp(light, steps, sensor.noise_dn2)
    return replace(seen, variance_dn2=variance)


def noisier_tables(expected: Prediction, times: float) -> Prediction:
    """Return the prediction of tables that were made for ``times`` the temporal sigma; rounding stays as it is."""
    if times == 1:
        return expected
    rounding = np.float32(ROUNDING_DN2)
    return replace(
        expected, variance_dn2=(expected.variance_dn2 - rounding) * np.float32(times**2) + rounding
    )

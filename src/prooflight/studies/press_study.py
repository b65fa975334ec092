"""Our detector in the press world, with and without each of its parts; writes ``press.md``. It resumes."""

from __future__ import annotations

import time
from collections import defaultdict
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.atomic import whole_file
from prooflight.commissioning.build import build_press
from prooflight.commissioning.learn import Pages, learn_scatter, learn_tolerance, promised
from prooflight.deciding.families import all_said, samples
from prooflight.deciding.operating import (
    Scored,
    area_under_roc,
    at_threshold,
    bootstrap_cost,
    caught_at,
    least_cost,
)
from prooflight.deciding.tolerance import look, prepare_page, ranked_columns, stated
from prooflight.press import Press
from prooflight.simulating.misprints import KINDS, draw_misprint
from prooflight.simulating.scans import TRIES, passes_gate
from prooflight.simulating.worlds import gate, worlds_digest
from prooflight.studies.captures import Printed, Room
from prooflight.studies.corpus import Corpus
from prooflight.studies.paper_study import REDUCED_PITCH_MM, SPECIMEN_SEED, at_pitch
from prooflight.studies.protocol import OTHERS, SETS, Day, Plan
from prooflight.studies.shards import digest_of, run_pieces

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from prooflight.comparing.local_evidence import Scatter
    from prooflight.deciding.tolerance import PreparedPage, TolerancePress
    from prooflight.pages.raster import Page
    from prooflight.press_file import PressFile
    from prooflight.simulating.misprints import Misprint
    from prooflight.studies.corpus import Designs
    from prooflight.studies.shards import Rows

SCHEMA: Final = 1
"""Of the rows; a change of what is measured makes kept results void."""
ALPHAS: Final = (0.1, 1.0, 10.0)
PROMISE: Final = 0.01
THIRDS: Final = ("mild", "middle", "severe")


def press_plan(*, seed: int, quick: bool) -> Plan:
    """How many designs, copies and days."""
    if quick:
        return Plan(
            seed=seed, world="press", pilot=10, learn=40, tune=30, test=40, good_copies=1, misprints=2
        )
    return Plan(
        seed=seed, world="press", pilot=40, learn=1000, tune=1500, test=1500, good_copies=1, misprints=2
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PressDay:
    """A press day with its page designs at hand."""

    room: Room
    pages: Designs

    @classmethod
    def of(cls, day: Day, press: Path, pages: Designs, plan: Plan) -> PressDay:
        """Days are seeded by their set and first design, so that no day is in two sets."""
        rng = np.random.default_rng([plan.seed, SETS.index(day.of), day.designs[0], 0, 2])
        return cls(room=Room.enter("press", _press(press), rng), pages=pages)

    def laid(self, index: int) -> Page:
        """A design as it enters the press."""
        return self.room.press.geometry.lay(self.pages.page(index))

    def design(self, index: int) -> tuple[Printed, PreparedPage]:
        """A good print of a design, and what is known of it ahead."""
        press, good = self.room.press, self.room.good(self.laid(index))
        known = prepare_page(good.page, good.expected, sensors=press.sensors, geometry=press.geometry)
        return good, known

    def wrong(
        self, good: Printed, kind: str, others: list[int], rng: np.random.Generator
    ) -> tuple[Printed, Misprint] | None:
        """A misprint that passes the gate, with its place; None if nine draws do not."""
        for draw in range(1, TRIES + 1):
            drawn = draw_misprint(
                good.page, kind, float(rng.random()), others=others, fetch=self.laid, rng=rng
            )
            changed = self.room.expected(drawn.page, drawn.placement)
            if passes_gate(good.expected, changed, self.room.press, gate()):
                printed = Printed(
                    page=drawn.page,
                    expected=changed,
                    placement=drawn.placement,
                    kind=kind,
                    severity=drawn.misprint.severity,
                    draws=draw,
                )
                return printed, drawn.misprint
        return None


@dataclass(frozen=True, slots=True, kw_only=True)
class ScatterWork:
    """Good copies of the pilot's designs -> what ``learn_scatter`` learns from."""

    press: Path
    pages: Designs
    plan: Plan

    def __call__(self, day: Day, /) -> Rows:
        """``Work``: draws by name, (designs, ...)."""
        bench = PressDay.of(day, self.press, self.pages, self.plan)
        press = bench.room.press
        drawn: dict[str, list[Any]] = defaultdict(list)
        for index in day.designs:
            rng = np.random.default_rng([self.plan.seed, index, 0, 2])
            good, known = bench.design(index)
            scan = bench.room.recorded(bench.room.seen(good, rng), rng)
            looked = look(known, scan, sensors=press.sensors, geometry=press.geometry)
            for name, values in samples(looked.sums, rng).items():
                drawn[name].append(values)
        return {name: np.stack(values) for name, values in drawn.items()}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SaidWork:
    """Good copies and misprints of a day's designs -> what each scan says, a row each.

    Columns: design, kind ("" where good), severity, draws, values (statistics,), boxes (statistics, 4) [mm], portrait,
    region (4,) of the misprint [mm]. Beside them ``unmade_kind``, one for each that nine draws did not
    make, and ``names`` of the statistics.
    """

    press: Path
    pages: Designs
    plan: Plan
    scatter: Scatter

    def __call__(self, day: Day, /) -> Rows:
        """``Work``."""
        bench = PressDay.of(day, self.press, self.pages, self.plan)
        columns: dict[str, list[Any]] = defaultdict(list)
        unmade: list[str] = []
        names: list[str] = []
        for index in day.designs:
            good, known = bench.design(index)
            for copy in range(self.plan.good_copies + self.plan.misprints):
                rng = np.random.default_rng([self.plan.seed, index, 1 + copy, 2])
                printed, region = good, (np.nan,) * 4
                kind = self._kind(index, copy)
                if kind:
                    others = [other for other in day.designs if other != index]
                    made = bench.wrong(good, kind, rng.permutation(others)[:OTHERS].tolist(), rng)
                    if made is None:
                        unmade.append(kind)
                        continue
                    printed, region = made[0], made[1].region_mm
                row = self._row(bench, known, printed, rng)
                names = row.pop("names")
                row |= {"design": index, "kind": printed.kind, "severity": printed.severity}
                row |= {"draws": printed.draws, "region": np.array(region)}
                for name, value in row.items():
                    columns[name].append(value)
        rows = {name: np.array(values) for name, values in columns.items()}
        beside = {"unmade_kind": np.array(unmade, "U16"), "names": np.array(names, "U32")}
        return rows | {"kind": rows["kind"].astype("U16")} | beside

    def _kind(self, index: int, copy: int) -> str:
        turn = index * self.plan.misprints + copy - self.plan.good_copies
        # Kinds take turns, and every round begins one further on: a design's number must not decide its kinds.
        return KINDS[(turn + turn // len(KINDS)) % len(KINDS)] if copy >= self.plan.good_copies else ""

    def _row(
        self, bench: PressDay, known: PreparedPage, printed: Printed, rng: np.random.Generator
    ) -> dict[str, Any]:
        press = bench.room.press
        scan = bench.room.recorded(bench.room.seen(printed, rng), rng)
        looked = look(known, scan, sensors=press.sensors, geometry=press.geometry)
        said = all_said(looked.sums, looked.fit, looked.found, self.scatter)
        boxes = np.array([one.box for one in said], np.float32)
        return {
            "values": stated(said),
            "boxes": boxes,
            "portrait": known.portrait,
            "names": [one.name for one in said],
        }


def run_press_study(
    press_file: PressFile,
    results: Path,
    *,
    cache: Path,
    seed: int = 1,
    quick: bool = False,
    processes: int | None = None,
    plan: Plan | None = None,
    pitch_mm: float = REDUCED_PITCH_MM,
    progress: Callable[[str], None] = lambda _step: None,
) -> dict[str, Scored]:
    """Scan, learn, tune, test, and write ``press.md`` into ``results``; the test pages' scores by method."""
    started = time.perf_counter()
    plan = plan or press_plan(seed=seed, quick=quick)
    press = build_press(at_pitch(press_file, pitch_mm), seed=SPECIMEN_SEED)
    path = cache / f"{press.digest[:16]}.press"
    if not path.exists():
        press.save(path)
    designs = Corpus(seed=plan.seed, dpi=press.dpi)
    facts = asdict(plan) | {
        "press": press.digest,
        "worlds": worlds_digest(),
        "designs": repr(designs),
        "schema": SCHEMA,
    }
    digest = digest_of(facts)

    def told(what: str) -> Callable[[int, int], None]:
        return lambda done, of: progress(f"{what}: {done} of {of} press days")

    drawn = run_pieces(
        ScatterWork(press=path, pages=designs, plan=plan),
        plan.days("pilot"),
        cache / "scatter",
        digest=digest,
        processes=processes,
        progress=told("pilot"),
    )
    scatter = learn_scatter({name: _pooled(values) for name, values in drawn.items()})
    rows = run_pieces(
        SaidWork(press=path, pages=designs, plan=plan, scatter=scatter),
        plan.days("learn", "tune", "test"),
        cache / "said",
        digest=digest,
        processes=processes,
        progress=told("scans"),
    )
    scores = methods(rows, plan, scatter)
    text = "\n".join(page_lines(rows, plan, scores, pitch_mm=pitch_mm))
    with whole_file(results / "press.md") as unfinished:
        unfinished.write_text(text + "\n", encoding="utf-8")
    progress(f"done in {(time.perf_counter() - started) / 60:.0f} minutes")
    return {name: test for name, (_, test) in scores.items()}


def _pooled(values: NDArray[np.floating]) -> NDArray[np.floating]:
    """Draws (designs, ..., n, 3) -> (..., designs x n, 3)."""
    moved = np.moveaxis(values, 0, -3)
    return moved.reshape(*moved.shape[:-3], -1, 3)


def pages_of(rows: Rows, designs: range) -> Pages:
    """The rows of a set of designs."""
    kept = (rows["design"] >= designs.start) & (rows["design"] < designs.stop)
    return Pages(
        values=rows["values"][kept],
        portraits=rows["portrait"][kept],
        design=rows["design"][kept],
        bad=rows["kind"][kept] != "",
    )


def methods(rows: Rows, plan: Plan, scatter: Scatter) -> dict[str, tuple[Scored, Scored]]:
    """Scores of the tuning and the test pages by method: ours, and without its parts."""
    names = rows["names"][: rows["values"].shape[1]].tolist()
    learn, tune, test = (pages_of(rows, plan.designs(of)) for of in ("learn", "tune", "test"))
    rng = np.random.default_rng([plan.seed, 3])
    found = learn_tolerance(learn, names=names, scatter=scatter, rng=rng)
    scores: dict[str, tuple[Scored, Scored]] = {}
    for name, rank in _rankings(found).items():
        scores[name] = tuple(  # type: ignore[assignment]
            Scored(score=rank(pages), bad=pages.bad, design=pages.design) for pages in (tune, test)
        )
    for family in ("box", "apart", "spread", "streak", "band", "ghost", "fit", "place", "energy"):
        left = np.array([not name.startswith(family + "/") for name in names])
        fewer = learn_tolerance(
            replace(learn, values=learn.values[:, left]),
            names=[name for name, keep in zip(names, left, strict=True) if keep],
            scatter=scatter,
            rng=np.random.default_rng([plan.seed, 3]),
        )
        scores[f"without {family}"] = tuple(  # type: ignore[assignment]
            Scored(
                score=fewer.score(pages.values[:, left], pages.portraits), bad=pages.bad, design=pages.design
            )
            for pages in (tune, test)
        )
    return scores


def _rankings(found: TolerancePress) -> dict[str, Callable[[Pages], NDArray[np.float64]]]:
    def parts(pages: Pages) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        deviations = found.deviations(pages.values, pages.portraits)
        return deviations, found.family_evidence(deviations)

    def trees(pages: Pages) -> NDArray[np.float64]:
        assert found.trees is not None
        deviations, _ = parts(pages)
        return found.trees.score(ranked_columns(pages.values, deviations, pages.portraits))

    def family_trees(pages: Pages) -> NDArray[np.float64]:
        assert found.family_trees is not None
        return found.family_trees.score(parts(pages)[1])

    return {
        "ours": lambda pages: found.score(pages.values, pages.portraits),
        "no misprint seen in learning": lambda pages: found.guard(parts(pages)[1]),
        "ranking by statistics alone": trees,
        "ranking by families alone": family_trees,
    }


def page_lines(
    rows: Rows, plan: Plan, scores: dict[str, tuple[Scored, Scored]], *, pitch_mm: float
) -> Iterator[str]:
    """``press.md``."""
    yield "# Our detector in the press world"
    yield ""
    good, bad = (int((scores["ours"][1].bad == wrong).sum()) for wrong in (False, True))
    yield (
        f"Camera pixels of {pitch_mm:.3f} mm, {plan.learn} designs to learn from, {plan.tune} to set thresholds, "
        f"{plan.test} to test on ({good} good prints, {bad} misprints), {plan.designs_per_day} designs a press day, no "
        f"design and no day in two sets; `worlds.toml` {worlds_digest()[:12]}, seed {plan.seed}. c with thresholds "
        f"from the tuning designs, 95 % intervals over designs. {rows['unmade_kind'].size} misprints stayed below "
        f"the gate in {TRIES} draws and were left out."
    )
    yield ""
    yield "| method | " + " | ".join(f"c({alpha:g})" for alpha in ALPHAS) + " | caught at 1 % | AUC |"
    yield "|---" * (len(ALPHAS) + 3) + "|"
    rng = np.random.default_rng([plan.seed, 4])
    for name, (tune, test) in scores.items():
        cells = []
        for alpha in ALPHAS:
            threshold = least_cost(tune, alpha).threshold
            cost = bootstrap_cost(test, alpha, threshold=threshold, rng=rng)
            cells.append(f"{cost.value:.3f} [{cost.low:.3f}-{cost.high:.3f}]")
        caught = at_threshold(test, _threshold_at(tune, PROMISE))
        cells += [
            f"{1 - caught.misses:.1%} (F {caught.false_alarms:.1%}; oracle {caught_at(test, PROMISE):.1%})",
            f"{area_under_roc(test):.4f}",
        ]
        yield f"| {name} | " + " | ".join(cells) + " |"
    yield ""
    yield from _misses(rows, plan, scores["ours"])


def _threshold_at(pages: Scored, rate: float) -> float:
    return float(np.quantile(pages.score[~pages.bad], 1 - rate))


def _misses(rows: Rows, plan: Plan, ours: tuple[Scored, Scored]) -> Iterator[str]:
    """Caught at the tuning designs' 1 % by kind and severity third."""
    tune, test = ours
    designs = plan.designs("test")
    kept = (rows["design"] >= designs.start) & (rows["design"] < designs.stop)
    kind, severity = rows["kind"][kept], rows["severity"][kept]
    alarm = test.score > _threshold_at(tune, PROMISE)
    yield "Misprints caught at 1 % false alarms (number of misprints):"
    yield ""
    yield "| kind | " + " | ".join(THIRDS) + " |"
    yield "|---" * (len(THIRDS) + 1) + "|"
    for one in KINDS:
        cells = []
        for third in range(len(THIRDS)):
            here = (kind == one) & (np.minimum((severity * 3).astype(int), 2) == third)
            cells.append(f"{alarm[here].mean():.0%} ({here.sum()})" if here.any() else "-")
        yield f"| {one} | " + " | ".join(cells) + " |"


@lru_cache(maxsize=2)
def _press(path: Path) -> Press:
    return Press.load(path)


__all__ = ["PressDay", "SaidWork", "ScatterWork", "methods", "press_plan", "promised", "run_press_study"]

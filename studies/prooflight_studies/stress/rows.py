"""Rows of stress: good prints under every nuisance, and every misprint, each with the same good print without."""

from __future__ import annotations

import hashlib
import tomllib
from collections import defaultdict
from copy import deepcopy
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np

from prooflight.camera.sensor import ROUNDING_DN2
from prooflight.errors import RequestError
from prooflight.files.given import GivenFiles, shortly
from prooflight.files.schema import Block, Misfit, checked
from prooflight.prediction.predict import Prediction
from prooflight.rng import stream
from prooflight.scans.placement import IN_PLACE, Placement
from prooflight.simulation.captures import Printed, SimulatedDay
from prooflight.simulation.corpus.corpus import Corpus
from prooflight.simulation.fast import fast_mean_variance
from prooflight.simulation.prints import Print, composed
from prooflight_studies.harness.print_statistics import scan_row
from prooflight_studies.harness.protocol import OTHERS
from prooflight_studies.stress.marks import MARKS, draw_mark
from prooflight_studies.stress.nuisances import NUISANCES, Passing

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.commissioning.training.simulated_days import PressDay
    from prooflight.detectors.matched_filter.design import PreparedPage
    from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.press.press_file import PressFile
    from prooflight_studies.harness.print_statistics import Scene
    from prooflight_studies.harness.protocol import Day
    from prooflight_studies.harness.result_cache import Rows
    from prooflight_studies.stress.marks import Compose, Digit, Mark
    from prooflight_studies.stress.nuisances import Nuisance

    Kind = TypeVar("Kind", bound=Block)

COPY = 0
"""Copy number: every row of a design is of the same print."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StressWork:
    """Measurement of a day's designs: a good copy, the same under nuisances, and the same with misprints, a row each.

    All designs of a day are in memory at once: 0.16 GB each at a pitch of 0.254 mm and two sensors.

    Columns: design, kind (of the misprint, with its variant; "" where good), severity, nuisance ("" where none), day,
    values (statistics,), portrait (the page features), another, glyphs. Columns ``unmade_kind`` and
    ``unmade_design`` have an entry for each misprint that cannot be on its page, and ``names`` has those of the
    statistics.
    """

    scene: Scene
    """Scene in the press world."""
    scatter: Scatter
    stress: Stress
    nuisances: tuple[str, ...]
    marks: tuple[str, ...]
    wrong_under: tuple[str, ...] = ()
    """Nuisances, "" for none, under each of which every design is printed once wrong, of the scene's kind in turn."""
    press_file: PressFile | None = None
    """Press file that the scene's press was built from, for the effect of a lamp."""

    def __call__(self, day: Day, /) -> Rows:
        """Return the rows of a day."""
        bench, table = self.scene.day(day), _Table(day=day)
        designs = {index: bench.design(index) for index in day.designs}
        for name in ("", *self.nuisances):
            under = self._under(bench, name, day) if name else bench
            for index, (good, prepared) in designs.items():
                self._add(table, under, good, prepared, index, nuisance=name)
        for kind in self.marks:
            mark = self.stress.mark(kind)
            for index, (good, prepared) in designs.items():
                number = list(MARKS).index(kind)
                rng = stream(self.scene.seed, "stress-mark", self.scene.number, index, number)
                drawn = draw_mark(good.page, mark, rng=rng, compose=self._composing(bench, index))
                if drawn is None:
                    table.unmade.append((kind, index))
                    continue
                wrong = Printed(page=drawn.page, expected=bench.day.expected(drawn.page))
                label = f"{kind} {drawn.variant}".strip()
                self._add(table, bench, wrong, prepared, index, kind=label)
        for name in self.wrong_under:
            self._add_wrong(table, bench, self._under(bench, name, day) if name else bench, designs, name)
        return table.rows()

    def _composing(self, bench: PressDay, index: int) -> Compose | None:
        """Return a function that composes a design as the press takes it; None: designs here are not composed."""
        pages = self.scene.pages
        if not isinstance(pages, Corpus):
            return None
        return lambda sheet: bench.day.press.geometry.lay(pages.page(index, sheet=sheet))

    def _add_wrong(
        self,
        table: _Table,
        bench: PressDay,
        under: PressDay,
        designs: Mapping[int, tuple[Printed, PreparedPage]],
        name: str,
    ) -> None:
        """Add one misprint of each design, the same whatever the nuisance."""
        for index, (good, prepared) in designs.items():
            rng, kind = self.scene.rng(index, 1), self.scene.kind(index, 1)
            others = rng.permutation([other for other in designs if other != index])[:OTHERS].tolist()
            wrong = bench.wrong(good, kind, others, rng)
            if wrong is None:
                table.unmade.append((kind, index))
                continue
            self._add(table, under, wrong, prepared, index, nuisance=name, kind=kind, rng=rng)

    def _under(self, bench: PressDay, name: str, day: Day) -> PressDay:
        under = stressed(
            bench.day,
            self.stress.nuisance(name),
            rng=stream(self.scene.seed, "stress-day", self.scene.number, day.designs[0]),
            others=day.designs,
            fetch=bench.page,
            press_file=self.press_file,
        )
        return replace(bench, day=under)

    def _add(
        self,
        table: _Table,
        bench: PressDay,
        printed: Printed,
        prepared: PreparedPage,
        index: int,
        *,
        nuisance: str = "",
        kind: str = "",
        rng: np.random.Generator | None = None,
    ) -> None:
        scan = bench.scan(printed, self.scene.rng(index, COPY) if rng is None else rng)
        row, table.names = scan_row(bench, prepared, scan, self.scatter)
        facts = {
            "design": index,
            "kind": kind,
            "nuisance": nuisance,
            "day": table.day.designs[0],
            "severity": printed.severity,
        }
        for name, value in {**facts, **row}.items():
            table.columns[name].append(value)


@dataclass(slots=True, kw_only=True, eq=False)
class _Table:
    """Rows while they are collected."""

    day: Day
    columns: dict[str, list[Any]] = field(default_factory=lambda: defaultdict(list))
    unmade: list[tuple[str, int]] = field(default_factory=list)
    names: list[str] = field(default_factory=list)

    def rows(self) -> Rows:
        rows = {name: np.array(values) for name, values in self.columns.items()}
        labels = {name: rows[name].astype("U24") for name in ("kind", "nuisance")}
        extra = {
            "unmade_kind": np.array([kind for kind, _ in self.unmade], "U24"),
            "unmade_design": np.array([index for _, index in self.unmade], np.int64),
            "names": np.array(self.names, "U48"),
        }
        return rows | labels | extra


# --- a press day under a nuisance, each of whose prints has a twin without it ---


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StressedDay(SimulatedDay):
    """A day in the press world under a nuisance, which the expectations of its tables do not include."""

    nuisance: Nuisance
    true_press: Press
    place: tuple[float, float]
    """``Passing.place``."""
    others: Sequence[int] = ()
    fetch: Callable[[int], Page] | None = None

    def seen_in_press(
        self, page: Page, rng: np.random.Generator, placement: Placement = IN_PLACE
    ) -> Prediction:
        """Return ``SimulatedDay.seen_in_press`` of the same print under the nuisance.

        ``rng`` is drawn from as there and no further: the nuisance has its own generator, seeded by what ``rng`` would
        draw next.
        """
        assert self.session is not None
        print_ = Print.draw(self.session, self.press, page, rng)
        own = stream(int(deepcopy(rng).integers(2**63)), "stress-nuisance")
        where = composed(placement, print_.placement)
        where = self.nuisance.moved(where, page, self.press.geometry, own)
        seen = fast_mean_variance(page, self.true_press, self.session, replace(print_, placement=where))
        passing = Passing(
            press=self.press,
            page=page,
            placement=where,
            place=self.place,
            others=self.others,
            fetch=self.fetch,
        )
        change = self.nuisance.light_change(passing, own)
        return seen if change is None else lit_otherwise(seen, change, self.press)


def stressed(
    day: SimulatedDay,
    nuisance: Nuisance,
    *,
    rng: np.random.Generator,
    others: Sequence[int] = (),
    fetch: Callable[[int], Page] | None = None,
    press_file: PressFile | None = None,
) -> StressedDay:
    """Return the day under a nuisance; with equal rng, its prints are those of ``day`` but for the nuisance.

    rng: draws what is constant for the day. others, fetch: designs, for show-through. press_file: that the press was
    built from, for the effect of a lamp. ValueError: the day is not of the press world, or the nuisance lacks what it
    needs.
    """
    if day.session is None:
        raise ValueError("nuisances are of the press world: this day has no session")
    return StressedDay(
        press=day.press,
        session=nuisance.session(day.session),
        nuisance=nuisance,
        true_press=nuisance.true_press(day.press, press_file),
        place=(float(rng.random()), float(rng.random())),
        others=tuple(others),
        fetch=fetch,
    )


def lit_otherwise(seen: Prediction, change: NDArray[np.floating], press: Press) -> Prediction:
    """Multiply the light by 1 + change, (sensors, lines, pixels) once broadcast; a change of 0 keeps every bit.

    The variance except that of rounding takes the same factor: exact for shot noise, and to first order of a few per
    cent for halftone (which scales with the square) and for read noise (which stays).
    """
    offset = np.stack([sensor.column_offset_dn for sensor in press.sensors])[:, None]
    top = np.array([sensor.top_code_dn for sensor in press.sensors], np.float32)[:, None, None]
    more = change.astype(np.float32)
    mean = seen.expected_dn + (seen.expected_dn - offset) * more
    variance = seen.variance_dn2 + (seen.variance_dn2 - np.float32(ROUNDING_DN2)) * more
    return Prediction(expected_dn=mean.clip(0, top), variance_dn2=variance)


# --- the file of nuisances and misprints for evaluation ---

SCHEMA: Final = 1
REMEDY: Final = "give the stress file unchanged (TOML, schema 1)"
STRESS_FILES: Final = GivenFiles(error=RequestError, remedy=REMEDY, largest_mb=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Stress:
    """Content of a stress file, by name and in the order of the file's kinds."""

    nuisances: Mapping[str, Nuisance]
    marks: Mapping[str, Mark | Digit]
    """Misprints of the file."""
    digest: str
    """SHA-256 of the file."""

    def nuisance(self, name: str) -> Nuisance:
        """Return a nuisance; RequestError: there is none of that name."""
        return _named("nuisance", self.nuisances, name)

    def mark(self, name: str) -> Mark | Digit:
        """Return a misprint; RequestError: there is none of that name."""
        return _named("misprint", self.marks, name)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle for worker processes: read-only mappings cannot be pickled."""
        return _again, (dict(self.nuisances), dict(self.marks), self.digest)


def load_stress(path: Path) -> Stress:
    """Read a stress file.

    RequestError: the file is no TOML, or a table or an amount is missing, unknown or wrong. OSError: the system cannot
    open it.
    """
    data = STRESS_FILES.read(path)
    text = STRESS_FILES.text(data, where=path)
    try:
        raw = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise RequestError(path, f"is not TOML: {error}", remedy=REMEDY) from error
    try:
        _check_head(raw)
        nuisances, marks = _tables(raw, "nuisance", NUISANCES), _tables(raw, "misprint", MARKS)
    except Misfit as error:
        raise RequestError(path, str(error), remedy=REMEDY) from error
    return _again(nuisances, marks, hashlib.sha256(data).hexdigest())


def _again(nuisances: dict[str, Nuisance], marks: dict[str, Mark | Digit], digest: str) -> Stress:
    return Stress(nuisances=MappingProxyType(nuisances), marks=MappingProxyType(marks), digest=digest)


def _check_head(raw: dict[str, Any]) -> None:
    if raw.get("schema") != SCHEMA:
        raise Misfit("schema", f"must be {SCHEMA}, not {shortly(repr(raw.get('schema')))}")
    for name in raw:
        if name not in ("schema", "nuisance", "misprint"):
            raise Misfit(shortly(name), "is not known here")


def _tables(raw: dict[str, Any], of: str, kinds: Mapping[str, type[Kind]]) -> dict[str, Kind]:
    """Return every table of a kind; Misfit: one is missing or unknown."""
    given = raw.get(of)
    if not isinstance(given, dict):
        raise Misfit(of, "is missing" if given is None else "must be a table of tables")
    for name in given:
        if name not in kinds:
            raise Misfit(f"{of}.{shortly(name)}", "is not known here")
    parsed = {}
    for name, kind in kinds.items():
        if name not in given:
            raise Misfit(f"{of}.{name}", "is missing")
        parsed[name] = checked(kind, given[name], under=f"{of}.{name}.")
    return parsed


def _named(what: str, entries: Mapping[str, Kind], name: str) -> Kind:
    if name not in entries:
        raise RequestError(what, f"there is no {shortly(name)!r}", remedy=f"choose from {', '.join(entries)}")
    return entries[name]

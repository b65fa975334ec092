"""Rows of the press study: days, good prints and misprints of page designs, and what each scan says."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.commissioning.rehearse import good_spread
from prooflight.deciding.calibrated import shows_another
from prooflight.deciding.families import all_said, samples
from prooflight.deciding.said import stated
from prooflight.deciding.tolerance import look, prepare_page
from prooflight.press import Press
from prooflight.simulating.misprints import KINDS, draw_misprint
from prooflight.simulating.scans import TRIES, passes_gate
from prooflight.simulating.worlds import gate
from prooflight.studies.captures import Printed, Room
from prooflight.studies.protocol import OTHERS

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.comparing.local_evidence import Scatter
    from prooflight.deciding.families import Said
    from prooflight.deciding.tolerance import Looked, PreparedPage
    from prooflight.pages.raster import Page
    from prooflight.simulating.misprints import Misprint
    from prooflight.studies.captures import World
    from prooflight.studies.corpus import Designs
    from prooflight.studies.protocol import Day
    from prooflight.studies.shards import Rows

PLACES: Final = 12
"""A misprint has no more (worlds.toml: spots)."""
SESSION: Final = 2
PRINTS: Final = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """What is printed, where and how: small, and travels to worker processes."""

    press: Path
    pages: Designs
    seed: int
    number: int
    """Of the scene: no two share a day."""
    world: World = "press"
    times: float = 1.0
    """How much more good prints vary than the press is made for."""
    misprints: int = 2
    """Copies of each design with a misprint; one more is good. Kinds take turns."""

    def day(self, day: Day) -> PressDay:
        """The press on that day."""
        press = _press(self.press)
        if self.times != 1:
            press = replace(press, variation=dict(press.variation) | {"all_times": self.times})
        rng = np.random.default_rng([self.seed, self.number, day.designs[0], SESSION])
        return PressDay(room=Room.enter(self.world, press, rng), scene=self)

    def rng(self, index: int, copy: int) -> np.random.Generator:
        """Of one copy of a design."""
        return np.random.default_rng([self.seed, self.number, index, copy, PRINTS])

    def kind(self, index: int, copy: int) -> str:
        """Of a copy; the first is good. Every round begins one further on: no design's number decides its kinds."""
        turn = index * self.misprints + copy - 1
        return KINDS[(turn + turn // len(KINDS)) % len(KINDS)] if copy else ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PressDay:
    """A press day with its page designs at hand."""

    room: Room
    scene: Scene

    def laid(self, index: int) -> Page:
        """A design as it enters the press."""
        return self.room.press.geometry.lay(self.scene.pages.page(index))

    def design(self, index: int) -> tuple[Printed, PreparedPage]:
        """A good print of a design, and what is known of it ahead."""
        press, good = self.room.press, self.room.good(self.laid(index))
        known = prepare_page(good.page, good.expected, sensors=press.sensors, geometry=press.geometry)
        return good, known

    def said(self, known: PreparedPage, printed: Printed, scatter: Scatter, rng: np.random.Generator) -> Row:
        """What one more print of it says."""
        scan = self.room.recorded(self.room.seen(printed, rng), rng)
        looked = self.looked(known, scan)
        said = all_said(looked.sums, looked.fit, looked.found, scatter)
        return Row(said=said, another=shows_another(looked.found))

    def looked(self, known: PreparedPage, scan: NDArray[np.uint16]) -> Looked:
        """A scan looked at as scans of the press are that this one is taken for."""
        press = self.room.press
        spread = good_spread(_press(self.scene.press))
        return look(known, scan, sensors=press.sensors, geometry=press.geometry, spread=spread)

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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Row:
    """What one scan says."""

    said: list[Said]
    another: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class ScatterWork:
    """Good copies of a day's designs -> what ``learn_scatter`` learns from."""

    scene: Scene

    def __call__(self, day: Day, /) -> Rows:
        """``Work``: draws by name, (designs, ...)."""
        bench = self.scene.day(day)
        drawn: dict[str, list[Any]] = defaultdict(list)
        for index in day.designs:
            rng = self.scene.rng(index, 0)
            good, known = bench.design(index)
            scan = bench.room.recorded(bench.room.seen(good, rng), rng)
            looked = bench.looked(known, scan)
            for name, values in samples(looked.sums, rng).items():
                drawn[name].append(values)
        return {name: np.stack(values) for name, values in drawn.items()}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SaidWork:
    """A good copy and misprints of a day's designs -> what each scan says, a row each.

    Columns: design, kind ("" where good), severity, draws, values (statistics,), boxes (statistics, 4) [mm], portrait,
    another (whether the scan shows another page), places (PLACES, 4) of the misprint [mm, NaN: none], sigma_error
    (sensors,) true temporal sigma over the tables', day. Beside them ``unmade_kind``, one for each misprint that nine
    draws did not bring over the gate, and ``names`` of the statistics.
    """

    scene: Scene
    scatter: Scatter

    def __call__(self, day: Day, /) -> Rows:
        """``Work``."""
        bench = self.scene.day(day)
        columns: dict[str, list[Any]] = defaultdict(list)
        unmade: list[str] = []
        names: list[str] = []
        for index in day.designs:
            good, known = bench.design(index)
            for copy in range(1 + self.scene.misprints):
                rng, kind = self.scene.rng(index, copy), self.scene.kind(index, copy)
                printed, places = good, np.full((PLACES, 4), np.nan, np.float32)
                if kind:
                    others = [other for other in day.designs if other != index]
                    made = bench.wrong(good, kind, rng.permutation(others)[:OTHERS].tolist(), rng)
                    if made is None:
                        unmade.append(kind)
                        continue
                    printed, misprint = made
                    where = misprint.regions_mm or (misprint.region_mm,)
                    places[: len(where)] = where[:PLACES]
                row = bench.said(known, printed, self.scatter, rng)
                names = [one.name for one in row.said]
                for name, value in {
                    "design": index,
                    "kind": printed.kind,
                    "severity": printed.severity,
                    "draws": printed.draws,
                    "values": stated(row.said),
                    "boxes": np.array([one.box for one in row.said], np.float32),
                    "portrait": known.portrait,
                    "another": row.another,
                    "places": places,
                    "sigma_error": _sigma_errors(bench.room),
                    "day": day.designs[0],
                }.items():
                    columns[name].append(value)
        rows = {name: np.array(values) for name, values in columns.items()}
        beside = {"unmade_kind": np.array(unmade, "U16"), "names": np.array(names, "U48")}
        return rows | {"kind": rows["kind"].astype("U16")} | beside


def _sigma_errors(room: Room) -> list[float]:
    if room.session is None:
        return [1.0] * len(room.press.sensors)
    return [sensor.sigma_error for sensor in room.session.sensors]


@lru_cache(maxsize=2)
def _press(path: Path) -> Press:
    return Press.load(path)

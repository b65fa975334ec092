"""Rows of stress: each beside the same good print, which is that of ``StatisticsWork``."""

from __future__ import annotations

import pickle
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
from prooflight.simulation.misprints.kinds import KINDS
from prooflight_studies.harness.print_statistics import Scene, StatisticsWork
from prooflight_studies.harness.protocol import Day
from prooflight_studies.stress.marks import GlyphExchanged, Hair
from prooflight_studies.stress.nuisances import DeadColumn, ShowThrough
from prooflight_studies.stress.rows import Stress, StressWork

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.press.press_file import PressFile
    from prooflight_studies.harness.result_cache import Rows

DAY = Day(of="stress", designs=(4, 5))
STRESS = Stress(
    nuisances={
        "dead_column": DeadColumn(what="", columns=1, loss_percent=40.0),
        "show_through": ShowThrough(what="", amplitude_percent=4.0, blur_mm=1.0),
    },
    marks={
        "hair": Hair(what="", width_mm=0.2, length_mm=15.0, ink_percent=60.0),
        "glyph_exchanged": GlyphExchanged(what="", window_mm=(2.0, 3.0)),
    },
    digest="",
)


@dataclass(frozen=True, kw_only=True)
class Made:
    make: Callable[..., Page]

    def page(self, index: int) -> Page:
        return self.make(1000 + index, number=index + 1, height_mm=30.0)


@pytest.fixture(scope="module")
def scene(press: Press, make_page: Callable[..., Page], tmp_path_factory: pytest.TempPathFactory) -> Scene:
    path: Path = tmp_path_factory.mktemp("stress") / "made.press"
    press.save(path)
    return Scene(press=path, pages=Made(make=make_page), seed=3, number=6, misprints=0)


@pytest.fixture(scope="module")
def rows(scene: Scene) -> Rows:
    work = StressWork(
        scene=scene,
        scatter=Scatter.white(),
        stress=STRESS,
        nuisances=tuple(STRESS.nuisances),
        marks=tuple(STRESS.marks),
    )
    return work(DAY)


def test_every_design_has_a_row_of_everything(rows: Rows) -> None:
    found = list(zip(rows["design"].tolist(), rows["nuisance"], rows["kind"], strict=True))
    what = [("", ""), ("dead_column", ""), ("show_through", ""), ("", "glyph_exchanged")]
    assert sorted(found) == sorted((design, *each) for design in DAY.designs for each in what)
    assert (rows["day"] == DAY.designs[0]).all()
    assert rows["unmade_kind"].tolist() == ["hair", "hair"]  # pages of 36 mm are too narrow for one
    assert rows["unmade_design"].tolist() == list(DAY.designs)
    assert rows["values"].shape == (8, rows["names"].size)
    assert not rows["another"].any()


def test_the_good_row_is_that_of_statistics_work(rows: Rows, scene: Scene) -> None:
    said = StatisticsWork(scene=scene, scatter=Scatter.white())(DAY)
    good = (rows["kind"] == "") & (rows["nuisance"] == "")
    for name in ("design", "values", "portrait"):
        assert np.array_equal(rows[name][good], said[name])
    assert np.array_equal(rows["names"], said["names"])


def test_what_befell_a_print_raises_what_its_scan_says(rows: Rows) -> None:
    for design in DAY.designs:
        of_design = rows["design"] == design
        good = of_design & (rows["kind"] == "") & (rows["nuisance"] == "")
        for other in np.flatnonzero(of_design & ~good):
            assert (rows["values"][other] > 1.5 * rows["values"][good][0] + 1).any()


def test_work_travels(scene: Scene, prototype: PressFile) -> None:
    small = Scene(press=scene.press, pages=None, seed=1, number=1)  # type: ignore[arg-type]
    work = StressWork(scene=small, scatter=Scatter.white(), stress=STRESS, nuisances=(), marks=())
    again = pickle.loads(pickle.dumps(replace(work, press_file=prototype)))
    assert again.stress == STRESS
    assert (again.press_file.path, again.press_file.text) == (prototype.path, prototype.text)


def test_kinds_take_turns_and_begin_one_further_on_in_every_round(tmp_path: Path) -> None:
    scene = Scene(press=tmp_path, pages=None, seed=1, number=1, misprints=1)  # type: ignore[arg-type]
    kinds = [scene.kind(index, 1) for index in range(144)]
    assert {kind: kinds.count(kind) for kind in KINDS} == dict.fromkeys(KINDS, 12)
    assert len({scene.kind(index, 1) for index in range(0, 144, 12)}) == len(KINDS)
    assert scene.kind(5, 0) == ""

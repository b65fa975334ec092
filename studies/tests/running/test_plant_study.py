"""The study of causes: rows as a journal has them, answers that need the right part, a loop that is seen to swing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from prooflight.cmyk import INK_NAMES
from prooflight.detectors.verdict import Region, Verdict
from prooflight.scans.geometry import ScanGeometry
from prooflight_line.causes.naming import named_causes
from prooflight_studies.harness.page import page_again
from prooflight_studies.plant import study
from prooflight_studies.plant.defects import CAUSES, PARTS, ROLLERS_MM, SHEETS, Runs
from prooflight_studies.plant.loop import loop_run, loops
from prooflight_studies.plant.places import errors_of
from prooflight_studies.plant.prints import DefectPrint
from prooflight_studies.plant.study import answer, first_sheets_off

GEOMETRY = ScanGeometry(pixels=2048, pixel_pitch_mm=0.1, line_pitch_mm=0.1, lead_in_mm=2.0, lead_out_mm=2.0)
AMOUNTS = {f"gain-{ink}": 0.005 for ink in INK_NAMES} | {f"register-{ink}-x": 0.01 for ink in INK_NAMES}


def printed(what: str, *boxes: tuple[str, float, float, float, float], ink: str = "") -> DefectPrint:
    """A print of which regions of these kinds lie about the defect, which is at (100, 100)."""
    regions = tuple(
        Region(x_mm=100 + x, y_mm=y, width_mm=w, height_mm=h, score=9.0, kind=kind, ink=ink)
        for kind, x, y, w, h in boxes
    )
    off = {"density": {"gain-black": -0.15}, "register": {"register-black-x": 0.3}}
    verdict = Verdict(
        page="p",
        verdict="misprint" if boxes else "good",
        kind=boxes[0][0] if boxes else None,
        regions=regions,
    )
    at_mm = 0.0 if what == "paper" else 100.0
    amounts = AMOUNTS | off.get(what, {})
    return DefectPrint(what=what, design=0, ink=ink, x_mm=at_mm, y_mm=at_mm, verdict=verdict, amounts=amounts)


LIBRARY = (
    printed("spot", ("spots-voids", -0.4, 99.7, 1.0, 1.0)),
    printed("spot", ("spots-voids", -0.6, 99.4, 1.0, 1.0)),
    printed("nozzle", ("streak", -0.12, 0.0, 0.25, 297.0), ink="M"),
    printed("nozzle", ("streak", -0.14, 0.0, 0.25, 297.0), ink="M"),
    printed("paper", ("scum", -60.0, 30.0, 6.0, 6.0)),
    printed("paper", ("scum", 40.0, 70.0, 6.0, 6.0)),
    printed("density", ink="K"),
    printed("register", ink="K"),
    printed("good"),
)


@pytest.mark.parametrize("cause", CAUSES)
def test_each_cause_is_named_from_its_rows(cause: str) -> None:
    defect = Runs(LIBRARY, GEOMETRY, 3).run(cause, 5)
    assert [row.sheet for row in defect.records] == list(range(SHEETS))
    named = named_causes(defect.records, geometry=GEOMETRY, parts=PARTS)
    assert answer(named, defect) == cause
    if cause == "nozzle":
        off = first_sheets_off(defect, GEOMETRY)
        assert off is not None
        assert abs(off) <= 1


def test_a_wrong_part_is_no_right_answer() -> None:
    defect = Runs(LIBRARY, GEOMETRY, 3).run("nozzle", 5)
    (cause, *_) = named_causes(defect.records, geometry=GEOMETRY, parts=PARTS)
    other = next(name for name in ("cyan bar", "magenta bar") if name != defect.name)
    assert answer([replace(cause, names=(other,))], defect) == "another part"
    assert answer([], defect) == "nothing"


def test_an_unlisted_roller_is_no_part() -> None:
    defect = Runs(LIBRARY, GEOMETRY, 3).run("unlisted roller", 6)
    assert all(abs(defect.distance_mm / one - 1) > 0.01 for one in ROLLERS_MM.values())
    named = named_causes(defect.records, geometry=GEOMETRY, parts=PARTS)
    assert answer(named, defect) == "no roller of the press file"


def test_the_page_says_what_was_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    press = SimpleNamespace(geometry=GEOMETRY, name="rig", digest="0" * 64)
    monkeypatch.setattr(study, "Press", SimpleNamespace(load=lambda _path: press))
    monkeypatch.setattr(study, "defect_prints", lambda *_, **_more: list(LIBRARY))
    plan = study.CausesPlan(seed=3, designs=1, defects=16, unlisted=2, null=2, loops=5)
    results = study.run_plant_study(tmp_path, press=Path("x.press"), plan=plan, cache=tmp_path)
    assert results.right == 16
    assert results.unlisted_right == 2
    page = (tmp_path / "plant.md").read_text()
    assert "**16 of 16 causes were identified correctly" in page
    table = [line for line in page.splitlines() if line.startswith("| fuser |")]
    assert len(table) == 1
    assert (tmp_path / "plant-causes.png").stat().st_size > 10_000
    assert page_again(tmp_path / "plant.json", tmp_path / "again.md").read_text() == page


def test_a_library_that_lacks_something_is_refused() -> None:
    with pytest.raises(ValueError, match="paper"):
        Runs([one for one in LIBRARY if one.what != "paper"], GEOMETRY, 3)


def test_errors_of_places() -> None:
    by_name = {one.what: one for one in errors_of(LIBRARY, GEOMETRY)}
    across = by_name["position of a spot, across"]
    assert (across.measured, across.prints) == (2, 2)
    assert across.bias == pytest.approx(0.0)
    assert by_name["position of a failing nozzle, one sheet"].bias == pytest.approx(-0.005)
    density = by_name["density of an ink that is 15 % weaker"]
    assert (density.measured, density.prints) == (1, 1)


def test_the_loop_is_quiet_as_offered_and_swings_without_waiting() -> None:
    none, offered, full, undamped, hasty = loops(3, 10, response=(0.6, 0.4))
    assert max(offered.waste, full.waste) < none.waste / 2
    assert (offered.oscillating, full.oscillating, undamped.oscillating) == (0, 0, 0)
    assert hasty.oscillating == hasty.runs
    free = loop_run(3, 0, damping=None)
    assert not free.offsets["gain-black"]
    assert np.abs(free.deviation).max() > 0

"""A detector of another package goes all ways of our own: built, priced, inspected, watched, replayed, relabelled."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from packages.line.tests.journal.journals import facts, record
from tests.examples.test_registered import install

import prooflight as pf
from prooflight.cli import run
from prooflight.detectors import registry
from prooflight.detectors.optional import ChecksRuns, PricesZones, Recalibrates
from prooflight.detectors.verdict import Verdict
from prooflight.errors import PressError
from prooflight.pages.files import write_tiff
from prooflight.scans.recorded import write_scan
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.labels import LabelStore, run_key

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

FOREIGN = Path(__file__).with_name("foreign_detector.py")
NAME, MODULE, DESIGNS, LABELLED = "worst_square", "squares_of_a_package", 24, 40


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The package, installed for this process and those that it starts."""
    site = tmp_path_factory.mktemp("site")
    install(site, MODULE, f"{NAME} = {MODULE}:ENTRY", FOREIGN.read_text(encoding="utf-8"))
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(site))
        yield
    sys.modules.pop(MODULE, None)
    registry._registered.cache_clear()


@pytest.fixture(scope="module")
def artefact(package: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A press that `press build` trained with this detector alone."""
    folder = tmp_path_factory.mktemp("press")
    text = pf.PressFile.prototype().text.replace("pixels = 2048 ", "pixels = 400 ")
    (folder / "small.toml").write_text(text)
    words = ("press", "build", folder / "small.toml", "-o", folder / "x.press", "--detector", NAME)
    assert run([*map(str, words), "--designs", str(DESIGNS), "--json"]) == 0
    return folder / "x.press"


@pytest.fixture(scope="module")
def job(artefact: Path, make_page: Callable[..., pf.Page], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A job of six pages, and a scan of each in the ideal world: the second has a black square."""
    folder, press = tmp_path_factory.mktemp("rig"), pf.Press.load(artefact)
    (folder / "scans").mkdir()
    for number in range(1, 7):
        page = make_page(number, number=number, height_mm=30.0)
        write_tiff(page, folder / "job" / f"{page.name}.tif")
        scan = pf.simulate(page, press, seed=number)
        if number == 2:
            top = round((press.geometry.lead_in_mm + 20) / press.geometry.line_pitch_mm)
            scan.dn[:, top : top + 12, 200:212] = 0
        write_scan(folder / "scans" / f"{page.name}.tif", scan.dn, facts={})
    return folder / "job"


def said(capsys: pytest.CaptureFixture[str], *words: object, code: int = 0) -> list[Any]:
    """What a command prints as JSON, a row a line; phases are left out."""
    capsys.readouterr()
    assert run([*map(str, words), "--json"]) == code, capsys.readouterr().err
    text = capsys.readouterr().out
    if text.startswith("{\n") or text.startswith("[\n"):
        return [json.loads(text)]
    return [row for line in text.splitlines() if "phase" not in (row := json.loads(line))]


def test_its_model_is_built_stored_and_asked_for_by_its_name(artefact: Path) -> None:
    press = pf.Press.load(artefact)
    assert set(press.detectors) == {NAME}
    assert registry.promises(press)[NAME].startswith(f"at most one good page in {DESIGNS + 1} alarms")
    found = registry.detector(NAME, press)
    assert isinstance(found, ChecksRuns)
    assert isinstance(found, PricesZones)
    assert isinstance(press.detectors[NAME], Recalibrates)
    assert registry.detector(None, press).name == "chi-square"  # it is used where a user names it
    assert registry.family_text(NAME, "worst") == "the worst square"


def test_pages_are_inspected_with_zones_that_it_priced(
    artefact: Path, job: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    inspect = ("inspect", job, job.parent / "scans", "--press", artefact, "--detector", NAME)
    rows = said(capsys, *inspect, code=1)
    assert [row["verdict"] for row in rows] == ["good", "misprint", "good", "good", "good", "good"]
    assert {row["detector"] for row in rows} == {NAME}
    (place,) = rows[1]["regions"]
    assert 18 <= place["y_mm"] < 22
    zone = {"name": "square", "kind": "ignore", "pages": "2", "rectangle_mm": [5, 15, 25, 10]}
    zones = tmp_path / "job.zones.json"
    zones.write_text(json.dumps({"zones": [zone]}))
    price = ("zones", "price", zones, job, "--press", artefact, "--prints", 12, "--trials", 0, "--save")
    (priced,) = said(capsys, *price, "--detector", NAME)
    assert priced["promised"] == pytest.approx(1 / (DESIGNS + 1))
    rows = said(capsys, *inspect, "--zones", zones)
    assert [row["verdict"] for row in rows] == ["good"] * 6
    assert run([*map(str, inspect[:-1]), "chi-square", "--zones", str(zones)]) == 2
    assert f"priced for the detector '{NAME}'" in capsys.readouterr().err


def test_a_run_is_watched_tested_and_replayed(
    artefact: Path, job: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    press = pf.Press.load(artefact)
    journal, lines = tmp_path / "runs.sqlite", press.geometry.lines(30.0)
    watch = ("watch", job, "--press", artefact, "--source", "drum", "--trigger", lines, "--detector", NAME)
    rows = said(capsys, *watch, "--journal", journal, "--keep", "all", "--world", "press", code=1)
    sheets = [row for row in rows if "verdict" in row]
    assert {row["detector"] for row in sheets} == {NAME}
    assert sheets[-1]["promise_suspended"]  # prints of the press world move, and its good pages did not
    assert not sheets[0]["promise_suspended"]
    (again,) = said(capsys, "run", "replay", 1, 1, "--press", artefact, "--journal", journal)
    assert again["same"] is True


def test_labels_set_its_threshold_and_are_taken_back(
    artefact: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    press, path, new, back = (
        pf.Press.load(artefact),
        tmp_path / "j.sqlite",
        tmp_path / "n.press",
        tmp_path / "b",
    )
    with Journal.open(str(path)) as journal:
        run_id = journal.begin_run(facts(press_digest=press.digest, detector=NAME, settings={"sample": 1.0}))
        for sheet in range(LABELLED):
            score = 0.01 * (sheet + 1)
            verdict = Verdict(page="p0001", verdict="good", score=score, threshold=9.0, detector=NAME)
            journal.record(run_id, record(sheet, kept=False, verdict=verdict, asked=1.0))
        journal.commit()
        key = run_key(journal.run(run_id))
    words = LabelStore(path)
    for sheet in range(LABELLED):
        words.say("good", run=key, sheet=sheet, by="Mei", at_s=2.0)
    command = ("press", "recalibrate", artefact, "--journal", path, "--promise", 20, "-o", new)
    (found,) = said(capsys, *command, "--detector", NAME)
    assert found["threshold"] == pytest.approx(
        0.39
    )  # (1 + 1) / 41 is at most a twentieth, (1 + 2) / 41 is not
    model = pf.Press.load(new).detectors[NAME]
    assert isinstance(model, Recalibrates)
    assert (model.threshold, model.guarantee.rate) == (found["threshold"], 0.05)
    said(capsys, "press", "go-back", new, "-o", back)
    assert pf.Press.load(back).digest == press.digest


def test_a_press_of_a_package_that_is_not_installed_is_refused_in_one_line(
    artefact: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry, "entry_points", lambda **_: ())
    with pytest.raises(PressError, match=f"detectors.{NAME} is of a detector that is not installed here"):
        pf.Press.load(artefact)

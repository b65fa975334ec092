"""`prooflight plant` and the gate of `prooflight watch`, with a controller on loopback."""

from __future__ import annotations

import json
import socket
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from packages.line.tests.plant.peers import Receiver
from tests.cli.word_jobs import write_word_job

from prooflight.cli import run
from prooflight_line.plant.events import SheetJudged, StateChanged, parsed
from prooflight_line.plant.simulator.plc import Belt, SimulatedPlc
from prooflight_line.plant.simulator.server import PlcServer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from prooflight.press.artefact import Press
    from prooflight.press.press_file import PressFile

PAGES = 4
DISTANCE_MM = 400.0
RATE = 2.0
"""Pages a second: a sheet reaches the gate, 800 mm on, when its verdict has been due for some seconds."""


@pytest.fixture(scope="module")
def folder(press: Press, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``x.press`` and ``job``, four pages of 36 x 30 mm."""
    folder, rng = tmp_path_factory.mktemp("gated"), np.random.default_rng(11)
    press.save(folder / "x.press")
    write_word_job(folder / "job", pages=PAGES, rng=rng, tinted=True)
    return folder


@pytest.fixture
def server(tmp_path: Path) -> Iterator[PlcServer]:
    with (tmp_path / "trays.jsonl").open("w", buffering=1) as log:
        belt = Belt(distance_mm=DISTANCE_MM, counts_per_mm=10.0)
        with PlcServer(SimulatedPlc(belt=belt, heartbeat_s=5.0, log=log)) as running:
            yield running


@pytest.fixture
def plant(tmp_path: Path, prototype: PressFile) -> Callable[..., Path]:
    """A press file with a gate."""

    def made(port: int, *, gate: str = "", plc: str = "") -> Path:
        path = tmp_path / "plant.toml"
        blocks = f"[gate]\ndistance_mm = {DISTANCE_MM}\ntolerance_mm = 14.0\n{gate}\n"
        blocks += (
            f'[gate.plc]\nhost = "127.0.0.1"\nport = {port}\ntimeout_ms = 2000\nheartbeat_ms = 5000\n{plc}\n'
        )
        path.write_text(f"{prototype.text}\n{blocks}")
        return path

    return made


def closed_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as closed:
        return int(closed.getsockname()[1])


def watch(folder: Path, plant: Path, *more: object) -> list[str]:
    given = ["watch", folder / "job", "--press", folder / "x.press", "--plant", plant, "--json", *more]
    return [str(one) for one in given]


def test_a_run_with_a_gate_from_the_drum_to_the_reprint_list(
    folder: Path,
    server: PlcServer,
    plant: Callable[..., Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Twelve sheets, every fourth a misprint, and all of it by commands."""
    journal, trays = tmp_path / "runs.sqlite", tmp_path / "trays.jsonl"
    more = ["--source", f"drum:{RATE}", "--sheets", 12, "--misprint", "streak:1", "--every", 4]
    more += ["--journal", journal, "--world", "ideal", "--deadline", 8000]
    file = plant(server.port, gate="")
    text = file.read_text().replace(f"distance_mm = {DISTANCE_MM}", "distance_mm = 800.0")
    server.call(lambda: setattr(server.plc.belt, "distance_mm", 800.0))
    file.write_text(text)
    assert run(watch(folder, file, *more)) == 1
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines() if '"phase": ' not in line]
    assert "gate-ready" in {row.get("notice") for row in rows}
    judged = {row["sheet"]: row["verdict"] for row in rows if "sheet" in row}
    in_tray = {row.tag - 1: row.tray for row in server.plc.rows if row.tag}
    assert len(judged) == 12
    assert judged.keys() - in_tray.keys() <= {0}  # the first may come before the gate is ready
    for sheet, tray in in_tray.items():
        assert (tray == "good") == (judged[sheet] == "good")
    truths = [row.truth for row in server.plc.rows]
    assert truths.count("misprint") == 3
    assert {row.truth for row in server.plc.rows if row.tray == "good"} == {"good"}

    code = run(["run", "reconcile", "--journal", str(journal), "--trays", str(trays), "--json"])
    found = json.loads(capsys.readouterr().out)
    assert code == 0
    assert found["counts"]["diverted"] == 3
    assert sum(found["counts"].values()) == 12
    assert run(["run", "reconcile", "--journal", str(journal), "--trays", str(trays)]) == 0
    assert "rejected, as decided" in capsys.readouterr().out

    listed = tmp_path / "reprints.json"
    arguments = ["run", "reprint-list", "--journal", str(journal), "--trays", str(trays)]
    assert run([*arguments, "-o", str(listed)]) == 0
    reprints = json.loads(listed.read_text())["reprints"]
    wanted = {sheet for sheet in judged if in_tray.get(sheet) != "good"}
    assert {one["run_sheet"] for one in reprints} == wanted
    capsys.readouterr()
    assert run(arguments) == 0
    assert "misprint" in capsys.readouterr().out


def test_a_duplex_run_with_a_gate_decides_each_sheet_when_its_back_was_seen(
    folder: Path,
    server: PlcServer,
    plant: Callable[..., Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Six sheets of two sides; every fourth side, the back of every second sheet, has a streak."""
    journal, trays = tmp_path / "runs.sqlite", tmp_path / "trays.jsonl"
    file = plant(server.port)
    file.write_text(file.read_text().replace(f"distance_mm = {DISTANCE_MM}", "distance_mm = 800.0"))
    server.call(lambda: setattr(server.plc.belt, "distance_mm", 800.0))
    more = ["--source", f"drum:{RATE}", "--sheets", 6, "--misprint", "streak:1", "--every", 4]
    more += ["--journal", journal, "--world", "ideal", "--deadline", 8000, "--layout", "sides=2"]
    assert run(watch(folder, file, *more)) == 1
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines() if '"phase": ' not in line]
    sheets = {
        row["sheet_verdict"]["sheet"]: row["sheet_verdict"]["verdict"]
        for row in rows
        if "sheet_verdict" in row
    }
    assert sheets == {sheet: "misprint" if sheet % 2 else "good" for sheet in range(6)}
    in_tray = {row.tag: row.tray for row in server.plc.rows if row.tag}
    assert in_tray.keys() <= {2, 4, 6, 8, 10, 12}  # by the number of each back
    assert len(server.plc.rows) == 6
    assert {tag for tag, tray in in_tray.items() if tray == "good"} <= {2, 6, 10}
    assert {row.truth for row in server.plc.rows if row.tray == "good"} == {"good"}

    code = run(["run", "reconcile", "--journal", str(journal), "--trays", str(trays), "--json"])
    found = json.loads(capsys.readouterr().out)
    assert code == 0
    assert sum(found["counts"].values()) == 6
    assert found["counts"]["diverted"] == 3
    assert run(["run", "reprint-list", "--journal", str(journal), "--trays", str(trays), "--json"]) == 0
    listed = {one["run_sheet"]: one for one in json.loads(capsys.readouterr().out)["reprints"]}
    assert listed.keys() >= {1, 3, 5}
    assert listed[3]["pages"] == [3, 4]


@pytest.mark.parametrize(
    ("more", "what"),
    [
        (["--source", "drum"], "has a gate, and this source has no speed of its own"),
        (["--source", "replay:scans"], "has a gate, and this source has no speed of its own"),
        (["--source", "drum:100"], "is too short for the verdict"),
        (["--source", "drum:1", "--deadline", "60000"], "is too short for the verdict"),
    ],
)
def test_a_gate_that_cannot_be_served_is_refused_before_the_run(
    more: list[str],
    what: str,
    folder: Path,
    server: PlcServer,
    plant: Callable[..., Path],
    capsys: pytest.CaptureFixture[str],
) -> None:
    refused(watch(folder, plant(server.port), *more), what, capsys)


@pytest.mark.parametrize(
    ("gate", "plc", "what"),
    [
        ("", "", "no controller answers"),
        ("", "first_register = 8", "register 40 contains"),
        ("", "unit = 9", "it refuses register or coil 32"),
    ],
)
def test_a_controller_that_is_not_there_or_another_is_refused(
    gate: str,
    plc: str,
    what: str,
    folder: Path,
    server: PlcServer,
    plant: Callable[..., Path],
    capsys: pytest.CaptureFixture[str],
) -> None:
    port = server.port if plc else closed_port()
    file = plant(port, gate=gate, plc=plc)
    refused(watch(folder, file, "--source", "drum:1"), what, capsys)
    assert run(["plant", "check", str(file), "--json"]) == 2
    (answer,) = json.loads(capsys.readouterr().out)
    assert not answer["answers"]
    assert what in answer["says"]


def test_a_tolerance_of_half_a_sheet_is_refused(
    folder: Path, server: PlcServer, plant: Callable[..., Path], capsys: pytest.CaptureFixture[str]
) -> None:
    file = plant(server.port)
    file.write_text(file.read_text().replace("tolerance_mm = 14.0", "tolerance_mm = 15.0"))
    what = "tolerance_mm = 15 is half a sheet of 30 mm or more; give less than 15"
    refused(watch(folder, file, "--source", "drum:1", "--deadline", 1000), what, capsys)


def refused(arguments: list[str], what: str, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert run(arguments) == 2
    said = capsys.readouterr().err
    assert what in said
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("gate", "what"),
    [
        ("policy = 'perhaps'", "gate.policy"),
        ("stop_of = [5, 3]", "stop_of must be"),
        ("distance = 3", "gate.distance is not a known field"),
    ],
)
def test_a_gate_that_is_none_is_refused_by_its_field(
    gate: str, what: str, plant: Callable[..., Path], capsys: pytest.CaptureFixture[str]
) -> None:
    refused(["plant", "check", str(plant(502, gate=gate))], what, capsys)


def test_check_says_what_answers(
    server: PlcServer, plant: Callable[..., Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["plant", "check", str(plant(server.port))]) == 0
    assert "encoder" in capsys.readouterr().out


def test_a_press_file_without_a_plant_has_nothing_to_check(
    tmp_path: Path, prototype: PressFile, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "press.toml").write_text(prototype.text)
    refused(["plant", "check", str(tmp_path / "press.toml")], "has no gate and no outlet", capsys)
    refused(["plant", "simulate", str(tmp_path / "press.toml")], "has no [gate]", capsys)


@pytest.mark.parametrize("json_", [True, False])
def test_a_controller_is_played_for_so_long(json_: bool, capsys: pytest.CaptureFixture[str]) -> None:
    given: list[Any] = ["plant", "simulate", "--listen", "127.0.0.1:0", "--seconds", "0.2"]
    assert run([*given, *(["--json"] if json_ else [])]) == 0
    out = capsys.readouterr().out
    if json_:
        found = json.loads(out)
        assert (found["good"], found["reject"], found["stopped"]) == (0, 0, False)
    else:
        assert "good tray: 0" in out
        assert "NO HEARTBEAT" in out


def test_a_port_that_is_taken_is_one_line(server: PlcServer, capsys: pytest.CaptureFixture[str]) -> None:
    given = ["plant", "simulate", "--listen", f"127.0.0.1:{server.port}", "--seconds", "0.1"]
    refused(given, "cannot be listened on", capsys)
    refused(["plant", "simulate", "--listen", "nowhere"], "'nowhere' is not an address", capsys)


def test_a_run_without_a_gate_has_nothing_to_reconcile(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from prooflight_line.journal.journal import Journal
    from prooflight_line.journal.records import RunFacts

    facts = RunFacts(
        job="j", job_digest="", press="p", press_digest="", detector="d", source="s", started_s=0.0
    )
    with Journal.open(str(tmp_path / "runs.sqlite")) as opened:
        opened.begin_run(facts)
    refused(
        ["run", "reconcile", "--journal", str(tmp_path / "runs.sqlite")],
        "give the journal of a run that had a gate",
        capsys,
    )


SECRET_WORD = "a secret of sixteen letters"


def test_an_outlet_is_told_the_whole_run_and_a_gate_s_states(
    folder: Path,
    server: PlcServer,
    plant: Callable[..., Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("HOOK_SECRET", SECRET_WORD)
    with Receiver() as receiver:
        file = plant(server.port)
        hook = (
            f'[[plant.webhook]]\nurl = "http://127.0.0.1:{receiver.port}/hook"\nsecret_env = "HOOK_SECRET"\n'
        )
        file.write_text(f"{file.read_text()}\n{hook}")
        assert run(["plant", "check", str(file), "--json"]) == 0
        assert [one["what"] for one in json.loads(capsys.readouterr().out)] == ["gate (registers)", "outlet"]
        more = ["--source", "drum:3", "--sheets", 3, "--world", "ideal", "--deadline", 1000]
        more += ["--layout", "pages-a-set=1"]
        run(watch(folder, file, *more, "--journal", tmp_path / "runs.sqlite"))
        told = [parsed(body).body for _, _, body in receiver.taken]
    kinds = [one.event for one in told]
    assert (kinds[0], kinds[-1]) == ("run-started", "run-ended")
    assert kinds.count("sheet-judged") == 3
    on_sheets = [one.on_sheet for one in told if isinstance(one, SheetJudged)]
    assert [(one.sheet, one.set) for one in on_sheets if one is not None] == [(0, 0), (1, 1), (2, 2)]
    states = {(one.of, one.state) for one in told if isinstance(one, StateChanged)}
    assert states >= {("gate", "joining"), ("gate", "aligning"), ("gate", "ready"), ("press", "stopped")}


def test_an_outlet_that_does_not_answer_is_refused_before_the_run(
    folder: Path,
    tmp_path: Path,
    prototype: PressFile,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("HOOK_SECRET", SECRET_WORD)
    url = f"http://127.0.0.1:{closed_port()}/hook"
    file = tmp_path / "plant.toml"
    file.write_text(f'{prototype.text}\n[[plant.webhook]]\nurl = "{url}"\nsecret_env = "HOOK_SECRET"\n')
    refused(watch(folder, file, "--source", "drum:1"), "does not answer", capsys)

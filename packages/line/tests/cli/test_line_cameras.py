"""A camera that is plugged in, as a user meets it: listed, asked, recorded, watched. The camera is on loopback."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from packages.line.tests.cameras.peers import ID, gige_camera, numbered_lines
from packages.line.tests.cli.test_watch import job, trigger, watch  # noqa: F401
from tests.cli.calls import call

from prooflight.cli import run
from prooflight.press.press_file import PressFile
from prooflight.scans.raw import open_raw
from prooflight.scans.recorded import recorded_scans

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

SETTINGS = """
[camera]
pixel_format = "Mono16"
block_lines = 64
line_rate_hz = 5000.0
trigger = "free"
features = { Width = 400 }
"""


@pytest.fixture
def plain_camera() -> Iterator[None]:
    with gige_camera(numbered_lines(256, 512)):
        yield


@pytest.fixture(scope="module")
def settings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("camera") / "camera.toml"
    file.write_text(PressFile.prototype().text + SETTINGS)
    return file


def test_cameras_are_listed_and_describe_themselves(
    plain_camera: None, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = call(capsys, "camera", "list", "--json")
    assert code == 0
    assert [(one["id"], one["address"], one["backend"]) for one in json.loads(out)] == [
        (ID, "127.0.0.1", "aravis")
    ]
    code, out, _ = call(
        capsys, "camera", "features", ID, "--set", "Height=64", "--set", "TriggerSoftware=-", "--json"
    )
    assert code == 0
    known = {one["name"]: one for one in json.loads(out)}
    assert known["Height"]["value"] == "64"
    assert known["PixelFormat"]["choices"][:2] == ["Mono10", "Mono12"]


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("features", "nobody"), f"prooflight: camera nobody: does not answer; these cameras answer: {ID}\n"),
        (
            ("features", ID, "--set", "Height"),
            "prooflight: --set: 'Height' is not a feature and its value; write e.g. --set",
        ),
        (("features", ID, "--set", "Tallness=3"), f"prooflight: Tallness: {ID} has no such feature; "),
        (
            ("features", ID, "--set", "Height=0"),
            f"prooflight: Height: {ID} does not accept Height 0; give 1 to 2048\n",
        ),
        (
            ("list", "--backend", "magic"),
            "prooflight: camera backend: there is no 'magic'; choose aravis, viva, pylon",
        ),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(
    plain_camera: None, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], line: str
) -> None:
    code, _, err = call(capsys, "camera", *arguments)
    assert code == 2
    assert err.startswith(line)
    assert err.count("\n") == 1


def test_a_recording_holds_the_lines_and_their_faults(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    lines = numbered_lines(2048, 512)
    with gige_camera(lines, lost=0.01):
        code, out, err = call(
            capsys, "camera", "record", ID, "-o", tmp_path / "r.raw", "--lines", 40_000, "--json"
        )
    assert code == 0, err
    told = json.loads(out)
    blocks = list(open_raw(str(tmp_path / "r.raw"), sensors=1, pixels=512, framed=True).blocks())
    assert sum(block.lines.shape[1] for block in blocks) == told["lines"]
    faults = [fault for block in blocks for fault in block.faults]
    assert [fault.detail for fault in faults] == told["faults"]
    assert faults
    assert {fault.kind for fault in faults} <= {"lost-packets", "lost-blocks"}


def verdicts(rows: list[dict[str, Any]]) -> list[tuple[object, ...]]:
    return [
        (row["job_page"], row["verdict"], row["score"], row["faults"]) for row in rows if "verdict" in row
    ]


def test_a_press_is_watched_over_the_wire_as_from_files(
    press_file: Path,
    job: Path,  # noqa: F811
    trigger: int,  # noqa: F811
    settings: Path,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    """Lines are the same to the byte, so verdicts are; live, and from a recording."""
    scans, recording = tmp_path / "scans", tmp_path / "recording.raw"
    assert run(["simulate", str(job), "--press", str(press_file), "-o", str(scans)]) == 0
    capsys.readouterr()
    usual = "--press", press_file, "--journal", "none", "--trigger", trigger, "--json"
    code, rows, err = watch(capsys, job, "--source", f"replay:{scans}", *usual)
    assert code == 0, err
    wanted = verdicts(rows)
    lines = np.concatenate([scan.read()[0] for scan in recorded_scans(scans, sensors=1)])
    quiet = np.repeat(lines[-1:], 40_000, axis=0)  # what the camera sees behind the job: backing
    with gige_camera(np.concatenate([lines, quiet]).astype("<u2").view(np.uint8)):
        live = subprocess.Popen(
            [
                *(sys.executable, "-m", "prooflight", "watch", str(job), "--source", f"camera:{ID}"),
                *("--camera", str(settings), "--deadline", "60000", *(str(one) for one in usual)),
            ],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert live.stdout is not None
        came = list[dict[str, Any]]()
        others = list[dict[str, Any]]()
        while len(came) < len(wanted):
            row = json.loads(live.stdout.readline())
            (came if "verdict" in row else others).append(row)
        live.send_signal(signal.SIGINT)
        live.communicate()
        assert live.returncode == 0
    assert verdicts(came) == wanted
    health = next(row["cameras"] for row in others if "cameras" in row)[ID]
    assert (health["lines_lost"], health["away"], health["present"]) == (0, 0, True)
    with gige_camera(np.concatenate([lines, quiet]).astype("<u2").view(np.uint8)):
        asked = "--lines", len(lines) + 200, "--camera", settings
        assert call(capsys, "camera", "record", ID, "-o", recording, *asked)[0] == 0
    code, rows, err = watch(capsys, job, "--source", f"raw:{recording}", "--framed", *usual)
    assert verdicts(rows) == wanted, err


def test_a_camera_of_another_width_is_refused_in_one_line(
    plain_camera: None,
    press_file: Path,
    job: Path,  # noqa: F811
    capsys: pytest.CaptureFixture[str],
) -> None:
    code, _, err = watch(capsys, job, "--source", f"camera:{ID}", "--press", press_file, "--journal", "none")
    assert code == 2
    assert err == (
        f"prooflight: camera:{ID}: sends 1 sensors x 512 pixels; press prototype has 1 sensors x 400 pixels: set Width"
        " and PixelFormat\n"
    )


def test_a_camera_of_another_depth_is_refused_in_one_line(
    plain_camera: None,
    press_file: Path,
    job: Path,  # noqa: F811
    settings: Path,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    shallow = tmp_path / "shallow.toml"
    shallow.write_text(settings.read_text().replace("Mono16", "Mono10"))
    usual = "--press", press_file, "--journal", "none", "--camera", shallow
    code, _, err = watch(capsys, job, "--source", f"camera:{ID}", *usual)
    assert code == 2
    assert err.startswith(
        f"prooflight: camera:{ID}: sends Mono10, numbers up to 1023; those of press prototype go up to"
    )

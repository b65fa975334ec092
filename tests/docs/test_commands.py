"""Every command of the tutorial and the how-tos runs, in order, in a folder of its page.

Blocks of nothing but ``prooflight`` commands, and those of Python, run in the process of the tests, and bash runs what
needs a shell; all on one processor. A process for each would load the same modules and kernels a hundred times, and
takes longer for that than for its work. ``tests/cli`` starts commands as a user does.

A page says in a comment above a block how it is run here, where it would take minutes or must end otherwise than well:
``<!-- runs: with --designs 24; exit 1 -->`` appends options to each ``prooflight`` command of the block, the last of
which counts, and names the exit code of its last command. Files of the user are small ones; ``NEEDS`` lists them.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
import tifffile
from packages.line.tests.cameras.scene_cameras import scene_camera
from packages.line.tests.cameras.scenes import Scenes
from reportlab.lib.units import mm
from reportlab.pdfgen.canvas import Canvas
from tests.cli.calls import PROOFLIGHT, call
from tests.turns import in_turn

from prooflight.cli import run as run_here
from prooflight.cmyk import NAME_OF_INK
from prooflight.commissioning.build import build_press
from prooflight.inks.built_in import built_in_inks
from prooflight.inks.ruler_layout import RulerLayout
from prooflight.inks.ruler_print import RASTER_DPI, ruler_raster
from prooflight.pages.files import write_tiff
from prooflight.pages.pdf.rip import PdfJob
from prooflight.pages.raster import Page
from prooflight.prediction.predict import predict
from prooflight.press import press_file
from prooflight.press.press_file import PressFile

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = sorted([*(DOCS / "tutorial").glob("*.md"), *(DOCS / "how-to").glob("*.md")])
BLACK_40 = PressFile.prototype().text.replace("black_level_dn = 0", "black_level_dn = 40")

BEFORE_LINES: Final = 1024
NEEDS: Final[dict[str, tuple[str, ...]]] = {
    "first-inspection": ("prooflight-demo/sample-job.pdf",),
    "press-file": (),
    "office-scanners": (),
    "describe-your-inks": ("measured.txt", "recipes.csv"),
    "calibrate-from-a-chart": ("fine my.press",),
    "teach-a-press": ("press.toml", "long job.pdf"),
    "design-a-camera": (),
    "characterise-a-camera": (),
    "watch": ("job.pdf", "my.press"),
    "hot-folder": ("short job.pdf", "my.press"),
    "services": (),
    "journal": ("job.pdf", "my.press"),
    "evidence": ("short job.pdf", "my.press"),
    "records": (),
    "cluster": (),
    "sheets-and-sets": ("job.pdf", "my.press"),
    "codes": ("my.press", "short job.pdf", "scans"),
    "zones": ("my.press", "short job.pdf", "scans"),
    "text": ("my.press", "short job.pdf", "scans"),
    "feedback": ("my.press", "job.pdf"),
    "gate": ("press.toml", "job.pdf", "my.press"),
    "golden": ("short job.pdf", "my.press", "scans", "goldens", "flatbed", "good.tif"),
    "line-cameras": ("rasters",),
    "console": (),
    "plant": (),
    "causes": ("press.toml", "job.pdf", "my.press"),
    "index": (),
}
"""What stands in the folder of a page before its first command."""
ON_SMALL_PRESETS: Final = {"first-inspection", "press-file"}
"""Pages that build a press of a preset: here of one with an eighth of its pixels, eight times as wide."""


BLOCK = re.compile(
    r"(?:<!-- runs: (?P<how>[^>]*) -->\n\n?)?```(?P<language>\w*)\n(?P<text>.*?)```", re.DOTALL
)
SHOWN = {"toml", "text", "xml"}
"""Languages of blocks that nobody runs."""
SHELL = re.compile(r"[|&;<>$*?`]")
"""What of a command a shell would interpret."""
SERIAL_NUMBER = "23456789"
"""The camera of the page of line cameras, whose place ``PL01`` on loopback takes."""


@dataclass(frozen=True, kw_only=True)
class Block:
    """One fenced block of a page."""

    language: str
    text: str
    options: str = ""
    exit_code: int = 0

    @classmethod
    def of(cls, found: re.Match[str]) -> Block:
        options, code = "", 0
        for part in filter(None, (found["how"] or "").split("; ")):
            word, _, rest = part.partition(" ")
            if word == "with":
                options = rest
            elif word == "exit":
                code = int(rest)
            else:
                pytest.fail(f"nobody knows how to run {part!r}")
        return cls(language=found["language"], text=found["text"], options=options, exit_code=code)

    @property
    def commands(self) -> list[str]:
        """Lines as bash is given them; a comment ends a command, so options go before it."""
        lines = self.text.replace("\\\n", " ").splitlines()
        commands = [re.sub(r"\s+#.*", "", line).replace(SERIAL_NUMBER, "PL01") for line in lines]
        return [
            f"{line} {self.options}" if line.startswith("prooflight ") else line for line in commands if line
        ]

    @property
    def needs_shell(self) -> bool:
        return any(SHELL.search(line) or not line.startswith("prooflight ") for line in self.commands)


def blocks(page: Path) -> list[Block]:
    return [Block.of(found) for found in BLOCK.finditer(page.read_text(encoding="utf-8"))]


@pytest.fixture(scope="session")
def user(session_folder: Path, prototype: PressFile) -> Callable[[str], Path]:
    """Files of a user, each made when first asked for, by the process that needs it first."""
    folder = session_folder / "user"

    def made(name: str) -> Path:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with in_turn(path):
            if not path.exists():
                make(name, path)
        return path

    def make(name: str, path: Path) -> None:
        match name:
            case "press.toml":
                path.write_text(small(prototype.text, coarser=8))
            case "my.press":
                prooflight("press", "build", made("press.toml"), "-o", path, "--designs", 24)
            case "fine my.press":
                file = folder / "fine.toml"
                file.write_text(small(prototype.text, coarser=2))
                prooflight("press", "build", file, "-o", path, "--detector", "none")
            case "job.pdf":
                write_job(path, pages=8)
            case "short job.pdf":
                write_job(path, pages=5)  # a command starts no processes for so few
            case "long job.pdf":
                write_job(path, pages=24)
            case "prooflight-demo/sample-job.pdf":
                write_job(path, pages=3)
            case "scans" | "goldens":
                seed = {"scans": 1, "goldens": 2}[name]
                job, press = made("short job.pdf"), made("my.press")
                prooflight("simulate", job, "--press", press, "-o", path, "--seed", seed)
            case "rasters":
                path.mkdir()
                with PdfJob(made("job.pdf")) as job:
                    for page in rasters(job):
                        write_tiff(page, path / f"{page.number}.tif")
            case "flatbed":
                path.mkdir()
                write_picture(path / "1.tif", spot=False)
                write_picture(path / "2.tif", spot=True)
            case "good.tif":
                write_picture(path, spot=False)
            case "measured.txt":
                write_measured(path)
            case "recipes.csv":
                path.write_text("C,M,Y,K\n50,40,40,0\n0,0,0,100\n")
            case _:
                pytest.fail(f"nobody knows how to make {name}")

    return made


def test_every_page_says_what_it_needs() -> None:
    assert {page.stem for page in PAGES} == set(NEEDS)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_no_command_escapes(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for block in blocks(page):
        assert block.language in {"bash", "python"} | SHOWN, block.text
        if block.language in SHOWN:
            assert "prooflight " not in block.text
    unfenced = BLOCK.sub("", text)
    assert "```" not in unfenced
    assert "<!-- runs" not in unfenced
    assert not re.search(r"^\s{3,}(\$ )?prooflight ", unfenced, re.MULTILINE)


@pytest.fixture
def plugged_in(request: pytest.FixtureRequest, user: Callable[[str], Path], tmp_path: Path) -> Iterator[None]:
    """For the page of line cameras: one on loopback, under which lies what its set-up asks for, and then the job."""
    if request.getfixturevalue("page").stem != "line-cameras":
        yield
        return
    truth = PressFile(Path("true.toml"), re.sub(r"(?m)^pixels = .*", "pixels = 1280", BLACK_40))
    press = build_press(truth, seed=5)
    layout = RulerLayout(width_mm=130.0, height_mm=212.0)
    ruler = Page(cmyk=ruler_raster(layout), dpi=RASTER_DPI, name="ruler", number=1)
    with PdfJob(user("job.pdf")) as job:
        pages = [press.geometry.lay(page) for page in rasters(job)]
    scenes = Scenes.of(truth, press, {"ruler": ruler}, reference_us=2000.0)
    prints = [predict(one, sensors=press.sensors, geometry=press.geometry).expected_dn for one in pages]
    # However long a command takes to read the first blocks of a job, they show what lies before its first sheet.
    before = np.repeat(prints[0][:, :1], BEFORE_LINES, axis=1)
    scenes.images["job"] = np.concatenate([before, *prints], axis=1)
    with scene_camera(scenes, tmp_path / "my.set-up.json"):
        yield


@pytest.mark.usefixtures("plugged_in")
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_command_runs(
    page: Path,
    user: Callable[[str], Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name in NEEDS[page.stem]:
        source, target = user(name), tmp_path / name.rpartition(" ")[2]
        target.parent.mkdir(parents=True, exist_ok=True)
        (shutil.copytree if source.is_dir() else shutil.copy)(source, target)
    monkeypatch.chdir(tmp_path)
    programs = [on_one_processor(tmp_path / "home"), Path(sys.executable).parent, os.environ["PATH"]]
    monkeypatch.setenv("PATH", os.pathsep.join(map(str, programs)))
    for name, value in {"HOME": str(tmp_path / "home"), "XDG_DATA_HOME": "", "XDG_STATE_HOME": ""}.items():
        monkeypatch.setenv(name, value)
    if page.stem in ON_SMALL_PRESETS:
        whole = press_file.preset_text
        monkeypatch.setattr(press_file, "preset_text", lambda name: small(whole(name), coarser=8))
    for block in blocks(page):
        if block.language == "python":
            exec(compile(block.text, f"{page.name}", "exec"), {"__name__": "__main__"})
        elif block.language == "bash":
            code, said = run(block, capsys)
            assert code == block.exit_code, f"{block.text}\n{said}"
    if page.stem == "first-inspection":
        told_truly(tmp_path, capsys)


def on_one_processor(home: Path) -> Path:
    """Return a folder with ``prooflight`` as bash is to find it."""
    program = home / "bin" / "prooflight"
    program.parent.mkdir(parents=True)
    program.write_text(f'#!/bin/sh\nexec {shlex.join(PROOFLIGHT)} "$@"\n')
    program.chmod(0o755)
    return program.parent


def told_truly(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One page of the tutorial is a misprint, the truth says so of that page alone, and no ink is named."""
    scans = json.loads((folder / "scans" / "truth.json").read_text())["scans"]
    assert [(one["page"], one["misprint"] is not None) for one in scans] == [
        ("p0001", False),
        ("p0002", True),
        ("p0003", False),
    ]
    _, out, _ = call(capsys, "inspect", "pages", "scans", "--press", "my.press", "--json")
    verdicts = [json.loads(line) for line in out.splitlines()]
    assert [one["verdict"] for one in verdicts] == ["good", "misprint", "good"]
    assert not set(NAME_OF_INK.values()) & set(verdicts[1]["reason"].split())


def run(block: Block, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Run a block, up to the first command that fails; return its exit code and what it said."""
    if block.needs_shell:
        command = ["bash", "-euo", "pipefail", "-c", "\n".join(block.commands)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
        return done.returncode, f"{done.stdout}\n{done.stderr}"
    said = ""
    for line in block.commands:
        code, out, err = call(capsys, *shlex.split(line)[1:])
        said += f"{out}\n{err}"
        if code:
            break
    return code, said


def prooflight(*arguments: object) -> None:
    assert run_here([str(argument) for argument in arguments]) == 0


def small(press_file: str, *, coarser: int) -> str:
    """A press file with fewer and wider pixels, which see the same field in less light.

    Between sheets lie 40 mm: the edge of a sheet is found to a pixel or two.
    """
    pixels = re.search(r"^pixels = (\d+)", press_file, re.MULTILINE)
    pitch = re.search(r"^pixel_pitch_um = ([\d.]+)", press_file, re.MULTILINE)
    light = re.search(r"^luminance_cd_m2 = ([\d.]+)", press_file, re.MULTILINE)
    assert pixels is not None
    assert pitch is not None
    assert light is not None
    for found, value in (
        (pixels, int(pixels[1]) // coarser),
        (pitch, float(pitch[1]) * coarser),
        (light, float(light[1]) / coarser**2),
    ):
        name = found[0].partition(" =")[0]
        press_file = re.sub(rf"^{name} = [\d.]+", f"{name} = {value}", press_file, flags=re.MULTILINE)
    return press_file + "\n[transport]\nlead_in_mm = 20.0\nlead_out_mm = 20.0\n"


def write_job(path: Path, *, pages: int) -> None:
    """Pages of tints and type, 200 x 120 mm, each laid out in another way."""
    rng = np.random.default_rng(1)
    canvas = Canvas(str(path), pagesize=(200 * mm, 120 * mm))
    for _ in range(pages):
        for _ in range(8):
            canvas.setFillColorCMYK(*rng.uniform(0, 0.9, 3), 0.0)
            x, y, width, height = rng.uniform((8, 8, 15, 8), (150, 90, 40, 25))
            canvas.rect(x * mm, y * mm, width * mm, height * mm, fill=1, stroke=0)
        canvas.setFillColorCMYK(0, 0, 0, 1)
        for _ in range(9):
            canvas.setFont("Helvetica-Bold", rng.uniform(10, 26))
            x, y = rng.uniform((8, 8), (110, 108))
            canvas.drawString(x * mm, y * mm, "".join(rng.choice(list("abcdefghij kmn"), 16)))
        canvas.showPage()
    canvas.save()


def rasters(job: PdfJob) -> list[Page]:
    """The first pages of a job as a press prints them, coarser."""
    return [job.page(number, dpi=600.0) for number in range(1, 4)]


def write_picture(path: Path, *, spot: bool) -> None:
    """A grey page of 60 x 40 mm at 200 dpi as a flatbed sees it."""
    rng = np.random.default_rng(3)
    grey = np.full((315, 472), 230.0)
    for _ in range(60):
        y, x = rng.integers(20, 280), rng.integers(20, 420)
        grey[y : y + 12, x : x + 30] = rng.integers(30, 200)
    if spot:
        grey[150:162, 200:212] = 20
    noisy = np.clip(grey + np.random.default_rng(int(spot)).normal(0, 1, grey.shape), 0, 255)
    tifffile.imwrite(path, noisy.astype(np.uint8), resolution=(200, 200), resolutionunit="INCH")


def write_measured(path: Path) -> None:
    """A chart of 100 patches of the built-in inks, as an instrument exports it."""
    percent = np.random.default_rng(5).choice([0.0, 25.0, 50.0, 75.0, 100.0], size=(100, 4))
    percent[0] = 0.0
    spectra = built_in_inks().reflectance(percent / 100)
    wave = range(380, 731, 10)
    fields = ["SAMPLE_ID", "CMYK_C", "CMYK_M", "CMYK_Y", "CMYK_K", *(f"SPECTRAL_NM{nm}" for nm in wave)]
    rows = [
        "\t".join([f"P{at}", *(f"{value:.6g}" for value in (*recipe, *spectrum))])
        for at, (recipe, spectrum) in enumerate(zip(percent, spectra, strict=True), start=1)
    ]
    path.write_text(
        textwrap.dedent("""\
            CGATS.17
            NUMBER_OF_FIELDS {fields}
            BEGIN_DATA_FORMAT
            {names}
            END_DATA_FORMAT
            NUMBER_OF_SETS {sets}
            BEGIN_DATA
            {rows}
            END_DATA
        """).format(fields=len(fields), names="\t".join(fields), sets=len(rows), rows="\n".join(rows))
    )

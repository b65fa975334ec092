"""``prooflight study figures`` and ``study tables``, as a user calls them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from tests.cli.calls import call

from prooflight.pages.files import write_tiff
from prooflight.press.press_file import PressFile
from prooflight_studies.paper import figures
from prooflight_studies.paper.figures import Exhibit

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.pages.raster import Page


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory, make_page: Callable[..., Page]) -> Path:
    """A folder with a press file of 400 pixels and a job of one page."""
    folder = tmp_path_factory.mktemp("rig")
    text = PressFile.prototype().text.replace("pixels = 2048 ", "pixels = 400 ")
    (folder / "small.toml").write_text(text)
    write_tiff(make_page(3), folder / "job" / "p0001.tif")
    return folder


def test_study_figures_passes_on_what_was_asked_for_and_lists_what_was_written(
    rig: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[PressFile, Exhibit, Path, int]] = []

    def draw(
        press_file: PressFile, exhibit: Exhibit, out: Path, *, seed: int, progress: object
    ) -> list[Path]:
        asked.append((press_file, exhibit, out, seed))
        return [out / "figure.png"]

    monkeypatch.setattr(figures, "draw_figures", draw)  # drawing has tests of its own
    options = (
        "--press-file",
        rig / "small.toml",
        "--job",
        rig / "job",
        "--page",
        3,
        "--misprint",
        "streak:0.2",
    )
    code, out, _ = call(capsys, "study", "figures", *options, "--seed", 8, "-o", tmp_path, "--json")
    assert code == 0
    assert json.loads(out) == [str(tmp_path / "figure.png")]
    ((press_file, exhibit, folder, seed),) = asked
    assert (press_file.name, folder, seed) == ("small", tmp_path, 8)
    assert (exhibit.job, exhibit.page) == (rig / "job", 3)
    assert (exhibit.misprint.kind, exhibit.misprint.severity) == ("streak", 0.2)


@pytest.mark.parametrize(
    ("extra", "says"),
    [(("--page", "2"), "there is no page 2"), (("--misprint", "fire"), "there is no kind 'fire'")],
)
def test_study_figures_refuses_what_is_not_there(
    rig: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], extra: tuple[str, str], says: str
) -> None:
    arguments = ("--press-file", rig / "small.toml", "--job", rig / "job", "-o", tmp_path, *extra)
    code, _, err = call(capsys, "study", "figures", *arguments)
    assert code == 2
    assert says in err.replace("\n", " ")
    assert not list(tmp_path.iterdir())


def test_study_tables_gives_its_rows(rig: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ("--press-file", rig / "small.toml", "--job", rig / "job", "-o", tmp_path, "--json")
    code, out, _ = call(capsys, "study", "tables", *arguments)
    assert code == 0
    rows = json.loads(out)
    assert [row["colours"] for row in rows] == ["random and ramps", "job"]
    assert max(row["rms_sigma"] for row in rows) <= 0.10
    assert (tmp_path / "tables.md").is_file()

"""A detector of another package, registered by an entry point, is used like our own."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from tests.cli.calls import PROOFLIGHT

import prooflight as pf
from prooflight.detectors import registry
from prooflight.errors import RequestError
from prooflight.pages.files import write_tiff
from prooflight.scans.recorded import write_scan

if TYPE_CHECKING:
    from collections.abc import Callable

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "write_a_detector.py"


def install(site: Path, name: str, entry_points: str, text: str) -> None:
    """A package as pip leaves it behind, in a folder."""
    (site / f"{name}.py").write_text(text, encoding="utf-8")
    told = site / f"{name}-1.0.dist-info"
    told.mkdir()
    (told / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n", encoding="utf-8")
    (told / "entry_points.txt").write_text(f"[{registry.GROUP}]\n{entry_points}\n", encoding="utf-8")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the example's package, and one that is broken."""
    site = tmp_path_factory.mktemp("site")
    install(site, "my_package", "squares = my_package:detector", EXAMPLE.read_text(encoding="utf-8"))
    install(site, "other_package", "broken = other_package:gone\nmatched_filter = other_package:gone", "")
    return site


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory, press: pf.Press, make_page: Callable[..., pf.Page]) -> Path:
    """A press, a job of two pages, and scans of them; the second shows a hole."""
    rig = tmp_path_factory.mktemp("rig")
    (rig / "scans").mkdir()
    press.save(rig / "x.press")
    for number, misprint in ((1, None), (2, "missing-content:0.9")):
        page = make_page(number, number=number, height_mm=30.0)
        write_tiff(page, rig / "job" / f"{page.name}.tif")
        scan = pf.simulate(page, press, misprint=misprint, seed=number)
        write_scan(rig / "scans" / f"{page.name}.tif", scan.dn, facts={})
    return rig


def command(site: Path, *words: object) -> subprocess.CompletedProcess[str]:
    paths = os.pathsep.join(filter(None, (str(site), os.environ.get("PYTHONPATH"))))
    return subprocess.run(
        [*PROOFLIGHT, *map(str, words)],
        env={**os.environ, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )


def rows_of(done: subprocess.CompletedProcess[str]) -> list[dict[str, Any]]:
    """Without the phases that ``watch`` tells between them."""
    rows = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    return [row for row in rows if "phase" not in row]


def test_inspect_uses_it(site: Path, rig: Path) -> None:
    words = (rig / "job", rig / "scans", "--press", rig / "x.press", "--detector", "squares", "--json")
    done = command(site, "inspect", *words)
    assert done.returncode == 1, done.stderr  # a misprint
    rows = rows_of(done)
    assert [(row["verdict"], row["detector"]) for row in rows] == [
        ("good", "squares"),
        ("misprint", "squares"),
    ]
    assert rows[1]["regions"]


def test_watch_uses_it_and_its_verdicts_are_replayed(site: Path, rig: Path, press: pf.Press) -> None:
    with pf.open_job(rig / "job", press) as job:
        lines = press.geometry.lines(job.page(1).height_mm)
    journal = rig / "runs.sqlite"
    done = command(
        site, "watch", rig / "job", "--press", rig / "x.press", "--source", "drum", "--world", "ideal",
        "--sheets", 4, "--misprint", "spots-voids:0.9", "--every", 2, "--trigger", lines,
        "--detector", "squares", "--journal", journal, "--keep", "all", "--json",
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    assert [row["verdict"] for row in rows_of(done)] == ["good", "misprint"] * 2
    assert {row["detector"] for row in rows_of(done)} == {"squares"}
    again = command(site, "run", "replay", 1, 1, "--press", rig / "x.press", "--journal", journal, "--json")
    assert again.returncode == 0, again.stderr
    assert rows_of(again)[0]["same"] is True


def test_help_and_errors_name_it(site: Path, monkeypatch: pytest.MonkeyPatch, press: pf.Press) -> None:
    assert "squares" not in registry.names()
    monkeypatch.syspath_prepend(str(site))
    assert registry.names() == (*registry.BUILT_IN, "broken", "squares")
    with pytest.raises(RequestError, match=r"choose from chi-square, .*squares"):
        registry.detector("circles", press)
    assert "squares" in command(site, "inspect", "--help").stdout


def test_a_package_that_is_broken_is_named_and_hinders_no_other(
    site: Path, monkeypatch: pytest.MonkeyPatch, press: pf.Press
) -> None:
    monkeypatch.syspath_prepend(str(site))
    with pytest.raises(
        RequestError, match=r"'broken' \(other_package:gone\) cannot be loaded: AttributeError"
    ):
        registry.detector("broken", press)
    assert registry.detector("chi-square", press).name == "chi-square"
    with pytest.raises(
        RequestError, match="was not trained for 'matched_filter'"
    ):  # and nobody takes our names
        registry.detector("matched_filter", press)


def test_two_packages_of_one_name_are_refused(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, press: pf.Press
) -> None:
    install(tmp_path, "third_package", "broken = third_package:other", "")
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(RequestError, match="third_package:other"):
        registry.detector("broken", press)

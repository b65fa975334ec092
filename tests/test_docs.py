"""The documents name things that exist, and lists in them are whole."""

from __future__ import annotations

import importlib
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAPER_MAP = (DOCS / "paper-map.md").read_text()
ARCHITECTURE = (DOCS / "ARCHITECTURE.md").read_text()
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text()
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
LAYERS = [layer for of in PROJECT["tool"]["importlinter"]["contracts"][:2] for layer in of["layers"]]
ROOMS = {room.strip() for layer in LAYERS for room in layer.split("|")} - {"__main__"}
PACKAGES = [
    ROOT / "src" / "prooflight",
    ROOT / "packages" / "line" / "src" / "prooflight_line",
    ROOT / "packages" / "console" / "src",
    ROOT / "studies" / "prooflight_studies",
]


def named_modules(text: str) -> list[str]:
    """Dotted names in it that begin with a room or with the studies' harness."""
    names = set(re.findall(r"`([a-z_]+(?:\.[a-z_0-9]+)+)`", text))
    return sorted(
        name for name in names if name.partition(".")[0] in ROOMS | {"harness", "prooflight_console"}
    )


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`(prooflight\w*\.[\w.]+)`", PAPER_MAP))))
def test_paper_map_names_exist(name: str) -> None:
    parts = name.split(".")
    for split in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:split]))
        except ModuleNotFoundError:
            continue
        for attribute in parts[split:]:
            found = getattr(found, attribute)
        return
    pytest.fail(f"{name} cannot be imported")


TEST_FILES = re.findall(r"`((?:tests|validation|packages|studies)/[\w/]+\.py)`", PAPER_MAP)


@pytest.mark.parametrize("path", sorted(set(TEST_FILES)))
def test_paper_map_tests_exist(path: str) -> None:
    assert (ROOT / path).is_file()


@pytest.mark.parametrize("name", named_modules(ARCHITECTURE + CONTRIBUTING))
def test_modules_that_the_documents_name_exist(name: str) -> None:
    at = Path(*name.split("."))
    assert any((package / at).is_dir() or (package / at).with_suffix(".py").is_file() for package in PACKAGES)


@pytest.mark.parametrize("room", sorted(ROOMS))
def test_the_architecture_shows_every_room(room: str) -> None:
    picture = ARCHITECTURE.split("```")[1]
    assert re.search(rf"^[ |]*(\w+ \| )*{room}\b", picture, re.MULTILINE)


def test_no_document_names_a_missing_file() -> None:
    for document in [*ROOT.glob("*.md"), *sorted(DOCS.rglob("*.md"))]:
        for target in re.findall(r"\]\((?!https?:|#)([^)#]+)", document.read_text()):
            assert (document.parent / target).exists(), f"{document.name} points at {target}"


def test_every_decision_is_listed() -> None:
    folder = DOCS / "explanation" / "decisions"
    listed = re.findall(r"^(\d+)\. \[(.+)\]\((.+)\)$", (folder / "README.md").read_text(), re.MULTILINE)
    decisions = sorted(folder.rglob("0*.md"), key=lambda path: path.name)
    titles = [(path, path.read_text().partition("\n")[0]) for path in decisions]
    assert [(f"# {number}. {title}", name) for number, title, name in listed] == [
        (title, path.relative_to(folder).as_posix()) for path, title in titles
    ]


def test_every_target_that_contributing_names_exists() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    assert set(re.findall(r"make ([a-z-]+)", CONTRIBUTING)) <= targets


def test_the_version_is_the_changelog_s() -> None:
    from prooflight import __version__

    assert PROJECT["project"]["version"] == __version__
    assert re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)[1] == __version__

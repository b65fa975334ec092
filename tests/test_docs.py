"""The documents name things that exist."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAPER_MAP = (ROOT / "docs" / "paper-map.md").read_text()


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`(prooflight\.[\w.]+)`", PAPER_MAP))))
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


@pytest.mark.parametrize("path", sorted(set(re.findall(r"`((?:tests|validation)/[\w/]+\.py)`", PAPER_MAP))))
def test_paper_map_tests_exist(path: str) -> None:
    assert (ROOT / path).is_file()


def test_no_document_names_a_missing_file() -> None:
    for document in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        for target in re.findall(r"\]\((?!https?:|#)([^)#]+)", document.read_text()):
            assert (document.parent / target).exists(), f"{document.name} points at {target}"

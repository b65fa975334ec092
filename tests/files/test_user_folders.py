"""Folders of a user's files."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from prooflight.files.user_folders import XDG, user_folder

if TYPE_CHECKING:
    from typing import Literal

KINDS: tuple[Literal["cache", "data", "state"], ...] = ("cache", "data", "state")


@pytest.mark.parametrize("kind", KINDS)
def test_variables_name_the_folder_and_home_has_it_without_them(
    kind: Literal["cache", "data", "state"], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    variable, within_home = XDG[kind]
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv(variable, raising=False)
    assert user_folder(kind) == tmp_path / within_home / "prooflight"
    monkeypatch.setenv(variable, str(tmp_path / "own"))
    assert user_folder(kind) == tmp_path / "own" / "prooflight"


@pytest.mark.parametrize("kind", KINDS)
def test_windows_has_one_folder_for_all(
    kind: Literal["cache", "data", "state"], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path))
    assert user_folder(kind) == tmp_path / "prooflight"
    monkeypatch.delenv("LOCALAPPDATA")
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    assert user_folder(kind) == tmp_path / "AppData" / "Local" / "prooflight"

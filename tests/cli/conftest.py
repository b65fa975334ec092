from __future__ import annotations

import sys
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from tests.cli.warning_jobs import FRONT_END

from prooflight.pages.pdf.engine import RipEngine

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.press.artefact import Press


@pytest.fixture(scope="session")
def press_file(press: Press, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small press as an artefact."""
    path = tmp_path_factory.mktemp("press") / "small.press"
    press.save(path)
    return path


@pytest.fixture(scope="session")
def warning_press(press: Press, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small press, whose front end says something of every second page."""
    folder = tmp_path_factory.mktemp("front-end")
    script = folder / "front-end.py"
    script.write_text(FRONT_END)
    command = (sys.executable, str(script), "{pdf}", "{page}", "{dpi}", "{out}")
    replace(press, rip_engine=RipEngine(name="command", command=command)).save(folder / "front-end.press")
    return folder / "front-end.press"

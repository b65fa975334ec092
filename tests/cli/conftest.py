from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.press.artefact import Press


@pytest.fixture(scope="session")
def press_file(press: Press, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small press as an artefact."""
    path = tmp_path_factory.mktemp("press") / "small.press"
    press.save(path)
    return path

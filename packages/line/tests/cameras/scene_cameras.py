"""A camera on loopback that sees scenes, to plug in; see ``scene_peer``."""

from __future__ import annotations

import fcntl
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from prooflight_line.cameras.aravis import Aravis

if TYPE_CHECKING:
    from collections.abc import Iterator

    from packages.line.tests.cameras.scenes import Scenes

PEER = Path(__file__).with_name("scene_peer.py")


@contextmanager
def scene_camera(scenes: Scenes, follow: Path) -> Iterator[None]:
    """follow: says what lies under it. One camera at a time on this machine."""
    if lacks := Aravis().lacks:
        pytest.skip(lacks)
    with (
        tempfile.TemporaryDirectory() as name,
        Path(tempfile.gettempdir(), "prooflight-gige.lock").open("w") as lock,
    ):
        fcntl.flock(lock, fcntl.LOCK_EX)
        scenes.save(Path(name, "scenes.npz"))
        arguments = [str(Path(name, "scenes.npz")), str(Path(name, "description.xml")), str(follow)]
        process = subprocess.Popen(
            [sys.executable, str(PEER), *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert process.stdout is not None
        try:
            assert process.stdout.readline() == "ready\n"
            yield
        finally:
            process.kill()
            process.communicate()

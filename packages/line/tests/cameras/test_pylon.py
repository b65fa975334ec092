"""Cameras through pylon: its emulated camera, which plays our lines from image files and fails buffers when told."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest
from packages.line.tests.cameras.peers import faults_of, numbered_lines, numbers, read

from prooflight.errors import RequestError
from prooflight.scans.camera_settings import CameraSettings
from prooflight_line.cameras.backends import camera_named, list_cameras, opened, ready
from prooflight_line.cameras.source import CameraLines

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight_line.cameras.camera import Camera

pytest.importorskip("pypylon", reason="pypylon is not installed")

ID = "Basler-Emulation-0815-0000"
NAME = "pylon:0815-0000"
LINES, PIXELS = 64, 512


@pytest.fixture(autouse=True)
def _one_emulated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYLON_CAMEMU", "1")


def playing(lines: np.ndarray, folder: Path, *, blocks_per_s: float = 200.0) -> CameraSettings:
    """Settings by which the camera plays lines of bytes, a file a block, over and over."""
    for at in range(0, len(lines), LINES):
        cv2.imwrite(str(folder / f"{at:06}.png"), lines[at : at + LINES])
    return CameraSettings(
        pixel_format="Mono8",
        block_lines=LINES,
        features={
            "Width": PIXELS,
            "ImageFilename": str(folder),
            "ImageFileMode": "On",
            "TestImageSelector": "Off",
            "AcquisitionFrameRateEnable": True,
            "AcquisitionFrameRateAbs": blocks_per_s,
        },
    )


def test_what_is_played_comes_to_the_byte(tmp_path: Path) -> None:
    lines = numbered_lines(16 * LINES, PIXELS)
    settings = playing(lines, tmp_path)
    source = CameraLines(lambda: ready(camera_named(NAME), settings, where="my.toml"), name=ID)
    blocks = read(source, 40 * LINES)
    assert not faults_of(blocks)
    came = np.concatenate([block.lines[0] for block in blocks])
    first = int(numbers(blocks[0].lines)[0])
    np.testing.assert_array_equal(came, lines[(np.arange(len(came)) + first) % len(lines)])


def test_a_buffer_that_failed_is_a_fault_of_its_lines(tmp_path: Path) -> None:
    lines = numbered_lines(64 * LINES, PIXELS)
    settings = playing(lines, tmp_path, blocks_per_s=50.0)
    known: list[Camera] = []

    def again() -> Camera:
        known.append(ready(camera_named(NAME), settings, where="my.toml"))
        return known[-1]

    source, blocks = CameraLines(again, name=ID), []
    for block in source.blocks():
        blocks.append(block)
        if len(blocks) == 4:
            known[-1].set("ForceFailedBufferCount", "3")
            known[-1].set("ForceFailedBuffer", "-")
        if faults_of(blocks) and len(blocks) >= 20:
            source.close()
    faults = faults_of(blocks)
    assert {fault.kind for fault in faults} == {"lost-packets"}
    assert sum(fault.lines for fault in faults) == 3 * LINES
    first = int(numbers(blocks[0].lines)[0]) - blocks[0].first_line
    for block in blocks:  # behind the loss, the count is still the camera's own
        wanted = (np.arange(block.first_line, block.next_line) + first) % len(lines)
        np.testing.assert_array_equal(numbers(block.lines), wanted)


def test_a_camera_is_found_and_describes_itself() -> None:
    (one,) = list_cameras("pylon")
    assert (one.id, one.serial, one.backend) == (ID, "0815-0000", "pylon")
    camera = opened(one)
    features = camera.features()
    assert features["PixelFormat"].choices[:2] == ("Mono8", "Mono10")
    assert features["Width"].least == 1
    camera.set("Height", "77")
    height = camera.feature("Height")
    assert height is not None
    assert height.value == "77"
    assert camera.feature("Tallness") is None
    camera.close()


def test_what_it_lacks_is_said_in_one_line() -> None:
    with pytest.raises(
        RequestError, match=rf"^my.toml, camera.pixel_format: {ID} has no PixelFormat 'Mono9'; it has Mono8, "
    ):
        ready(camera_named(NAME), CameraSettings(pixel_format="Mono9"), where="my.toml")
    with pytest.raises(
        RequestError, match=r"cannot start a line by a trigger: its TriggerSelector has FrameBurstStart"
    ):
        ready(camera_named(NAME), CameraSettings(trigger="encoder"), where="my.toml")

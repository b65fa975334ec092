"""Two GigE Vision cameras on loopback as the sensors of one press, in step by the triggers that they count."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from packages.line.tests.cameras.peers import faults_of, gige_cameras, named_and_came, numbered_lines, numbers
from packages.line.tests.cameras.test_silence import Clock, FakeCamera

from prooflight.errors import RequestError, ScanError
from prooflight.scans.alignment import SensorOffset
from prooflight.scans.camera_settings import CameraSettings
from prooflight_line.cameras import backends
from prooflight_line.cameras.backends import camera_named
from prooflight_line.cameras.camera import Camera, Grab
from prooflight_line.cameras.several import SeveralCameras
from prooflight_line.cameras.source import CameraLines

PIXELS, LINES = 256, 64
RATES_HZ = 8_000.0, 8_400.0
"""The second's own clock runs ahead: it sends lines sooner, which must not matter."""


class Counted:
    """A camera that says the count of triggers: its lines hold their number, which is that."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera

    def __getattr__(self, name: str) -> Any:
        return getattr(self._camera, name)

    def grab(self, timeout_s: float) -> Grab | None:
        one = self._camera.grab(timeout_s)
        if one is None or one.missing:
            return one
        last = one.data[-PIXELS:][None, None, :4].astype(np.uint16)
        return replace(one, triggers=int(numbers(last)[0]) + 1)


def source(number: int, settings: CameraSettings) -> CameraLines:
    def ready() -> Any:
        return Counted(backends.ready(camera_named(f"PL{number + 1:02}"), settings, where="my.toml"))

    return CameraLines(ready, name=f"camera {number + 1}", settings=settings, reopen_s=0.05)


def both() -> list[CameraLines]:
    return [
        source(
            number,
            CameraSettings(
                block_lines=LINES, trigger="encoder", line_rate_hz=rate_hz, features={"Width": PIXELS}
            ),
        )
        for number, rate_hz in enumerate(RATES_HZ)
    ]


@pytest.mark.parametrize("lost", [0.0, 0.02])
def test_two_cameras_stay_in_step_whatever_is_lost_and_however_their_clocks_run(lost: float) -> None:
    lines = numbered_lines(1 << 15, PIXELS)
    wholes = 0, 3
    with gige_cameras(lines, lines, lost=lost):
        together = SeveralCameras(both(), [[SensorOffset()], [SensorOffset(lines=3.4)]])
        assert (together.sensors, together.pixels) == (2, PIXELS)
        blocks = []
        for block in together.blocks():
            blocks.append(block)
            if block.next_line > 150 * LINES:
                together.close()
        healths = together.healths()
    begun = int(numbers(blocks[0].lines[:1])[0]) - blocks[0].first_line
    for sensor, whole in enumerate(wholes):
        own = [
            replace(block, faults=tuple(one for one in block.faults if one.sensor == sensor))
            for block in blocks
        ]
        named, _ = named_and_came(own)
        assert named or not lost  # a machine that is busy with other work may lose lines of its own
        for block in blocks:
            wanted = np.arange(block.first_line, block.next_line)
            seen = [line not in named for line in wanted.tolist()]
            came = numbers(block.lines[sensor : sensor + 1])
            np.testing.assert_array_equal(came[seen], (wanted + begun + whole)[seen])
    assert set(healths) == {"camera 1", "camera 2"}
    assert all(health.lines > 100 * LINES for health in healths.values())


def test_one_of_two_cameras_that_dies_leaves_the_other_in_step_and_is_named() -> None:
    """It counts from nought when it is back, so that nobody knows its lines: that is said of every sheet."""
    lines, said = numbered_lines(1 << 15, PIXELS), list[str]()
    with gige_cameras(lines, lines) as (_, second):
        cameras = both()
        together = SeveralCameras(
            cameras, [[SensorOffset()], [SensorOffset()]], tell=lambda kind, _text: said.append(kind)
        )
        blocks, back = [], 0
        for block in together.blocks():
            blocks.append(block)
            if len(blocks) == 40:
                second.unplug()
                second.plug_in()
            if "camera-back" in said:
                back += 1
            if back > 60:
                together.close()
    assert said == ["camera-away", "camera-back"]
    faults = [fault for fault in faults_of(blocks) if fault.sensor == 1]
    assert {fault.kind for fault in faults} == {"camera-away"}
    assert {fault.sensor for fault in faults_of(blocks)} == {1}
    assert faults[0].detail.startswith("camera 2, sensor 2: the camera ")
    assert faults[-1].detail.endswith("the places of its lines are unknown")
    counts = np.concatenate([np.arange(block.first_line, block.next_line) for block in blocks])
    np.testing.assert_array_equal(counts, np.arange(len(counts)))  # the first camera lost none
    came = np.concatenate([numbers(block.lines[:1]) for block in blocks])
    np.testing.assert_array_equal(came, counts + came[0])


def fakes(**asked: Any) -> list[CameraLines]:
    clock = Clock()
    return [
        CameraLines(lambda: FakeCamera(clock), name=name, settings=CameraSettings(**asked)) for name in "AB"
    ]


def test_cameras_that_do_not_go_together_are_refused_in_one_line() -> None:
    none = [[SensorOffset()], [SensorOffset()]]
    with pytest.raises(
        RequestError, match=r"^A: runs free, and so cannot be synchronised with another camera; trigger"
    ):
        SeveralCameras(fakes(trigger="free"), none)
    with pytest.raises(RequestError, match=r"^B: sends 1 sensors, and offsets of 2 are stated; "):
        SeveralCameras(fakes(), [[SensorOffset()], [SensorOffset()] * 2])


def test_cameras_that_tell_no_count_must_be_started_while_the_press_stands() -> None:
    together = SeveralCameras(fakes(trigger="encoder"), [[SensorOffset()], [SensorOffset()]])
    with pytest.raises(
        ScanError, match=r"sent lines before all cameras were started, and does not report its count"
    ):
        for _ in together.blocks():
            pass

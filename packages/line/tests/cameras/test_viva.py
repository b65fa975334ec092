"""Cameras through viva-genicam: Aravis' simulated camera, which shares no code with it, and its own."""

from __future__ import annotations

import fcntl
import tempfile
import threading
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from packages.line.tests.cameras.peers import (
    faults_of,
    gige_camera,
    named_and_came,
    numbered_lines,
    numbers,
    read,
)

from prooflight.scans.camera_settings import CameraSettings
from prooflight_line.cameras import viva
from prooflight_line.cameras.backends import camera_named, opened, ready
from prooflight_line.cameras.setting_up import temperature_c
from prooflight_line.cameras.source import CameraLines
from prooflight_line.cameras.viva import OVERHEAD, empty_packets

if TYPE_CHECKING:
    from collections.abc import Iterator

    from prooflight_line.cameras.camera import Camera

testing = pytest.importorskip("viva_genicam.testing", reason="viva-genicam is not installed")

ADDRESS = "127.0.0.1"
PIXELS = 512


@contextmanager
def viva_camera(**asked: Any) -> Iterator[Any]:
    """viva's own camera, in this process; one camera at a time on this machine."""
    with Path(tempfile.gettempdir(), "prooflight-gige.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with testing.FakeGigeCamera(width=PIXELS, height=64, fps=50, **asked) as camera:
            yield camera


def source(settings: CameraSettings | None = None, **told: Any) -> CameraLines:
    def again() -> Camera:
        return ready(camera_named(f"viva:{ADDRESS}"), settings or CameraSettings(), where="my.toml")

    return CameraLines(again, name="cam", **told)


@pytest.mark.parametrize("lost", [0.0, 0.01])
def test_viva_reads_what_aravis_plays_and_names_what_it_lost(lost: float) -> None:
    """To the byte, and over the turn of the block numbers after 135 blocks; a busy machine may lose some by itself."""
    lines = numbered_lines(4096, PIXELS)
    lines[:, 4:] |= 1  # no packet is all nought
    asked = CameraSettings(block_lines=64, line_rate_hz=4_000.0, features={"Width": PIXELS})
    with gige_camera(lines, lost=lost):
        blocks = read(source(asked), 180 * 64)
    first = int(numbers(blocks[0].lines)[0]) - blocks[0].first_line
    named, came = named_and_came(blocks)
    assert named or not lost
    assert named.isdisjoint(came)
    assert named | came == set(range(max(came) + 1))
    for block in blocks:
        played = lines[(np.arange(block.first_line, block.next_line) + first) % len(lines)]
        np.testing.assert_array_equal(block.lines[0], played)


def test_a_packet_that_was_never_sent_is_a_fault_of_its_lines() -> None:
    """The third block's second packet."""
    with viva_camera(drop_packets=[(3, 2)], packet_resend=False):
        camera = opened(camera_named(f"viva:{ADDRESS}"))
        packet = camera.feature("GevSCPSPacketSize")
        camera.close()
        assert packet is not None
        blocks = read(source(), 5 * 64)
        held = int(packet.value) - OVERHEAD
    (fault,) = (fault for fault in faults_of(blocks) if fault.kind == "lost-packets")
    assert (fault.first_line, fault.next_line) == (128 + held // PIXELS, 128 - (-2 * held // PIXELS))


def test_a_packet_that_is_sent_again_is_no_loss() -> None:
    with viva_camera(drop_packets=[(3, 2)]):
        lines = source()
        blocks = read(lines, 5 * 64)
    assert not faults_of(blocks)


def test_a_camera_that_another_program_has_taken_is_gone_though_its_lines_go_on() -> None:
    """Within 100 blocks, which are 2 s."""
    said, since = list[tuple[str, str]](), 0
    with viva_camera() as camera:
        lines = source(tell=lambda *told: said.append(told), reopen_s=0.05)
        for number, _ in enumerate(lines.blocks()):
            if number == 10:
                camera.revoke_control()
            since += number > 10 and not said
            if number > 10 and len(said) == 2:
                lines.close()
    assert [kind for kind, _ in said] == ["camera-away", "camera-back"]
    assert "another program controls it" in said[0][1]
    assert 0 < since < 100


@pytest.mark.parametrize(("trigger", "why"), [("free", "has sent no line"), ("encoder", "has not answered")])
def test_lines_that_stop_are_noticed_while_the_camera_is_slow_to_answer(
    trigger: Any, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its temperature takes it 5 s to tell; a camera that waits for an encoder is asked behind that."""
    answered, said = threading.Event(), list[tuple[str, bool]]()

    def temperature(camera: Camera) -> float | None:
        try:
            return temperature_c(camera)
        finally:
            answered.set()

    monkeypatch.setattr(viva, "temperature_c", temperature)
    never_sent = [(block, packet) for block in range(30, 600) for packet in range(30)]
    slow = {testing.FakeGigeCamera.REGISTERS["DeviceTemperature"]: 5.0}
    with viva_camera(drop_packets=never_sent, packet_resend=False, delay_ack=slow):
        lines = CameraLines(
            lambda: ready(camera_named(f"viva:{ADDRESS}"), CameraSettings(), where="my.toml"),
            name="cam",
            settings=CameraSettings(trigger=trigger),
        )

        def tell(_kind: str, text: str) -> None:
            said.append((text, answered.is_set()))
            lines.close()

        lines.tell = tell
        for number, _ in enumerate(lines.blocks()):
            if number == 10:
                lines.health()
    ((text, was_answered),) = said
    assert why in text
    assert not was_answered


def test_empty_packets_are_found_by_whole_packets() -> None:
    data = np.ones(95, np.uint8)
    data[20:40] = data[90:] = 0
    assert empty_packets(data, 10) == ((20, 40), (90, 95))
    data[12] = 0  # a dark pixel is no loss
    assert empty_packets(data, 10) == ((20, 40), (90, 95))
    assert empty_packets(data, 0) == ((0, 95),)

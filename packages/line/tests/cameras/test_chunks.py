"""What cameras send with a block: over a wire from viva's simulated camera, and by bytes laid out as GenICam has them.

No simulated camera counts line triggers or encoder steps: viva's sends a block's number and its time, Aravis' nothing.
Triggers and encoder are read from bytes here, at the places that descriptions of line cameras give them.
"""

from __future__ import annotations

import struct
import threading
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from packages.line.tests.cameras.test_viva import ADDRESS, viva_camera

from prooflight.scans.camera_settings import CameraSettings
from prooflight_line.cameras import viva
from prooflight_line.cameras.aravis import FEWEST_BUFFERS, Aravis
from prooflight_line.cameras.backends import camera_named, ready
from prooflight_line.cameras.setting_up import temperature_c
from prooflight_line.cameras.viva import ChunkPlace, chunk_places

if TYPE_CHECKING:
    from collections.abc import Iterable

    from prooflight_line.cameras.camera import Camera, Grab

testing = pytest.importorskip("viva_genicam.testing", reason="viva-genicam is not installed")

DESCRIPTION = """
<RegisterDescription xmlns="http://www.genicam.org/GenApi/Version_1_1">
  <Integer Name="ChunkLineTriggerCount"><pValue>Through</pValue></Integer>
  <Integer Name="Through"><pValue>TriggerRegister</pValue></Integer>
  <IntReg Name="TriggerRegister">
    <Address>-4</Address><Length>4</Length><pPort>Counts</pPort><Sign>Unsigned</Sign><ORDER>BigEndian</ORDER>
  </IntReg>
  <IntReg Name="ChunkEncoderValue">
    <Address>0x2</Address><Length>4</Length><pPort>Counts</pPort><Sign>Signed</Sign><ORDER>LittleEndian</ORDER>
  </IntReg>
  <IntReg Name="Height"><Address>0x104</Address><Length>4</Length><pPort>Device</pPort></IntReg>
  <IntSwissKnife Name="ChunkFrameID"><Formula>A + 1</Formula></IntSwissKnife>
  <Integer Name="ChunkTimestamp"><pValue>ChunkTimestamp</pValue></Integer>
  <Port Name="Device"/>
  <Port Name="Counts"><ChunkID>A5A50100</ChunkID></Port>
</RegisterDescription>
""".replace("ORDER", "".join(("Endian", "ess")))  # the standard spells it so


def test_numbers_are_read_where_a_description_says_they_lie() -> None:
    """Two numbers of one chunk: one from its start, one from its end and behind two nodes."""
    places = chunk_places(DESCRIPTION, ("ChunkLineTriggerCount", "ChunkEncoderValue"))
    chunks = {0xA5A50100: struct.pack("<Hi", 7, -70_000) + struct.pack(">I", 4_000_000_000), 1: b"image"}
    assert {name: place.read(chunks) for name, place in places.items()} == {
        "ChunkLineTriggerCount": 4_000_000_000,
        "ChunkEncoderValue": -70_000,
    }


@pytest.mark.parametrize("chunks", [{}, {0xA5A50100: b""}, {0xA5A50100: b"abc"}, {1: bytes(16)}])
def test_a_block_without_the_chunk_or_with_a_shorter_one_says_nothing(chunks: dict[int, bytes]) -> None:
    places = chunk_places(DESCRIPTION, ("ChunkLineTriggerCount", "ChunkEncoderValue"))
    assert [place.read(chunks) for place in places.values()] == [None, None]


def test_what_is_no_plain_number_of_a_chunk_has_no_place() -> None:
    """A register of the camera, a number that is reckoned, one that leads to itself, and one that is not there."""
    assert chunk_places(DESCRIPTION, ("Height", "ChunkFrameID", "ChunkTimestamp", "ChunkGain")) == {}


@pytest.mark.parametrize("register", [{"Address": "x", "Length": "4"}, {"Address": "0"}, {}])
def test_a_register_that_is_not_whole_has_no_place(register: dict[str, str]) -> None:
    assert ChunkPlace.of(register, {"ChunkID": "1"}) is None


def open_camera(backend: str) -> Camera:
    """viva's simulated camera does not answer Aravis' search on loopback, and does where it is called by address."""
    one = camera_named(f"viva:{ADDRESS}")
    if backend == "aravis":
        if lacks := Aravis().lacks:
            pytest.skip(lacks)
        one = replace(one, id=ADDRESS, backend=backend)
    return ready(one, CameraSettings(chunks=True), where="my.toml")


def grabbed(camera: Camera, blocks: int) -> list[Grab]:
    found: list[Grab] = []
    for _ in range(20 * blocks):
        grab = camera.grab(1.0)
        found += [] if grab is None else [grab]
        if len(found) == blocks:
            break
    return found


def assert_told(blocks: Iterable[Grab]) -> None:
    """Every block's own number, and a time that goes on."""
    times = []
    for block in blocks:
        assert block.chunks["ChunkFrameID"] == block.block_id
        times.append(block.chunks["ChunkTimestamp"])
    assert len(times) > 3
    assert times == sorted(set(times))


@pytest.mark.parametrize("backend", ["viva", "aravis"])
def test_chunks_come_over_the_wire(backend: str) -> None:
    """Of one camera to libraries that share no code."""
    with viva_camera():
        camera = open_camera(backend)
        camera.start()
        blocks = grabbed(camera, 5)
        camera.close()
    assert_told(blocks)


@pytest.mark.parametrize("backend", ["viva", "aravis"])
def test_packets_that_were_sent_again_are_counted(backend: str) -> None:
    """Two of them; of buffers that wait only Aravis tells: all but the one whose block was taken."""
    with viva_camera(drop_packets=[(3, 2), (5, 4)]):
        camera = open_camera(backend)
        before = camera.health()
        camera.start()
        blocks = grabbed(camera, 8)
        health = camera.health()
        camera.close()
    assert [block.missing for block in blocks] == [()] * 8
    assert (before.resends, health.resends) == (0, 2)
    assert before.buffers_free == 0
    assert (health.buffers_free > FEWEST_BUFFERS) == (backend == "aravis")


def test_chunks_that_a_camera_reckons_are_left_to_the_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viva, "chunk_places", lambda *_: {})
    with viva_camera():
        camera = open_camera("viva")
        camera.start()
        blocks = grabbed(camera, 5)
        camera.close()
    assert_told(blocks)


def test_chunks_do_not_wait_for_what_else_is_asked_of_the_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its temperature takes it 5 s to tell; 50 blocks come in one."""
    asked, answered = threading.Event(), threading.Event()

    def temperature(camera: Camera) -> float | None:
        asked.set()
        try:
            return temperature_c(camera)
        finally:
            answered.set()

    monkeypatch.setattr(viva, "temperature_c", temperature)
    with viva_camera(delay_ack={testing.FakeGigeCamera.REGISTERS["DeviceTemperature"]: 5.0}):
        camera = open_camera("viva")
        camera.start()
        asking = threading.Thread(target=camera.health)
        asking.start()
        asked.wait()
        blocks = grabbed(camera, 50)
        was_answered = answered.is_set()
        asking.join()
        camera.close()
    assert_told(blocks)
    assert not was_answered

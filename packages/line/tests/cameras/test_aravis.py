"""A GigE Vision camera on loopback, through Aravis: lines to the byte, and what is lost by name."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from packages.line.tests.cameras.peers import (
    FREE,
    ID,
    faults_of,
    gige_camera,
    named_and_came,
    numbered_lines,
    numbers,
    read,
)
from packages.line.tests.cameras.test_pixel_formats import packed

from prooflight.errors import RequestError, ScanError
from prooflight.scans.camera_settings import CameraSettings
from prooflight_line.cameras import backends
from prooflight_line.cameras.backends import camera_named, list_cameras, opened
from prooflight_line.cameras.source import CameraLines

if TYPE_CHECKING:
    from collections.abc import Iterator

    from packages.line.tests.cameras.peers import Peer

    from prooflight.scans.lines import LineBlock
    from prooflight_line.cameras.camera import Camera

PIXELS = 512
LINES = numbered_lines(4096, PIXELS)
SETTINGS = CameraSettings(
    block_lines=64, trigger="free", line_rate_hz=16_000.0, features={"Width": PIXELS, "PixelFormat": "Mono8"}
)


def ready(settings: CameraSettings = SETTINGS) -> Camera:
    return backends.ready(camera_named(ID), settings, where="my.toml")


def assert_played(blocks: list[LineBlock], lines: np.ndarray = LINES) -> None:
    """Every line that came is one that was played, to the byte."""
    for block in blocks:
        np.testing.assert_array_equal(block.lines[0], lines[numbers(block.lines)])


@pytest.fixture
def camera() -> Iterator[Peer]:
    with gige_camera(LINES) as peer:
        yield peer


def test_lines_come_to_the_byte_beyond_the_turn_of_the_block_numbers(camera: Peer) -> None:
    """Its block numbers begin at 65401, and begin again at 1 after 135 blocks."""
    source = CameraLines(ready, name=ID, settings=FREE)
    assert (source.sensors, source.pixels) == (1, PIXELS)
    blocks = read(source, 200 * 64)
    assert not faults_of(blocks)
    assert [block.first_line for block in blocks] == list(range(0, 200 * 64, 64))
    came = np.concatenate([numbers(block.lines) for block in blocks])
    np.testing.assert_array_equal(came, np.arange(200 * 64) % len(LINES))
    assert_played(blocks)
    assert all(earlier.time_s <= later.time_s for earlier, later in pairwise(blocks))


def test_what_packets_lost_is_named_to_the_line() -> None:
    """1 packet in 50; the camera cannot send again, so that all of them are lost."""
    with gige_camera(LINES, lost=0.02):
        source = CameraLines(ready, name=ID, settings=FREE)
        blocks = read(source, 150 * 64)
        health = source.health()
    named, came = named_and_came(blocks)
    assert {"lost-packets"} <= {fault.kind for fault in faults_of(blocks)} <= {"lost-packets", "lost-blocks"}
    assert named.isdisjoint(came)
    assert named | came == set(range(max(came) + 1))
    assert 0.01 < len(named) / len(came) < 0.5
    assert_played(blocks)
    first = int(numbers(blocks[0].lines)[0]) - blocks[0].first_line
    for block in blocks:  # behind every loss the count is still the camera's own
        np.testing.assert_array_equal(
            numbers(block.lines), (np.arange(block.first_line, block.next_line) + first) % len(LINES)
        )
    assert health.blocks_broken > 0
    assert health.lines_lost >= len(named)


@pytest.mark.parametrize("form", ["Mono12p", "Mono12Packed", "Mono16"])
def test_deeper_pixels_come_as_they_were_played(form: str) -> None:
    values = np.random.default_rng(2).integers(0, 4096, (256, 96), np.uint16)
    lines = np.stack([packed(line, form) for line in values])
    with gige_camera(lines):
        asked = CameraSettings(pixel_format=form, block_lines=32, line_rate_hz=3200.0, features={"Width": 96})
        source = CameraLines(lambda: ready(asked), name=ID)
        blocks = read(source, 256)
    np.testing.assert_array_equal(np.concatenate([block.lines[0] for block in blocks])[:256], values)


def test_a_camera_that_dies_is_noticed_and_the_count_goes_on(camera: Peer) -> None:
    said: list[tuple[str, str]] = []
    source = CameraLines(
        ready, name=ID, settings=FREE, silent_s=0.3, reopen_s=0.05, tell=lambda *told: said.append(told)
    )
    blocks: list[LineBlock] = []
    for block in source.blocks():
        blocks.append(block)
        if len(blocks) == 20:
            camera.unplug()
            camera.plug_in()
        if len(said) == 2 and block.faults == ():
            source.close()
    assert [kind for kind, _ in said] == ["camera-away", "camera-back"]
    assert said[0][1].startswith(f"{ID} ")
    (fault,) = faults_of(blocks)
    assert fault.kind == "camera-away"
    assert fault.first_line >= 20 * 64  # what was on its way still comes
    assert max(block.next_line for block in blocks if block.first_line < fault.first_line) == fault.first_line
    counts = [block.first_line for block in blocks]
    assert counts == sorted(counts)
    back = next(block for block in blocks if block.faults)
    assert back.first_line == fault.next_line >= 20 * 64
    assert_played(blocks)
    assert source.health().away == 1


def test_a_camera_that_another_program_has_taken_is_opened_again(camera: Peer) -> None:
    """It takes no command of this program any more, whether its lines stop or not."""
    said: list[tuple[str, str]] = []
    source = CameraLines(
        ready, name=ID, settings=FREE, silent_s=60.0, reopen_s=0.05, tell=lambda *told: said.append(told)
    )
    blocks: list[LineBlock] = []
    for block in source.blocks():
        blocks.append(block)
        if len(blocks) == 20:
            camera.send("control", 0)
        if len(said) == 2 and block.faults == ():
            source.close()
    assert [kind for kind, _ in said] == ["camera-away", "camera-back"]
    assert "another program controls it" in said[0][1]
    assert {fault.kind for fault in faults_of(blocks)} == {"camera-away"}
    assert_played(blocks)


def test_a_camera_is_found_and_describes_itself(camera: Peer) -> None:
    (one,) = list_cameras()
    assert (one.id, one.model, one.serial, one.address, one.backend) == (
        ID,
        "Fake",
        "PL01",
        "127.0.0.1",
        "aravis",
    )
    for name in (ID, "PL01", "127.0.0.1"):
        assert camera_named(name) == one
    with pytest.raises(RequestError, match=rf"^camera XY: does not answer; these cameras answer: {ID}$"):
        camera_named("XY")
    open_camera = opened(one)
    features = open_camera.features()
    assert features["PixelFormat"].choices[:2] == ("Mono10", "Mono12")
    assert features["Width"].least == 1
    assert not features["SensorWidth"].writable
    open_camera.set("Height", "77")
    height = open_camera.feature("Height")
    assert height is not None
    assert height.value == "77"
    assert open_camera.health().temperature_c == 41.5
    open_camera.close()


def refusal(**asked: Any) -> str:
    with pytest.raises(RequestError) as refused:
        ready(CameraSettings(**asked))
    return str(refused.value)


def test_what_a_camera_lacks_is_said_in_one_line(camera: Peer) -> None:
    said = refusal(line_rate_hz=1000.0, names={"Fake": {"line_rate_hz": "AcquisitionLineRateAbs"}})
    assert said.startswith(
        f"my.toml, camera.line_rate_hz: {ID} has no feature AcquisitionLineRateAbs; it has AcquisitionLineRate"
    )
    assert said.endswith('state its own name under [camera.names."Fake"]')
    assert refusal(pixel_format="Mono9").startswith(
        f"my.toml, camera.pixel_format: {ID} has no PixelFormat 'Mono9'; it has Mono10, Mono12, "
    )
    assert refusal(features={"Width": 4096}) == (
        f"my.toml, camera.features.Width: {ID} does not accept Width 4096; give 1 to 2048"
    )
    assert refusal(trigger="encoder", trigger_source="Encoder7").startswith(
        f"my.toml, camera.trigger_source: {ID} has no TriggerSource 'Encoder7'; it has RotaryEncoder, Line0"
    )
    assert "SensorWidth to be set now" in refusal(features={"SensorWidth": 5})


def test_an_encoder_is_found_by_its_name(camera: Peer) -> None:
    one = ready(CameraSettings(trigger="encoder"))
    told = {name: one.feature(name) for name in ("TriggerSelector", "TriggerMode", "TriggerSource")}
    one.close()
    assert {name: feature and feature.value for name, feature in told.items()} == {
        "TriggerSelector": "LineStart",
        "TriggerMode": "On",
        "TriggerSource": "RotaryEncoder",
    }


def test_a_camera_that_another_program_controls_is_refused(camera: Peer) -> None:
    one = ready()
    with pytest.raises(ScanError, match="controlled by another program"):
        opened(camera_named(ID))
    one.close()

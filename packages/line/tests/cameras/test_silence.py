"""A camera that waits for an encoder falls silent: the press stands, or the camera is dead; and it comes back."""

from __future__ import annotations

import threading
import tracemalloc
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest
from packages.line.tests.cameras.peers import ID, faults_of, gige_camera, numbered_lines, numbers

from prooflight.errors import ScanError
from prooflight.scans.camera_settings import CameraSettings
from prooflight.scans.lines import LineBlock
from prooflight_line.cameras import backends
from prooflight_line.cameras.backends import camera_named
from prooflight_line.cameras.camera import CameraInfo, Feature, Grab, Health
from prooflight_line.cameras.source import ANSWER_S, ASK_AFTER_S, CameraLines, Watchdog

LINES, PIXELS = 64, 16
FOUND = CameraInfo(id="cam", maker="", model="", serial="1", address="", backend="none")
ENCODER = CameraSettings(trigger="encoder", encoder_steps=2)


class Clock:
    """Goes on when somebody waits."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@dataclass
class FakeCamera:
    """Sends a block every 20 ms of the clock's time until ``dies_s``."""

    clock: Clock
    dies_s: float = 1.0
    position: Callable[[], int] = lambda: 0
    block: int = 0
    info: CameraInfo = FOUND
    closed: bool = False
    features_: dict[str, str] = field(
        default_factory=lambda: {"Width": str(PIXELS), "Height": str(LINES), "PixelFormat": "Mono8"}
    )

    def features(self) -> Mapping[str, Feature]:
        return {
            name: Feature(name=name, kind="string", value=value) for name, value in self.features_.items()
        }

    def feature(self, name: str) -> Feature | None:
        if name == "EncoderValue":
            return Feature(name=name, kind="integer", value=str(self.position()))
        return self.features().get(name)

    def set(self, name: str, value: str) -> None: ...

    def start(self) -> None: ...

    def grab(self, timeout_s: float) -> Grab | None:
        if self.clock.now_s >= self.dies_s:
            self.clock.now_s += timeout_s
            return None
        self.clock.now_s += 0.02
        self.block += 1
        return Grab(
            block_id=self.block,
            id_wraps=True,
            data=np.zeros(LINES * PIXELS, np.uint8),
            missing=(),
            pixel_format="Mono8",
            lines=LINES,
            pixels=PIXELS,
            padding=0,
            time_s=self.clock.now_s,
        )

    def health(self) -> Health:
        return Health()

    def close(self) -> None:
        self.closed = True


def asked(watchdog: Watchdog, silent_s: float) -> str:
    """What is said once the question that is on its way has been answered."""
    watchdog.silent(silent_s)
    for thread in threading.enumerate():
        if thread.name == "ask camera":
            thread.join()
    return watchdog.silent(silent_s)


def test_a_press_that_stands_is_no_dead_camera() -> None:
    clock = Clock()
    watchdog = Watchdog(FakeCamera(clock), position=lambda _camera: 1000, most_steps=256, clock=clock)
    for tenth in range(1000):
        clock.now_s = tenth / 10
        assert not asked(watchdog, clock.now_s)


@pytest.mark.parametrize(("a_line", "said_s"), [(2, 1.1), (-2, 1.1), (0, None)])
def test_an_encoder_that_goes_on_without_lines_is_a_dead_camera(a_line: int, said_s: float | None) -> None:
    """At 3,200 lines a second; two blocks may be on their way."""
    clock = Clock()
    watchdog = Watchdog(
        FakeCamera(clock),
        position=lambda _camera: round(3200 * a_line * clock.now_s),
        most_steps=2 * 2 * LINES,
        clock=clock,
    )
    said: list[float] = []
    while clock.now_s < 5 and not said:
        clock.now_s += 0.1
        if why := asked(watchdog, clock.now_s):
            assert "although its encoder has advanced" in why
            said.append(clock.now_s)
    assert bool(said) == (said_s is not None)
    assert all(at <= said_s for at in said if said_s is not None)


def test_a_camera_that_does_not_answer_is_dead_within_two_seconds() -> None:
    clock, never = Clock(), threading.Event()

    def waits(_camera: object) -> int | None:
        never.wait()
        return None

    watchdog = Watchdog(FakeCamera(clock), position=waits, most_steps=1, clock=clock)
    while not (why := watchdog.silent(clock.now_s)):
        clock.now_s += 0.1
    never.set()
    assert why.startswith("has not answered for 1.")
    assert clock.now_s <= ASK_AFTER_S + ANSWER_S + 0.3 < 2


def test_a_camera_that_says_it_is_gone_is_dead_at_once() -> None:
    def gone(_camera: object) -> int | None:
        raise ScanError("cam", "is disconnected: it no longer answers", remedy="look")

    watchdog = Watchdog(FakeCamera(Clock()), position=gone, most_steps=1, clock=Clock())
    assert asked(watchdog, 0.5) == "is disconnected: it no longer answers"


def test_an_hour_unplugged_costs_no_memory_and_says_little() -> None:
    """It is tried 20,000 times; then it is there again, and the count goes on by what the time says has passed."""
    clock, said, tries = Clock(), list[tuple[str, str]](), 0
    peaks: list[int] = []

    def opened() -> FakeCamera:
        nonlocal tries
        tries += 1
        if 1 < tries < 20_000:
            clock.now_s += 0.2
            if tries in (1000, 19_999):
                peaks.append(tracemalloc.get_traced_memory()[0])
            raise ScanError("cam", "does not answer", remedy="check its cable")
        return FakeCamera(clock, dies_s=1.0 if tries == 1 else np.inf)

    source = CameraLines(
        opened,
        name="cam",
        settings=CameraSettings(trigger="free"),
        reopen_s=0.0,
        clock=clock,
        tell=lambda *told: said.append(told),
    )
    blocks: list[LineBlock] = []
    tracemalloc.start()
    try:
        for block in source.blocks():
            blocks.append(block)
            if len(said) == 2 and len(blocks) > 60:
                source.close()
    finally:
        tracemalloc.stop()
    assert [kind for kind, _ in said] == ["camera-away", "camera-back"]
    assert peaks[1] - peaks[0] < 100_000
    (fault,) = faults_of(blocks)
    assert fault.kind == "camera-away"
    assert fault.lines == pytest.approx(3200 * 4000, rel=0.01)
    assert blocks[-1].next_line > fault.next_line > 3200 * 3900


def test_a_camera_that_answers_and_sends_nothing_is_opened_again() -> None:
    """Aravis' camera on loopback loses all its packets, while its encoder goes on."""
    lines, said = numbered_lines(4096, 512), list[tuple[str, str]]()
    settings = CameraSettings(
        trigger="encoder", encoder_steps=1, block_lines=64, line_rate_hz=16_000.0, features={"Width": 512}
    )
    with gige_camera(lines) as peer:

        def ready() -> object:
            if said:
                peer.send("lost", 0.0)  # it is mended by being opened again
            return backends.ready(camera_named(ID), settings, where="my.toml")

        moving = threading.Event()

        def told(kind: str, text: str) -> None:
            moving.set()
            said.append((kind, text))

        source = CameraLines(ready, name=ID, settings=settings, reopen_s=0.05, tell=told)  # type: ignore[arg-type]
        blocks: list[LineBlock] = []
        threads: list[threading.Thread] = []
        for block in source.blocks():
            blocks.append(block)
            if len(blocks) == 20:
                peer.send("lost", 1.0)

                def turn() -> None:
                    steps = 0
                    while not moving.wait(0.05):
                        steps += 800
                        peer.send("encoder", steps)

                threads.append(threading.Thread(target=turn))
                threads[-1].start()
            if len(said) == 2 and len(blocks) > 40:
                source.close()
        threads[0].join()
    assert [kind for kind, _ in said] == ["camera-away", "camera-back"]
    assert "although its encoder has advanced" in said[0][1]
    (fault,) = [fault for fault in faults_of(blocks) if fault.kind == "camera-away"]
    assert fault.first_line >= 20 * 64
    for block in blocks:
        np.testing.assert_array_equal(block.lines[0], lines[numbers(block.lines)])

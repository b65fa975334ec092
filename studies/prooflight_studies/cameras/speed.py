"""Speed at which lines are read over loopback without a loss, and its cost in this process. Needs an idle machine."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.rng import stream
from prooflight.scans.camera_settings import CameraSettings
from prooflight_line.cameras.backends import BACKENDS, camera_named, ready
from prooflight_line.cameras.source import CameraLines
from prooflight_line.testing.peer import plugged_in
from prooflight_studies.cameras.job import OVER_THE_WIRE

if TYPE_CHECKING:
    from collections.abc import Callable

PIXELS: Final = 2048
BLOCK_LINES: Final = 256
"""Lines of a block of 1 MiB."""
PLAYED_LINES: Final = 4096
PACKET_BYTES: Final = 9000
RATES_MB_S: Final = (17.0, 34.0, 75.0, 150.0, 200.0)
"""Data rates. 34 MB/s is that of three sensors of the prototype: 2048 pixels of 2 bytes at 2770 lines/s each."""
PROTOTYPE_MB_S: Final = 34.0


def speed_rows(
    *, seconds: float, rates_mb_s: tuple[float, ...], seed: int, progress: Callable[[str], None]
) -> list[dict[str, Any]]:
    """Return a row for each library and rate, without the cost of the camera's own process."""
    lines = stream(seed, "camera-losses", 2).integers(1, 4096, (PLAYED_LINES, PIXELS), np.uint16)
    lacks = {one.name: one.lacks for one in BACKENDS}
    rows = []
    for name, camera in OVER_THE_WIRE.items():
        if lacks[name] or lacks["aravis"]:
            continue
        for rate_mb_s in rates_mb_s:
            progress(f"{name} at {rate_mb_s:g} MB/s")
            with plugged_in(lines.astype("<u2").view(np.uint8)):
                rows.append({"backend": name, **_row(name, camera, rate_mb_s, seconds)})
    return rows


def _row(backend: str, camera: str, rate_mb_s: float, seconds: float) -> dict[str, Any]:
    features: dict[str, Any] = {"Width": PIXELS}
    if backend == "aravis":  # which adds it to every camera; viva finds a size of its own
        features["GevSCPSPacketSize"] = PACKET_BYTES
    settings = CameraSettings(
        pixel_format="Mono16",
        block_lines=BLOCK_LINES,
        line_rate_hz=rate_mb_s * 1e6 / (2 * PIXELS),
        trigger="free",
        features=features,
    )
    source = CameraLines(
        lambda: ready(camera_named(camera), settings, where="the study"), name=camera, settings=settings
    )
    lines, begun_s, cpu_s, threads = 0, 0.0, 0.0, threading.active_count()
    for block in source.blocks():
        if not begun_s:  # the first block brings what is done once
            begun_s, cpu_s = time.monotonic(), time.process_time()
            continue
        lines += block.lines.shape[1]
        if time.monotonic() - begun_s >= seconds:
            took_s, cpu_s = time.monotonic() - begun_s, time.process_time() - cpu_s
            health = source.health()
            source.close()
    megabytes = lines * 2 * PIXELS / 1e6
    return {
        "asked_mb_s": rate_mb_s,
        "reached_mb_s": megabytes / took_s,
        "lines_per_s": lines / took_s,
        "lines_lost": health.lines_lost,
        "resends": health.resends,
        "cpu_ms_a_mb": 1e3 * cpu_s / max(megabytes, 1e-9),
        "core_percent": 100 * cpu_s / took_s,
        "threads": threads,
    }

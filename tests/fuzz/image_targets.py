"""Jobs, scans and pictures: TIFF, JPEG, PNG and PDF."""

from __future__ import annotations

import functools
import tempfile
from pathlib import Path

from tests.fuzz import image_mutants as images
from tests.fuzz.harness import Target


def samples(kind: str) -> list[bytes]:
    with tempfile.TemporaryDirectory() as folder:
        return [images.samples(Path(folder))[kind]]


def _target(kind: str) -> Target:
    name, _, suffix = kind.rpartition(".")
    return Target(
        name=f"{name}-{suffix}",
        suffix=f".{suffix}",
        samples=functools.partial(samples, kind),
        mutate=functools.partial(images.mutated, kind),
        read=functools.partial(images.read, kind),
    )


TARGETS = tuple(_target(kind) for kind in images.KINDS)

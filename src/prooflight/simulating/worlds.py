"""The worlds in which figures are measured, as ``worlds.toml`` fixes them."""

from __future__ import annotations

import hashlib
import tomllib
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any


def worlds_text() -> bytes:
    """The package's own copy of ``worlds.toml``."""
    return resources.files("prooflight.simulating").joinpath("worlds.toml").read_bytes()


def worlds_digest() -> str:
    """SHA-256 of it; published figures name it."""
    return hashlib.sha256(worlds_text()).hexdigest()


@cache
def worlds() -> dict[str, Any]:
    """Its content."""
    return tomllib.loads(worlds_text().decode())


@dataclass(frozen=True, slots=True, kw_only=True)
class Gate:
    """A drawn misprint that reaches neither amount changes nothing that a person sees; it is drawn again."""

    blurred_peak_percent: float
    rms_percent: float


def gate() -> Gate:
    """``[gate]``."""
    return Gate(**worlds()["gate"])


def amount(kind: str, field: str, severity: float) -> float:
    """Amount of a misprint kind at severity 0..1: from at_0 to at_1, geometrically unless the file says linear."""
    (entry,) = (entry for entry in worlds()["misprint"] if entry["kind"] == kind)
    spec = entry[field]
    low, high = spec["at_0"], spec["at_1"]
    if spec.get("scale") == "linear":
        return float(low + (high - low) * severity)
    return float(low * (high / low) ** severity)

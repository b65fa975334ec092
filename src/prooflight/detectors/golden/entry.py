"""The golden detector as it is registered: its golden scans are given to it afterwards."""

from __future__ import annotations

from typing import Final

from prooflight.detectors.entry import Entry
from prooflight.detectors.golden.detector import GoldenDetector

ENTRY: Final = Entry(detector=lambda press: GoldenDetector(press_context=press.press_context()))

"""A job on the simulated press: pages printed, with misprints where asked for, and scanned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from prooflight.errors import RequestError
from prooflight.predicting.predict import predict
from prooflight.simulating import misprints
from prooflight.simulating.worlds import Gate, gate

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.predicting.predict import Prediction
    from prooflight.press import Press
    from prooflight.simulating.misprints import Misprint

KINDS = ("missing-plane", "streak", "missing-content", "wrong-page")
TRIES = 9
"""A misprint that changes nothing visible on its page is drawn again at most 8 times (worlds.toml)."""
GATE_BLUR_MM = 0.38


@dataclass(frozen=True, slots=True, kw_only=True)
class MisprintRequest:
    """A kind of misprint, and how severe; severity None: drawn evenly from 0..1 for each page."""

    kind: str
    severity: float | None = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise RequestError(
                "misprint", f"there is no kind {self.kind!r}", remedy=f"choose of {', '.join(KINDS)}"
            )
        if self.severity is not None and not 0 <= self.severity <= 1:
            what = f"severity {self.severity} of {self.kind} is out of range"
            raise RequestError("misprint", what, remedy="give a severity from 0 (barely visible) to 1")

    @classmethod
    def parse(cls, text: str) -> MisprintRequest:
        """``KIND`` or ``KIND:SEVERITY``."""
        kind, _, severity = text.partition(":")
        try:
            return cls(kind=kind, severity=float(severity) if severity else None)
        except ValueError as error:
            if isinstance(error, RequestError):
                raise
            what = f"severity {severity!r} is not a number"
            raise RequestError("misprint", what, remedy="write KIND:SEVERITY, e.g. streak:0.8") from error


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimulatedScan:
    """One page as the camera recorded it, and the truth about it."""

    dn: NDArray[np.uint16]
    """(sensors, lines, pixels) [DN]"""
    misprint: Misprint | None
    """None: a good print."""
    draws: int
    """How many misprints were drawn until one changed the page; 0 for a good print."""


def page_rng(seed: int, page_number: int) -> np.random.Generator:
    """The random numbers of one page: the same whatever other pages are simulated, and in whatever order."""
    return np.random.default_rng([seed, page_number])


def ideal_scan(prediction: Prediction, press: Press, rng: np.random.Generator) -> NDArray[np.uint16]:
    """The ideal world: expected plus temporal noise, rounded and clipped to the converter's codes."""
    rounding = np.float32(1 / 12)
    noise = rng.standard_normal(prediction.expected_dn.shape, dtype=np.float32)
    noise *= np.sqrt(np.maximum(prediction.variance_dn2 - rounding, 0))
    noise += prediction.expected_dn
    top = np.array([sensor.top_code_dn for sensor in press.sensors], np.float32)[:, None, None]
    return np.clip(np.rint(noise, out=noise), 0, top, out=noise).astype(np.uint16)


def scan_page(
    page: Page,
    *,
    press: Press,
    request: MisprintRequest | None,
    others: tuple[int, ...],
    fetch: Callable[[int], Page],
    rng: np.random.Generator,
    least: Gate | None = None,
) -> SimulatedScan:
    """Print and scan one page in the ideal world, with a misprint if one is requested.

    others: numbers of the job's other pages, which ``fetch`` gives. least: the least change that counts, by default the
    gate of ``worlds.toml``. RequestError if none of the draws of the misprint
    changes this page (a page of black text alone has no cyan to lose).
    """
    good = predict(page, sensors=press.sensors, geometry=press.geometry)
    if request is None:
        return SimulatedScan(dn=ideal_scan(good, press, rng), misprint=None, draws=0)
    for draw in range(1, TRIES + 1):
        severity = float(rng.random()) if request.severity is None else request.severity
        printed, misprint = draw_misprint(page, request.kind, severity, others=others, fetch=fetch, rng=rng)
        seen = predict(printed, sensors=press.sensors, geometry=press.geometry)
        if passes_gate(good, seen, press, least or gate()):
            return SimulatedScan(dn=ideal_scan(seen, press, rng), misprint=misprint, draws=draw)
    what = f"{TRIES} draws of {request.kind} changed nothing visible"
    raise RequestError(f"page {page.number}", what, remedy="ask for another kind, severity or seed")


def draw_misprint(
    page: Page,
    kind: str,
    severity: float,
    *,
    others: tuple[int, ...],
    fetch: Callable[[int], Page],
    rng: np.random.Generator,
) -> tuple[Page, Misprint]:
    """One misprint of ``kind`` on ``page``; the page given is not changed."""
    match kind:
        case "missing-plane":
            return misprints.missing_plane(page, severity, rng)
        case "streak":
            return misprints.streak(page, severity, rng)
        case "missing-content":
            return misprints.missing_content(page, severity, rng)
        case _:
            return misprints.wrong_page(page, severity, rng, others=others, fetch=fetch)


def passes_gate(good: Prediction, misprinted: Prediction, press: Press, limits: Gate) -> bool:
    """Whether a misprint changes the page's signal by the least amount that counts.

    Either the greatest change after a Gaussian of 0.38 mm, or the change's rms over the page, as shares of paper white.
    """
    sigma = GATE_BLUR_MM / press.geometry.pixel_pitch_mm
    for index, sensor in enumerate(press.sensors):
        change = misprinted.expected_dn[index] - good.expected_dn[index]
        if np.sqrt(np.mean(change**2)) >= limits.rms_percent / 100 * sensor.white_dn:
            return True
        blurred = cv2.GaussianBlur(change, (0, 0), sigma)
        if np.abs(blurred).max() >= limits.blurred_peak_percent / 100 * sensor.white_dn:
            return True
    return False

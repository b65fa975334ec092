"""Scans of a job on the simulated press, with misprints where requested."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from prooflight.camera.sensor import ROUNDING_DN2
from prooflight.errors import RequestError
from prooflight.files.given import shortly
from prooflight.prediction.predict import Prediction, predict
from prooflight.rng import stream
from prooflight.scans.placement import IN_PLACE, Placement
from prooflight.scans.scan import Scan
from prooflight.simulation.fast import fast_scan
from prooflight.simulation.misprints.kinds import KINDS, Misprint, draw_misprint
from prooflight.simulation.prints import Print, composed
from prooflight.simulation.session import Session, session_of
from prooflight.simulation.worlds import Gate, gate, world_named

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

TRIES = 9
"""Greatest number of draws of a misprint: one without visible change is drawn again at most 8 times (worlds.toml)."""
GATE_BLUR_MM = 0.38


@dataclass(frozen=True, slots=True, kw_only=True)
class MisprintRequest:
    """Kind of misprint, and its severity; severity None: drawn uniformly from 0..1 for each page."""

    kind: str
    severity: float | None = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise RequestError(
                "misprint",
                f"there is no kind {shortly(self.kind)!r}",
                remedy=f"choose from {', '.join(KINDS)}",
            )
        if self.severity is not None and not 0 <= self.severity <= 1:
            what = f"severity {self.severity} of {self.kind} is out of range"
            raise RequestError("misprint", what, remedy="give a severity from 0 (barely visible) to 1")

    @classmethod
    def parse(cls, text: str) -> MisprintRequest:
        """Parse ``KIND`` or ``KIND:SEVERITY``."""
        kind, _, severity = text.partition(":")
        try:
            return cls(kind=kind, severity=float(severity) if severity else None)
        except ValueError as error:
            if isinstance(error, RequestError):
                raise
            what = f"severity {shortly(severity)!r} is not a number"
            raise RequestError("misprint", what, remedy="write KIND:SEVERITY, e.g. streak:0.8") from error


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimulatedScan:
    """Page as the camera recorded it, and its ground truth."""

    dn: NDArray[np.uint16]
    """Scan (sensors, lines, pixels). [DN]"""
    misprint: Misprint | None
    """Misprint; None: a good print."""
    draws: int
    """Number of misprints drawn until one changed the page; 0 for a good print."""
    print_: Print | None = None
    """Parameters of the print that good prints have too; None in the ideal world."""


def ideal_scan(prediction: Prediction, press: Press, rng: np.random.Generator) -> NDArray[np.uint16]:
    """Draw a scan of the ideal world: expected plus temporal noise, rounded and clipped to the converter's codes."""
    rounding = np.float32(ROUNDING_DN2)
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
    session: Session | None = None,
    misprint_rng: np.random.Generator | None = None,
) -> SimulatedScan:
    """Print and scan one page, with a misprint if one is requested.

    Parameters
    ----------
    others
        Numbers of the job's other pages, which ``fetch`` gives.
    least
        Least change that counts, by default the gate of ``worlds.toml``; it compares predictions, whatever the world.
    session
        The press today, in the press world; None: the ideal world.
    misprint_rng
        Draws the misprint, so that it is the same in every world; None: ``rng`` does, after the print.

    Raises
    ------
    RequestError
        If none of the draws of the misprint changes this page (a page of black text alone has no cyan to lose).
    """
    print_ = None if session is None else Print.draw(session, press, page, rng)

    def predicted(printed: Page, placement: Placement = IN_PLACE) -> Prediction:
        return predict(printed, sensors=press.sensors, geometry=press.geometry, placement=placement)

    def scan(printed: Page, placement: Placement, misprint: Misprint | None, draws: int) -> SimulatedScan:
        if session is None or print_ is None:
            dn = ideal_scan(predicted(printed, placement), press, rng)
        else:
            moved = replace(print_, placement=composed(print_.placement, placement))
            dn = fast_scan(printed, press, session, moved, rng=rng)
        return SimulatedScan(dn=dn, misprint=misprint, draws=draws, print_=print_)

    if request is None:
        return scan(page, IN_PLACE, None, 0)
    good, drawing = predicted(page), misprint_rng or rng
    for draw in range(1, TRIES + 1):
        severity = float(drawing.random()) if request.severity is None else request.severity
        drawn = draw_misprint(page, request.kind, severity, others=others, fetch=fetch, rng=drawing)
        if passes_gate(good, predicted(drawn.page, drawn.placement), press, least or gate()):
            return scan(drawn.page, drawn.placement, drawn.misprint, draw)
    what = f"{TRIES} draws of {request.kind} changed nothing visible"
    raise RequestError(f"page {page.number}", what, remedy="ask for another kind, severity or seed")


def simulate(
    page: Page,
    press: Press,
    *,
    misprint: str | None = None,
    world: str = "ideal",
    others: Sequence[Page] = (),
    seed: int = 1,
) -> Scan:
    """Print a page on the simulated press and scan it; the scan that `prooflight simulate` writes.

    misprint: KIND or KIND:SEVERITY, such as "streak:0.8"; severity 0 (barely visible) to 1. world: "ideal",
    where a good scan is the predicted one plus the sensor's noise; "press", where prints also move and drift;
    "measured", where they vary as real sheets do and are screened.
    others: the job's other pages, one of which a wrong page may show. JobError: the page does not fit this
    press. RequestError: there is no such kind or world, or the misprint has no visible effect.
    """
    world_named(world)
    placed = {other.number: press.geometry.lay(other) for other in others if other.number != page.number}
    simulated = scan_page(
        press.geometry.lay(page),
        press=press,
        request=None if misprint is None else MisprintRequest.parse(misprint),
        others=tuple(placed),
        fetch=placed.__getitem__,
        rng=stream(seed, "print", page.number),
        session=session_of(press, seed, world),
    )
    return Scan(dn=simulated.dn, name=page.name)


def passes_gate(good: Prediction, misprinted: Prediction, press: Press, limits: Gate) -> bool:
    """Return whether a misprint changes the page's signal by the least amount that counts.

    Either the greatest change after a Gaussian of 0.38 mm, or the change's rms over the page, as shares of
    paper white.
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

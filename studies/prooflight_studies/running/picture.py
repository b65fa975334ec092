"""The live view during an alarm, as a person sees it."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
from rich.console import Console
from rich.terminal_theme import MONOKAI

from prooflight.files.atomic import whole_file
from prooflight.line.settings import Settings
from prooflight.line.watching import watched
from prooflight.reporting.live import Recent, live_view
from prooflight.rng import stream
from prooflight.simulation.drum import Drum, DrumFault, turns
from prooflight.simulation.fast import fast_scan
from prooflight.simulation.misprints.kinds import draw_misprint
from prooflight.simulation.prints import Print
from prooflight_studies.running.drift import LAMP_A_PAGE, STREAK_A_PAGE, streaked
from prooflight_studies.running.rig import Ring, day

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray
    from rich.console import RenderableType

    from prooflight.inspection.inspector import Inspector
    from prooflight.line.outcomes import Outcome
    from prooflight.pages.raster import Page

SHEETS: Final = 200
GOOD_PAGES: Final = 80
KINDS: Final = {23: "streak", 67: "spots-voids", 118: "missing-content", 171: "density"}
FAULTS: Final = {41: DrumFault(kind="stretch", amount=0.6), 139: DrumFault(kind="repeated")}
SHOWN: Final = 174
WIDTH: Final = 128


def draw_live(path: Path, inspector: Inspector, pages: tuple[Page, ...], *, seed: int) -> str:
    """Run the drum with some misprints, a growing streak and an ageing lamp, and draw the live view.

    The view is written as SVG to ``path`` and returned as text.
    """
    press = inspector.press
    scans = [_scan(inspector, pages, sheet, seed=seed) for sheet in range(SHEETS)]
    drum = Drum(scans, press=press, passing=turns(SHEETS, FAULTS))
    recent = Recent.of([sensor.name for sensor in press.sensors])
    settings = Settings(source_waits=True, source_clock=True, room=1, seed=seed)
    views: list[RenderableType] = []

    def tell(outcome: Outcome) -> None:
        recent.add(outcome)
        if outcome.record.sheet == SHOWN:
            title = f"six pages on {press.name}, drum, {inspector.detector.name}"
            views.append(live_view(running.status(), recent, title=title, deadline_s=None))

    ring = Ring(scans=scans, pages=pages, sheets=SHEETS, repeated=True)
    running = watched(inspector, source=drum, book=ring, settings=settings, tell=tell)
    running.start()
    running.join()
    if not views:
        raise RuntimeError(running.status().detail)
    console = Console(record=True, width=WIDTH, force_terminal=True, file=io.StringIO())
    console.print(views[0])
    picture = console.export_svg(title="prooflight watch", theme=MONOKAI, clear=False)
    with whole_file(path) as unfinished:
        unfinished.write_text(picture, encoding="utf-8")
    return console.export_text()


def _scan(inspector: Inspector, pages: tuple[Page, ...], sheet: int, *, seed: int) -> NDArray[np.uint16]:
    press, page, rng = inspector.press, pages[sheet % len(pages)], stream(seed, "running-picture", sheet)
    session = day(press, seed)
    print_ = Print.draw(session, press, page, rng)
    since = max(sheet - GOOD_PAGES, 0)
    print_ = replace(print_, lamp=print_.lamp * (1 - LAMP_A_PAGE * since))
    page = replace(page, cmyk=streaked(page, STREAK_A_PAGE * since, rng))
    if sheet in KINDS:
        others = tuple(range(1, len(pages) + 1))
        page = draw_misprint(
            page, KINDS[sheet], 0.8, others=others, fetch=lambda n: pages[n - 1], rng=rng
        ).page
    return fast_scan(page, press, session, print_, rng=rng)

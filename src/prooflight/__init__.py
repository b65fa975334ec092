"""Prooflight predicts what a line camera must see of a printed page, compares, and decides: pass or stop.

``import prooflight as pf`` gives these names; each is loaded when it is first touched.

=================  ====================================================================================
Press              a press with its camera, its tables and what it was taught; ``Press.load("my.press")``
PressFile          the press in a user's words (TOML); ``PressFile.prototype()`` is the paper's rig
build_press        a press file -> a press
Page               one page to be printed, as its CMYK raster
Job                the open pages of a PDF, of CMYK images, or of a folder of them
open_job           open a job for a press: at its resolution, pages laid as they enter it
pair               every page of a job with its recorded scan
Scan               what the camera saw of one sheet
simulate           print a page on the simulated press, with a misprint if one is wanted, and scan it
predict            the lines that the camera must see of a page
Prediction         those lines, and how sure they are
Inspector          a press with a detector: prepares pages, inspects their scans
Inspection         a verdict and what it rests on; ``show()`` draws it
Verdict            what was decided of one page, and why
Camera             light, lens and line sensors
respond            what a camera answers to colours
built_in_inks      the inks of a press that has measured none: CMYK -> spectra
InkModel           inks as a measured chart taught them
Detector           what a detector must do, for those who write one
PreparedPage       what a page that a detector has prepared must do
ContextDetector    what detectors have in common; leaves ``prepare`` to write
PreparedOnly       what prepared pages have in common; leaves ``inspect`` to write
PlannedPage        a page as it is to enter the press, with its prediction
Decision           evidence and threshold: what a detector makes a verdict of
IN_PLACE           where a page lies that lies where it should
=================  ====================================================================================

A job against its scans::

    import prooflight as pf
    press = pf.Press.load("my.press")
    with pf.open_job("job.pdf", press) as job:
        for page, scan in pf.pair(job, "scans/"):
            found = pf.Inspector(press).inspect(page, scan)
            found.verdict, found.regions, found.show()      # a picture in a notebook

Everything else is imported from its room: docs/ARCHITECTURE.md is the map.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from prooflight.shown import Shown

if TYPE_CHECKING:
    from prooflight.camera.camera import Camera as Camera
    from prooflight.camera.camera import respond as respond
    from prooflight.commissioning.build import build_press as build_press
    from prooflight.detectors.base import ContextDetector as ContextDetector
    from prooflight.detectors.base import Detector as Detector
    from prooflight.detectors.base import Inspection as Inspection
    from prooflight.detectors.base import PlannedPage as PlannedPage
    from prooflight.detectors.base import PreparedOnly as PreparedOnly
    from prooflight.detectors.base import PreparedPage as PreparedPage
    from prooflight.detectors.verdict import Decision as Decision
    from prooflight.detectors.verdict import Verdict as Verdict
    from prooflight.inks.built_in import built_in_inks as built_in_inks
    from prooflight.inks.ink_model import InkModel as InkModel
    from prooflight.inspection.inspector import Inspector as Inspector
    from prooflight.inspection.job import pair as pair
    from prooflight.pages.job import Job as Job
    from prooflight.pages.raster import Page as Page
    from prooflight.prediction.predict import Prediction as Prediction
    from prooflight.press.artefact import Press as Press
    from prooflight.press.pages import open_job as open_job
    from prooflight.press.pages import predict as predict
    from prooflight.press.press_file import PressFile as PressFile
    from prooflight.scans.placement import IN_PLACE as IN_PLACE
    from prooflight.scans.scan import Scan as Scan
    from prooflight.shown import Renderer
    from prooflight.simulation.scans import simulate as simulate

__version__ = "0.3.0"

_HOMES = {
    "Press": "press.artefact",
    "PressFile": "press.press_file",
    "build_press": "commissioning.build",
    "Page": "pages.raster",
    "Job": "pages.job",
    "open_job": "press.pages",
    "pair": "inspection.job",
    "Scan": "scans.scan",
    "simulate": "simulation.scans",
    "predict": "press.pages",
    "Prediction": "prediction.predict",
    "Inspector": "inspection.inspector",
    "Inspection": "detectors.base",
    "Verdict": "detectors.verdict",
    "Camera": "camera.camera",
    "respond": "camera.camera",
    "built_in_inks": "inks.built_in",
    "InkModel": "inks.ink_model",
    "Detector": "detectors.base",
    "PreparedPage": "detectors.base",
    "ContextDetector": "detectors.base",
    "PreparedOnly": "detectors.base",
    "PlannedPage": "detectors.base",
    "Decision": "detectors.verdict",
    "IN_PLACE": "scans.placement",
}
"""The module of each public name."""

__all__ = [*_HOMES, "__version__"]


def __getattr__(name: str) -> Any:
    """Load a public name when it is first touched (PEP 562)."""
    if name not in _HOMES:
        message = f"module 'prooflight' has no attribute {name!r}"
        raise AttributeError(message)
    value = getattr(import_module(f"prooflight.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def _renderer() -> Renderer:
    from prooflight.reporting import notebook

    return notebook


Shown.renderer = _renderer

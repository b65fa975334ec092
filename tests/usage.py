"""The documented usage, as a person would write it; the type checker reads it, test_api.py runs it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import prooflight as pf

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray


def a_press(folder: Path) -> pf.Press:
    """From a press file to an artefact and back."""
    rig: pf.PressFile = pf.PressFile.prototype()
    press = pf.build_press(rig, seed=1, pixels=400)
    press.save(folder / "my.press")
    return pf.Press.load(str(folder / "my.press"))


def a_job(folder: Path) -> list[tuple[str, int]]:
    """A job against its scans: verdicts, and how many places of each page are off."""
    told = []
    press = pf.Press.load(folder / "my.press")
    with pf.open_job(folder / "job", press) as job:
        for page, scan in pf.pair(job, folder / "scans"):
            found = pf.Inspector(press).inspect(page, scan)
            found.show()
            told.append((str(found.verdict.verdict), len(found.regions)))
    return told


def a_page(page: pf.Page, press: pf.Press) -> pf.Verdict:
    """Predicted, printed with a misprint, prepared ahead, inspected by the paper's first detector."""
    seen: pf.Prediction = pf.predict(page, press)
    scan: pf.Scan = pf.simulate(page, press, misprint="streak:0.8", seed=1)
    assert scan.dn.shape == seen.expected_dn.shape
    inspector = pf.Inspector.of(press, "chi-square")
    ready = inspector.prepare(page)
    found: pf.Inspection = inspector.inspect(ready, scan)
    return found.verdict


def pages_of(job: pf.Job) -> list[float]:
    """Widths of the pages of a job. [mm]"""
    return [page.width_mm for page in job]


def a_camera(rig: pf.PressFile) -> dict[str, NDArray[np.float64]]:
    """What each sensor answers to bare paper and to the four inks. [DN]"""
    camera: pf.Camera = rig.camera()
    inks = pf.built_in_inks()
    recipes = [[0, 0, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    spectra = inks.reflectance(as_inks(recipes))
    return {answer.name: answer.dn_mean for answer in pf.respond(camera, spectra)}


def as_inks(recipes: list[list[int]]) -> NDArray[np.float64]:
    """Recipes as ink models take them."""
    import numpy as np

    return np.array(recipes, np.float64)

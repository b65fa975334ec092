"""# Reproduce the paper's Table 1, small

Table 1 says what the paper's learned detector costs with one sensor: c = F + alpha M, where F is the share of good
pages that alarm, M that of misprints that pass, and alpha how much dearer a missed misprint is than a false alarm.
This is the study of `prooflight study paper` with a coarse camera and few page designs, so its intervals are wide.

The paper chose each threshold on the pages that it then reported: the oracle. Honest thresholds are chosen on other
pages. The picture: both beside the paper's own digits, with 95 % intervals over page designs.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import prooflight as pf
from prooflight.press.press_file import TWO_SENSORS
from prooflight_studies.harness.protocol import Plan
from prooflight_studies.paper.results import ALPHAS, PRINTED
from prooflight_studies.paper.study import at_pitch, run_part

PITCH_MM = 1.016
"""Of camera pixels on the page: 25 an inch, a tenth of the paper's camera."""
PLAN = Plan(seed=1, world="ideal", pilot=2, learn=40, tune=20, test=40, good_copies=1, misprints=1)


def main(out: Path) -> None:
    """Learn, tune and test in the ideal world; print the row of Table 1, draw it."""
    press = pf.build_press(at_pitch(pf.PressFile.preset(TWO_SENSORS), PITCH_MM), seed=1)
    with tempfile.TemporaryDirectory() as cache:
        part = run_part(press, PLAN, Path(cache), pitch_mm=PITCH_MM, processes=1, progress=lambda _step: None)
    (tables,) = part.result.tables.values()
    row = next(row for row in tables if row.name == "1 sensor")
    paper = np.array([float(digits) for digits in PRINTED["1 sensor"][1]])
    print("alpha    paper   oracle   honest")
    for alpha, printed, oracle, honest in zip(ALPHAS, paper, row.oracle, row.honest, strict=True):
        print(f"{alpha:<8g} {printed:<7.2g} {oracle.value:<8.2g} {honest.value:.2g}")

    figure = Figure(figsize=(6.5, 4.2), layout="constrained")
    axes = figure.subplots()
    axes.plot(ALPHAS, paper, "o", color="black", mfc="none", label="paper, Table 1")
    for name, found, colour in (("oracle", row.oracle, "#0b4f9e"), ("honest", row.honest, "#c0271d")):
        axes.plot(ALPHAS, [one.value for one in found], color=colour, label=name)
        low, high = ([getattr(one, end) for one in found] for end in ("low", "high"))
        axes.fill_between(ALPHAS, np.maximum(low, 1e-5), high, color=colour, alpha=0.15, lw=0)
    axes.plot(ALPHAS, np.minimum(1, ALPHAS), ":", color="0.5", label="never or always stopping")
    axes.set(
        title=f"One sensor, {PLAN.test} test designs, {PITCH_MM} mm a pixel",
        xlabel="relative cost of a miss, alpha [-]",
        ylabel="c [-]",
        xscale="log",
        yscale="log",
        ylim=(1e-5, 10),
    )
    axes.legend(fontsize=8)
    figure.savefig(out / "table-1.png", dpi=110)


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]))  # the folder for what is drawn; without one, this folder

"""# Teach a press

Presses drift: ink, lamp and register are never quite those of yesterday. To the paper's detectors such prints are
misprints. Ours is taught what good prints of a press do: simulated ones, of page designs that it will not see again.
Then it promises how rarely a good page alarms; with the few designs of this example, one page in ten.

The picture: scores over thresholds of good prints and of misprints, of the paper's first detector and of ours. What
lies above the line alarms.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

from matplotlib.figure import Figure

import prooflight as pf
from prooflight.commissioning.training.train import trained
from prooflight.simulation.corpus.corpus import Corpus

TRAINING = 24
PRINTS = {
    "good": None,
    "density": "density:0.8",
    "streak": "streak:0.9",
    "missing": "missing-content:0.9",
}
DAYS = 3


@dataclass(frozen=True)
class SmallPages:
    """Composed designs at an eighth of their size, for a camera of 400 pixels."""

    dpi: float

    def page(self, index: int) -> pf.Page:
        """Design `index`, from 0."""
        return replace(Corpus(seed=5, dpi=56.0).page(index), dpi=self.dpi)


def main(out: Path) -> None:
    """Teach, print on other days, inspect."""
    press = pf.build_press(pf.PressFile.prototype(), seed=1, pixels=400)
    press = replace(press, good_pages_per_false_alarm=10.0)
    pages = SmallPages(dpi=press.dpi)
    press = trained(press, pages, designs=TRAINING, seed=1, processes=1)
    press.save(out / "taught.press")

    figure = Figure(figsize=(9, 4), layout="constrained")
    for axes, name in zip(figure.subplots(1, 2), ("chi-square", "matched_filter"), strict=True):
        inspector = pf.Inspector.of(press, name)
        print(f"{name} promises: {inspector.guarantee}")
        alarms = dict.fromkeys(PRINTS, 0)
        for day in range(1, DAYS + 1):
            page = pages.page(TRAINING + day)
            ready = inspector.prepare(page)
            for place, (kind, misprint) in enumerate(PRINTS.items()):
                scan = pf.simulate(page, press, misprint=misprint, world="press", seed=day)
                verdict = inspector.inspect(ready, scan).verdict
                alarms[kind] += verdict.verdict == "misprint"
                if verdict.score is not None and verdict.threshold is not None:
                    colour = "#c0271d" if misprint else "#1a7f4b"
                    axes.plot(place, verdict.score / verdict.threshold, "o", color=colour, alpha=0.7)
        print("  alarms: " + ", ".join(f"{kind} {count} of {DAYS}" for kind, count in alarms.items()))
        axes.axhline(1, color="0.4", lw=1)
        axes.set(title=name, ylabel="score over threshold [-]")
        axes.set_yscale("log" if name == "chi-square" else "linear")
        axes.set_xticks(range(len(PRINTS)), [*PRINTS])
    figure.savefig(out / "taught.png", dpi=110)


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]))  # the folder for what is drawn; without one, this folder

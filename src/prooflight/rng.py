"""Random number streams: every generator of the product and of its studies is made by ``stream``.

A stream is named by what is drawn from it. ``PURPOSES`` gives the seed sequence of each name, with all its
fixed numbers. Published figures were drawn from these sequences, so they stay the same to the bit.

NumPy fills a seed sequence with zeros to four words, so ``[seed, design, 0]`` is ``[seed, design]``, and an
index may equal another purpose's fixed number. Purposes can therefore coincide (``KNOWN_SHARED`` in
``tests/test_rng.py``):

- at ``[seed]``, which is ``[seed, 0]``: a purpose with a seed alone, and number 0 of one with one index;
- at ``[seed, n]``: number n of a purpose with one index, and one with n as its fixed number;
- at ``[seed, n, k]``: the k-th of several items of one design, page or sheet;
- at ``[seed, 0, 0, 0, 1]``: the second child of ``[seed]``, and a press day that begins with design 0.

This matters where one run draws both with one seed, as these runs do:

- ``study paper``, ``design`` and ``robustness``: a pilot's print and the drawing of its design; the resampling of
  costs and design 2;
- ``study calibration``: the session and the choice of colours of a job's page 1;
- ``study ink``: the folds and the noise whose median is stated;
- ``watch``: the faults of its drum and sheet 9;
- the specimen of a press, which most studies draw with seed 1, and what they draw at ``[1]``: design 0 of
  ``design`` and ``robustness``, the recipes of ``press build``, ``tables`` and ``calibration``, the
  first piece of ``worlds``, the first drifting day of ``running``, the pages of ``bench``, the misprints and sheet 0 of
  ``demo``, sheet 0 of ``watch``.

The same bits then determine two quantities, such as a layout and a noise. Whether a published figure depends
on that has not been measured. A new purpose coincides with none if its second word is fixed, and a number
after ``FREE`` that is not taken.
"""

from __future__ import annotations

import operator
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np


@dataclass(frozen=True, slots=True)
class From:
    """An index that counts from another number than 0 in its seed sequence."""

    first: int
    name: str


@dataclass(frozen=True, slots=True)
class Purpose:
    """Use and seed sequence of a stream."""

    draws: str
    """Quantities drawn from the stream."""
    layout: tuple[int | str | From, ...]
    """Seed sequence: fixed numbers, and names of the arguments of ``stream``. The seed, given or fixed, is
    first."""

    @property
    def seeded(self) -> bool:
        """Whether the stream takes a seed; if not, its draws are the same in every run."""
        return self.layout[0] == SEED

    @property
    def indices(self) -> tuple[str, ...]:
        """Names of the stream's indices."""
        names = (item.name if isinstance(item, From) else item for item in self.layout)
        return tuple(name for name in names if isinstance(name, str) and name != SEED)


SEED: Final = "seed"
FREE: Final = 2**31
"""Number above every index; as a second word, it and each number after it belong to one purpose alone."""

PURPOSES: Final[Mapping[str, Purpose]] = MappingProxyType(
    {
        "a4-design": Purpose("words, pictures and layout of a design on A4", (SEED, "design")),
        "asked-sheets": Purpose("whether a sheet that passed is asked about", (SEED, FREE + 60, "sheet")),
        "bench-page": Purpose("bars and gradients of the pages on which speed is measured", (1,)),
        "bench-scan": Purpose("noise of the scans on which speed is measured", (2,)),
        "block-canary": Purpose("words by which bytes that did not arrive are known", (SEED, FREE + 17)),
        "blue-noise": Purpose("where the first dots of the tile of thresholds lie", (3, FREE + 85)),
        "bootstrap": Purpose("which press days resample a cost, the same for every detector", (SEED, 2)),
        "calibration-chart": Purpose("places, prints and scans of a chart's patches", (SEED, "patches")),
        "calibration-session": Purpose("the session in which all charts are printed", (SEED, 1)),
        "camera-losses": Purpose(
            "losses, arrivals and lines of cameras on loopback", (SEED, FREE + 18, "part")
        ),
        "camera-noise": Purpose("noise of a sheet before two cameras", (SEED, FREE + 19, "sheet", "sensor")),
        "card-print": Purpose(
            "prints for a graphics card and the processor", (SEED, FREE + 84, "copy", "page")
        ),
        "chart-places": Purpose("places of the patches on a chart to be printed", (SEED,)),
        "cluster-page": Purpose("text of a page by which clusters are measured", (SEED, FREE + 141, "page")),
        "content-session": Purpose("the session of a press day", (SEED, FREE + 41, "day")),
        "content-sheet": Purpose("codes of a sheet, their damage and its prints", (SEED, FREE + 40, "sheet")),
        "content-text": Purpose(
            "numbers of a sheet, what is wrong with one, and prints", (SEED, FREE + 60, "sheet", "size")
        ),
        "content-text-session": Purpose(
            "the press day of sheets of numbers", (SEED, FREE + 61, "sheet", "size")
        ),
        "demonstration-misprints": Purpose("which sheets of the demonstration are misprints", (SEED,)),
        "design": Purpose("size, words, pictures and layout of a page design", (SEED, "design")),
        "dither": Purpose("order of the words that stand for what rounding lost", (2011,)),
        "drift-prints": Purpose("prints and scans of a press that drifts", (SEED, 1)),
        "drift-session": Purpose("the session in which a press drifts", (SEED, 0)),
        "drum-faults": Purpose("where the faults of a simulated drum lie", (SEED, 9)),
        "exchangeability-ties": Purpose(
            "ranks of pages that tie, and which page is forgotten", (SEED, FREE + 11)
        ),
        "feedback-weeks": Purpose("days and questions of one history of weeks", (SEED, FREE + 61, "history")),
        "gate-bootstrap": Purpose("which times resample the tail of a gate's", (SEED, FREE + 42)),
        "gate-plan": Purpose("sheets, verdicts and slips of the gate's long run", (SEED, FREE + 19)),
        "golden-bootstrap": Purpose("which pairs resample the rates of the golden detector", (SEED,)),
        "golden-transforms": Purpose("known moves of a golden scan", (SEED, FREE + 1, "transform", "pair")),
        "hot-folder": Purpose("files that are sent into a hot folder, and kills", (SEED, FREE + 110)),
        "ink-noise": Purpose("noise of measured spectra that teach: a child a draw", (SEED,)),
        "ink-noise-median": Purpose("noise whose median colour difference is said", (SEED,)),
        "lost-lines": Purpose("the camera's noise where it lost lines", (SEED, FREE + 16)),
        "misprint-rounding": Purpose("rounding of a misprint's tints; seeded by its print", (SEED,)),
        "piece-places": Purpose("where small pages are cut from a design", (SEED, "design", 1)),
        "pilot-print": Purpose("a good print and its scan, to learn variation from", (SEED, "design", 0)),
        "plant-defect": Purpose(
            "one simulated defect of a run, and its sheets", (SEED, FREE + 101, "defect")
        ),
        "plant-loop": Purpose("a press that drifts, with and without corrections", (SEED, FREE + 103, "run")),
        "plant-null": Purpose("marks of a run without a cause", (SEED, FREE + 102, "run")),
        "plant-prints": Purpose("prints with a defect at a known place", (SEED, FREE + 100, "design")),
        "print": Purpose("misprint, print and noise of a sheet", (SEED, "sheet")),
        "ranking-fold": Purpose(
            "trees that judge one fold of the pages that teach", (SEED, FREE + 9, "fold")
        ),
        "ranking-trees": Purpose("trees of the ranking that is shipped", (SEED, FREE + 10)),
        "real-marks": Purpose("marks laid into scans of a real sheet", (SEED, FREE + 95, "copy", "page")),
        "recipe-folds": Purpose("which fold of the cross-validation a recipe is in", (SEED,)),
        "record-backlog": Purpose("runs of a week, and their sheets, for the records", (SEED, FREE + 142)),
        "record-searches": Purpose("searches of people over the records of presses", (SEED, FREE + 97)),
        "registration-prints": Purpose(
            "a design's session and prints", (SEED, FREE + 2, "design", "real", "crops")
        ),
        "rich-black": Purpose("which blacks of a design are of four inks", (SEED, "design", 4)),
        "rip-day": Purpose(
            "the session of a press that rips PDFs itself, of pages that are learned (0) or judged (1)",
            (SEED, FREE + 73, "learned or judged", "day", "copy"),
        ),
        "rip-print": Purpose(
            "a print of such a press, good (0) or a misprint (1), and which misprint it is (2)",
            (SEED, FREE + 74, "learned or judged", "page", "copy", "good, misprint or which"),
        ),
        "running-misprint": Purpose("a misprint and its scan, for the drum", (SEED, FREE + 15, "sheet")),
        "running-print": Purpose("a print and its scan, for the drum", (SEED, "sheet", 2)),
        "sample-job": Purpose("stock, invoices and charts of the sample job, a child each", (SEED,)),
        "sample-run": Purpose("sheets of a made-up run, for tests and pictures", (SEED, FREE + 127, "run")),
        "scene-print": Purpose("misprint, print and noise of a copy", (SEED, "scene", "design", "copy", 3)),
        "scene-session": Purpose("the session of a press day", (SEED, "scene", "first design", 2)),
        "session": Purpose("the session of a run of prints", (SEED, 0, 1)),
        "soak-faults": Purpose("when the drum of the soak fails, and how", (SEED, FREE + 3)),
        "soak-forms": Purpose("fields of a form, and the words in them", (SEED, FREE + 4, "template")),
        "soak-print": Purpose("print and noise of a sheet of the soak", (SEED, FREE + 5, "sheet")),
        "specimen": Purpose("a camera's fixed pattern, then its calibration exposures", (SEED,)),
        "strangers": Purpose(
            "scan of a blank sheet (0), or of no page of the job (1)", (SEED, FREE, "sheet")
        ),
        "stress-bootstrap": Purpose("which press days resample costs as built", (SEED, FREE + 14)),
        "stress-day": Purpose(
            "what of a nuisance stays for a press day", (SEED, FREE + 6, "scene", "first design")
        ),
        "stress-mark": Purpose(
            "a misprint that no detector is taught by", (SEED, FREE + 7, "scene", "design", "kind")
        ),
        "stress-nuisance": Purpose("a nuisance of one print; seeded by the print", (SEED, FREE + 8)),
        "stress-ties": Purpose("ties among summaries of a run's pages", (SEED, FREE + 12, "run")),
        "study-print": Purpose("misprint, print and noise of a copy", (SEED, "design", From(1, "copy"))),
        "study-session": Purpose("the session of a press day", (SEED, "set", "first design", 0, 1)),
        "table-colours": Purpose("which of a page's rarer colours stand for all", (SEED, "page")),
        "table-noise": Purpose("errors of tables measured by so many exposures", (4, "exposures")),
        "training-print": Purpose("prints of a design that teach a press", (SEED, "design", 12)),
        "training-session": Purpose("the session of a press day", (SEED, "first design", 11)),
        "trial-recipes": Purpose("recipes on which a press's tables are judged", (SEED,)),
        "visible-blank": Purpose("what a nearly blank page has", (SEED, FREE + 80, "page")),
        "visible-curve": Purpose(
            "days, marks and prints of a page of all places", (SEED, FREE + 81, "camera", "page")
        ),
        "visible-page": Purpose("tint, picture and words of a page of all places", (SEED, FREE + 82, "page")),
        "visible-print": Purpose(
            "day, marks and prints of a page", (SEED, FREE + 83, "camera", "source", "page")
        ),
        "world-piece": Purpose("where a page is cut, to be printed on both paths", (SEED, "page")),
        "world-print": Purpose("session and print that both paths share", (SEED, "page", 1)),
        "zones-came": Purpose("prints and defects that a price is held against", (SEED, FREE + 65, "print")),
        "zones-print": Purpose("page, day and print that calibrate zones", (SEED, FREE + 62, "print")),
        "zones-strengths": Purpose("strengths of the defects that zones are priced by", (SEED, FREE + 64)),
        "zones-study": Purpose("where the zones of a page lie", (SEED, FREE + 66, "page")),
        "zones-trial": Purpose("page, day and print of a defect in a zone", (SEED, FREE + 63, "print")),
    }
)
"""Purposes of the streams by name, in the order of names."""


def stream(seed: int | None, purpose: str, *indices: int) -> np.random.Generator:
    """Return the generator of one purpose, whose numbers do not depend on other draws or their order.

    Parameters
    ----------
    seed : the user's, from 0; None for a purpose whose seed is fixed
    purpose : a name in ``PURPOSES``
    indices : those that ``PURPOSES`` names, from 0

    Raises
    ------
    ValueError
        if there is no such purpose, or it does not take these numbers
    """
    return np.random.default_rng(seed_sequence(seed, purpose, *indices))


def seed_sequence(seed: int | None, purpose: str, *indices: int) -> list[int]:
    """Return the seed sequence of a stream; arguments and errors as of ``stream``."""
    if purpose not in PURPOSES:
        raise ValueError(f"there is no stream {purpose!r}: choose from {', '.join(PURPOSES)}")
    wanted = PURPOSES[purpose]
    if wanted.seeded != (seed is not None):
        needs = "takes a seed" if wanted.seeded else "has a fixed seed: give None"
        raise ValueError(f"stream {purpose!r} {needs}")
    if len(indices) != len(wanted.indices):
        raise ValueError(f"stream {purpose!r} takes {wanted.indices} in addition to the seed, not {indices}")
    numbers = [operator.index(number) for number in (indices if seed is None else (seed, *indices))]
    if any(number < 0 for number in numbers):
        raise ValueError(f"stream {purpose!r} counts from 0: {numbers}")
    given = iter(numbers)
    return [item if isinstance(item, int) else _first(item) + next(given) for item in wanted.layout]


def _first(item: str | From) -> int:
    return item.first if isinstance(item, From) else 0

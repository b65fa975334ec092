"""Cache of trained presses: the same press, trained by the same program in the same way, is trained once.

Training prints designs by simulation for a minute or more, and its result depends on nothing but the
untrained press, the plan and the program. A trained press is therefore stored in the user's cache folder,
under a digest of these three.
"""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from prooflight.commissioning.build import build_press
from prooflight.commissioning.training.train import DEFAULT_RATE, Shown, trained
from prooflight.errors import ProoflightError
from prooflight.files.program import program_digest
from prooflight.files.user_folders import user_folder
from prooflight.press.artefact import Press
from prooflight.simulation.corpus.corpus import Corpus

if TYPE_CHECKING:
    from prooflight.detectors.entry import TrainedModel, Training
    from prooflight.pages.parallel import Processes
    from prooflight.press.press_file import PressFile

_log = logging.getLogger(__name__)

COMPOSED_SEED: Final = 70_000
"""First seed of the designs that presses are trained on, separate from those of studies."""
MOST_PRESSES: Final = 8
"""Number of trained presses that are stored, some 20 MB each.

The least recently used one is removed first.
"""


def trained_once(
    press: Press,
    *,
    designs: int,
    seed: int,
    false_alarm_rate: float = DEFAULT_RATE,
    paper: bool = False,
    progress: Callable[[str], None] = lambda _step: None,
    shown: Shown = lambda items, _total, _what: iter(items),
    processes: Processes = None,
) -> Press:
    """Return the press as ``train.trained`` makes it on composed designs, from the cache where it holds it.

    Parameters
    ----------
    press
        The press as ``build_press`` makes it.
    designs, seed, false_alarm_rate, paper, shown, processes
        See ``train.trained``.
    progress
        Called with a message when the cache held the press.

    Raises
    ------
    RequestError
        If there are too few designs.
    """

    def build() -> Press:
        return trained(
            press,
            Corpus(seed=COMPOSED_SEED + seed, dpi=press.dpi),
            designs=designs,
            seed=seed,
            false_alarm_rate=false_alarm_rate,
            paper=paper,
            shown=shown,
            processes=processes,
        )

    plan = f"{designs} {seed} {false_alarm_rate!r} {paper}"
    return cached_press(f"{press.digest} {plan}", build, progress=progress)


def preset_once(
    press_file: PressFile,
    *,
    pixels: int | None,
    designs: int,
    seed: int,
    progress: Callable[[str], None] = lambda _step: None,
    shown: Shown = lambda items, _total, _what: iter(items),
) -> Press:
    """Return a preset's press, built and trained on composed designs; from the cache it is not even built.

    A preset's text names no other file, so it determines the press.

    Parameters
    ----------
    press_file
        The preset.
    pixels
        See ``build_press``.
    designs, seed, shown
        See ``train.trained``.
    progress
        Called with a message at each step.

    Raises
    ------
    RequestError
        If there are too few designs.
    """

    def build() -> Press:
        press = build_press(press_file, seed=seed, pixels=pixels, progress=progress)
        return trained(
            press, Corpus(seed=COMPOSED_SEED + seed, dpi=press.dpi), designs=designs, seed=seed, shown=shown
        )

    return cached_press(f"{press_file.text} {pixels} {designs} {seed}", build, progress=progress)


def trained_models(press: Press, names: Sequence[str], training: Training) -> Mapping[str, TrainedModel]:
    """Train Prooflight's own detectors of these names; see ``detectors.entry.Train``."""
    whole = trained_once(
        press,
        designs=training.designs,
        seed=training.seed,
        false_alarm_rate=training.false_alarm_rate,
        paper="bayes" in names,
        progress=training.progress,
        shown=training.shown,
        processes=training.processes,
    )
    return {name: whole.detectors[name] for name in names}


def cached_press(
    key: str, build: Callable[[], Press], *, progress: Callable[[str], None] = lambda _step: None
) -> Press:
    """Return the press that ``build`` makes, from the cache where this program has made it before.

    key: text of everything that the press depends on, apart from the program.
    """
    digest = hashlib.sha256(f"{key} {program_digest()}".encode()).hexdigest()
    path = cache_folder() / f"{digest}.press"
    cached = _load(path)
    if cached is not None:
        progress(f"the press is trained already: using the one in {path.parent}")
        return cached
    built = build()
    _save(built, path)
    return built


def cache_folder() -> Path:
    """Return the folder of trained presses."""
    return user_folder("cache") / "presses"


def _load(path: Path) -> Press | None:
    """Return the press of a file; None if there is none, or none that can be used."""
    try:
        press = Press.load(path)
        os.utime(path)
    except (OSError, ProoflightError) as error:
        if path.exists():
            _log.warning("%s cannot be used (%s); the press is trained again", path, error)
        return None
    return press


def _save(press: Press, path: Path) -> None:
    """Store a press and remove those least recently used.

    Where nothing can be written, each build trains again.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        press.save(path)
        by_age = sorted(path.parent.glob("*.press"), key=lambda one: one.stat().st_mtime)
        for old in by_age[:-MOST_PRESSES]:
            old.unlink(missing_ok=True)
    except (OSError, ProoflightError) as error:
        _log.debug("%s: trained presses cannot be stored (%s)", path.parent, error)

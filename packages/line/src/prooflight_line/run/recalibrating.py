"""Recalibration of a press by labels: the threshold that they give, what it would have done, and the way back.

The command line and the console call these functions; neither changes the artefact that is in use.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from prooflight.detectors.optional import Recalibrates
from prooflight.detectors.registry import default_name
from prooflight.errors import RequestError
from prooflight_line.journal.labels import LabelStore
from prooflight_line.run.labelled_sheets import labelled_pages, replayed_run, sample_of_run

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from prooflight.detectors.weighted_conformal import LabelledPages
    from prooflight.press.artefact import Press
    from prooflight_line.journal.reading import JournalReader
    from prooflight_line.journal.records import RunRow
    from prooflight_line.run.labelled_sheets import Replayed, SampledSheet


@dataclass(frozen=True, slots=True, kw_only=True)
class Recalibrated:
    """A press with the threshold of people's labels; the press that it replaces is unchanged."""

    press: Press
    replaces: str
    """Digest of the press that it replaces."""
    labelled: LabelledPages
    threshold_before: float
    threshold: float
    guarantee: str
    """The false-alarm rate that is guaranteed, in words."""
    replays: tuple[Replayed, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class SampledRun:
    """A run that the press judged, with the sheets that people were asked about."""

    reader: JournalReader
    run: RunRow
    sheets: list[SampledSheet]


def recalibratable(press: Press, detector: str | None, *, where: object) -> tuple[str, Recalibrates]:
    """Return name and model of the detector whose threshold labels can set; RequestError: there is none.

    ``where`` is the artefact.
    """
    name = detector or default_name(press)
    model = press.detectors.get(name)
    if not isinstance(model, Recalibrates):
        what = f"{name!r} of press {press.name} has no threshold that labels could set"
        raise RequestError(where, what, remedy="build it with `prooflight press build --detector quick`")
    return name, model


def same_scale(press: Press, name: str) -> frozenset[str]:
    """Return the digests of the presses whose scores by the detector ``name`` are those of this one.

    They differ from it in the threshold or in the costs alone.
    """
    model = press.detectors.get(name)
    recalibrations = model.recalibrations if isinstance(model, Recalibrates) else ()
    return press.scored_alike | {labelled.replaces for labelled in recalibrations}


def sampled_runs(press: Press, name: str, journals: Sequence[JournalReader]) -> Iterator[SampledRun]:
    """Yield the runs that a press, or one whose threshold it replaces, judged by its detector ``name``."""
    digests = same_scale(press, name)
    for opened in journals:
        for run in opened.runs():
            if run.facts.detector == name and run.facts.press_digest in digests:
                yield SampledRun(
                    reader=opened, run=run, sheets=sample_of_run(opened, LabelStore(opened.path), run)
                )


def recalibrated(
    press: Press,
    journals: Sequence[JournalReader],
    *,
    detector: str | None,
    guaranteed_pages: float | None,
    half_life_days: float | None,
    replay: int,
    now_s: float,
    where: object,
) -> Recalibrated:
    """Return the press with the threshold that the labels of alarms and of the random sample give.

    Parameters
    ----------
    guaranteed_pages
        One good page in so many may alarm; None: the rate of the press.
    half_life_days
        Age at which pages count half; None: all count equally.
    replay
        Number of last runs of each journal that are replayed at the new threshold.
    now_s
        Unix time. [s]

    Raises
    ------
    RequestError
        If the press has no such threshold, or the labels are too few.
    """
    name, model = recalibratable(press, detector, where=where)
    runs = list(sampled_runs(press, name, journals))
    labelled = labelled_pages(
        [(one.run, one.sheets) for one in runs],
        replaces=press.digest,
        rate=1 / guaranteed_pages if guaranteed_pages else model.guarantee.rate,
        now_s=now_s,
        journals=[opened.path.name for opened in journals],
        half_life_days=half_life_days,
    )
    new = model.recalibrated(labelled)
    replays: list[Replayed] = []
    for opened in journals:
        of_journal = [one for one in runs if one.reader is opened]
        for one in of_journal[max(len(of_journal) - replay, 0) :]:
            records = opened.pages(one.run.id)
            replays.append(replayed_run(one.run, records, one.sheets, threshold=new.threshold))
    return Recalibrated(
        press=press.with_threshold(name, new),
        replaces=press.digest,
        labelled=labelled,
        threshold_before=model.threshold,
        threshold=new.threshold,
        guarantee=str(new.guarantee),
        replays=tuple(replays),
    )


def before_recalibration(press: Press, where: object) -> Press:
    """Return the press that this one replaced; RequestError if it replaced none, or another one than it names."""
    models = (
        (name, model, last)
        for name, model in press.detectors.items()
        if isinstance(model, Recalibrates) and (last := model.before_recalibration()) is not None
    )
    previous = next(models, None)
    if previous is None:
        raise RequestError(
            where, "was never recalibrated", remedy="it replaced no other press artefact: use it"
        )
    name, model, last = previous
    before, wanted = press.with_threshold(name, last), model.recalibrations[-1].replaces
    if wanted != before.digest:
        what = f"replaced {wanted[:16]}, which cannot be restored (the result is {before.digest[:16]})"
        raise RequestError(where, what, remedy="restore the press artefact of that time from a backup")
    return before

"""The work that makes a version of the press, in a process of the lowest priority: learn, recalibrate, build, costs.

Each step calls what the command of the same name calls, writes an artefact beside the press, and computes what this
version would have done in the last runs. It puts nothing to use.
"""

from __future__ import annotations

import secrets
import time
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Final, Literal

from prooflight.commissioning.build import build_press
from prooflight.commissioning.training import DESIGNS
from prooflight.commissioning.training.real_pages import learn_pages
from prooflight.commissioning.training.train import DEFAULT_RATE
from prooflight.detectors.entry import Training
from prooflight.detectors.optional import Recalibrates
from prooflight.detectors.registry import default_name, training_functions
from prooflight.errors import RequestError
from prooflight.files.lock import WriterLock
from prooflight.inspection.inspector import Inspector
from prooflight.inspection.job import InspectPage, ScanPage, paired
from prooflight.press.artefact import Press
from prooflight.press.pages import job_source
from prooflight.press.press_file import PressFile
from prooflight_console.child_process import result_or_refusal, send_result
from prooflight_console.engineering.effect import judged_sheets, of_version, recent_runs
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.labels import LabelStore
from prooflight_line.run.recalibrating import recalibrated, same_scale

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from multiprocessing.connection import Connection
    from pathlib import Path

    from prooflight_line.journal.reading import JournalReader

Step = Literal["learn", "recalibrate", "build", "costs"]


@dataclass(frozen=True, slots=True, kw_only=True)
class StepRequest:
    """Inputs of a step."""

    step: Step
    press: Path
    """The press in use, which stays as it is."""
    journal: Path
    folder: Path
    """Folder of the versions, in which the new artefact is written."""
    guaranteed_pages: float | None = None
    """One good page in so many may alarm; None: the rate of the press."""
    job: Path | None = None
    scans: Path | None = None
    """Recorded scans of the job's good pages, for ``learn``."""
    press_file: Path | None = None
    """File from which ``build`` makes the press."""
    false_alarm_cents: float | None = None
    missed_misprint_cents: float | None = None
    """Cost that ``costs`` sets."""
    digests: frozenset[str] = field(default_factory=frozenset)
    """Digests of all versions of the press, whose runs are looked at."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StepProgress:
    """Progress of a step; without a total, ``done`` and ``total`` are 0."""

    what: str
    done: int = 0
    total: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class StepResult:
    """Result of a step: an artefact that nothing uses yet."""

    path: Path | None
    """The artefact; None: none was made, since more pages are needed first."""
    digest: str
    facts: dict[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class StepRefused:
    """Failure of a step."""

    why: str


def step_aside(request: StepRequest, sender: Connection) -> None:
    """Do a step in a process of its own: sends ``StepProgress``, then ``StepResult`` or ``StepRefused``.

    Ends when nobody receives any more.
    """
    send_result(
        sender,
        lambda: result_or_refusal(
            lambda: STEPS[request.step](request, _Reports(sender)),
            lambda why: StepRefused(why=why),
            what=f"the step {request.step}",
        ),
    )


@dataclass(frozen=True, slots=True)
class _Reports:
    sender: Connection

    def say(self, what: str) -> None:
        self.sender.send(StepProgress(what=what))

    def shown(self, items: Iterable[Any], total: int, what: str) -> Iterator[Any]:
        for done, one in enumerate(items, start=1):
            yield one
            self.sender.send(StepProgress(what=what, done=done, total=total))


def _learn(request: StepRequest, reports: _Reports) -> StepResult:
    if request.job is None or request.scans is None:
        raise RequestError("learn", "there are no scans", remedy="start the console with --job and --scans")
    press, target = Press.load(request.press), _target(request)
    lock = WriterLock.take(
        request.press,
        error=RequestError,
        wait="wait until the other call has ended, then start again",
        elsewhere="let the console write next to the press",
    )
    try:
        source = job_source(request.job, press)
        with source.open() as opened:
            pairs = [
                (number, scan)
                for number, scan in paired(opened, request.scans, sensors=len(press.sensors))
                if scan is not None
            ]
        inspect = ScanPage(InspectPage(job=source, inspector=Inspector.of(press)))
        seen = list(reports.shown(map(inspect, pairs), len(pairs), "pages"))
        rate = 1 / request.guaranteed_pages if request.guaranteed_pages else None
        done = learn_pages(request.press, press, seen, false_alarm_rate=rate, out=target)
    finally:
        lock.release()
    facts = {
        "pages": len(seen),
        "new": done.new,
        "alarms_before": done.alarms_before,
        "support": done.sentence,
    }
    if done.waiting:
        return StepResult(path=None, digest="", facts=facts | {"waiting": True})
    return _result(request, reports, target, done.press, facts)


def _recalibrate(request: StepRequest, reports: _Reports) -> StepResult:
    press, target = Press.load(request.press), _target(request)
    reports.say("labels")
    with Journal.open(str(request.journal), read_only=True) as opened:
        done = recalibrated(
            press,
            [opened],
            detector=None,
            guaranteed_pages=request.guaranteed_pages,
            half_life_days=None,
            replay=0,
            now_s=time.time(),
            where=request.press,
        )
    done.press.save(target)
    facts = {
        "threshold_before": done.threshold_before,
        "sampled": int(done.labelled.passed.sum()),
        "false_alarms": int((~done.labelled.passed).sum()),
    }
    return _result(request, reports, target, done.press, facts)


def _build(request: StepRequest, reports: _Reports) -> StepResult:
    if request.press_file is None:
        what = "there is no press file"
        raise RequestError("build", what, remedy="start the console with --press-file PRESS.toml")
    target, settings = _target(request), PressFile.read(request.press_file)
    press = build_press(settings, seed=1, progress=reports.say)
    rate = 1 / settings.good_pages_per_false_alarm if settings.states_rate else DEFAULT_RATE
    training = Training(
        designs=DESIGNS,
        seed=1,
        false_alarm_rate=1 / request.guaranteed_pages if request.guaranteed_pages else rate,
        progress=reports.say,
        shown=reports.shown,
    )
    for train, of in training_functions(("matched_filter",)).items():
        for name, model in train(press, of, training).items():
            press = press.with_detector(name, model)
    press.save(target)
    return _result(request, reports, target, press, {"press_file": request.press_file.name})


def _costs(request: StepRequest, reports: _Reports) -> StepResult:
    press, target = Press.load(request.press), _target(request)
    alarm, miss = request.false_alarm_cents, request.missed_misprint_cents
    if alarm is None or miss is None:
        raise RequestError("costs", "none are given", remedy="give the cost of a false alarm and of a miss")
    before = press.costs
    if (alarm, miss) == (before.false_alarm_cents, before.missed_misprint_cents):
        raise RequestError("costs", "they are already in use", remedy="give other costs")
    changed = press.with_costs(false_alarm_cents=alarm, missed_misprint_cents=miss)
    changed.save(target)
    return _result(
        request, reports, target, changed, {"false_alarm_cents": alarm, "missed_misprint_cents": miss}
    )


STEPS: Final[dict[Step, Callable[[StepRequest, _Reports], StepResult]]] = {
    "learn": _learn,
    "recalibrate": _recalibrate,
    "build": _build,
    "costs": _costs,
}


def _target(request: StepRequest) -> Path:
    request.folder.mkdir(parents=True, exist_ok=True)
    return request.folder / f".{secrets.token_hex(8)}.part"


def _result(
    request: StepRequest, reports: _Reports, path: Path, press: Press, facts: dict[str, Any]
) -> StepResult:
    """Return the result with what this version would have done in the last runs."""
    reports.say("replay")
    name = default_name(press)
    model = press.detectors.get(name)
    if isinstance(model, Recalibrates):
        facts = facts | {"threshold": model.threshold, "guarantee": str(model.guarantee)}
    if request.journal.exists():
        with Journal.open(str(request.journal), read_only=True) as opened:
            facts = facts | {"effect": asdict(_effect(request, opened, press, name))}
    return StepResult(path=path, digest=press.digest, facts=facts)


def _effect(request: StepRequest, opened: JournalReader, press: Press, name: str) -> Any:
    runs = recent_runs(
        (run for run in opened.runs() if run.facts.press_digest in request.digests), now_s=time.time()
    )
    # Without a threshold that scores could be compared with, all is decided again.
    same = (
        same_scale(press, name) if isinstance(press.detectors.get(name), Recalibrates) else frozenset[str]()
    )
    sheets = judged_sheets(
        opened, LabelStore(opened.path), runs, detector=name, same_scale=same, evidence=True
    )
    return of_version(sheets, press, name)

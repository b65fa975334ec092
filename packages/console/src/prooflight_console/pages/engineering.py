"""The page Engineering: versions of the press, thresholds, and the steps that make a version."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Annotated, Any, Final

from fastapi import APIRouter, Form, Path, Query, Request
from fastapi.responses import Response

from prooflight.detectors.optional import Recalibrates
from prooflight.detectors.registry import default_name
from prooflight.errors import ProoflightError
from prooflight_console.accounts.roles import Role
from prooflight_console.api.common import console
from prooflight_console.engineering.effect import (
    STEPS,
    Effect,
    ThresholdEffect,
    judged_sheets,
    of_thresholds,
    recent_runs,
)
from prooflight_console.engineering.steps import Step, StepRequest
from prooflight_console.pages.shell import EngineerPage, ViewerPage, page
from prooflight_console.problems import Problem
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.labels import LabelStore
from prooflight_line.run.recalibrating import recalibrated, same_scale

if TYPE_CHECKING:
    from prooflight.press.artefact import Press
    from prooflight_console.console import Console
    from prooflight_console.engineering.versions import PressVersions, Version

router = APIRouter(include_in_schema=False)

MOST_CENTS: Final = 1e9
Digest = Annotated[str, Form(pattern=r"^[0-9a-f]{64}$")]
Cents = Annotated[str | None, Form(max_length=20)]
ThresholdStep = Annotated[int, Query(ge=-STEPS, le=STEPS)]


@router.get("/press/engineering")
def engineering_page(request: Request, who: ViewerPage) -> Response:
    """Return the page; figures of thresholds come later, since a long run takes seconds to read."""
    state = console(request)
    versions = state.work.versions
    if versions is None:
        return page(request, who, "engineering/engineering", versions=None)
    press, digest = versions.in_use()
    name = default_name(press)
    model = press.detectors.get(name)
    return page(
        request,
        who,
        "engineering/engineering",
        versions=[(one, _effect_of(one)) for one in versions.listed()],
        press=press,
        digest=digest,
        model=model if isinstance(model, Recalibrates) else None,
        costs=press.costs,
        may_change=who.role.may(Role.ENGINEER),
        learnable=_learnable(state),
        buildable=state.settings.press_file,
        task=state.work.task,
    )


@router.get("/press/engineering/thresholds")
def thresholds(request: Request, who: ViewerPage, at: ThresholdStep = 0) -> Response:
    """Return the thresholds around the present one, what each would have done, and the one that labels would give."""
    state = console(request)
    versions = _versions(state)
    press, _ = versions.in_use()
    effects = _threshold_effects(state, press)
    calibrated, why = _calibrated(state, versions, press)
    return page(
        request,
        who,
        "engineering/thresholds",
        effects=effects,
        chosen=effects[at + STEPS] if effects else None,
        at=at,
        steps=STEPS,
        calibrated=calibrated,
        why=why,
    )


@router.get("/press/engineering/calibration")
def calibration(request: Request, who: ViewerPage) -> Response:
    """Return the threshold in use beside the one that the labels so far would give, for the page of alarms."""
    state = console(request)
    if state.work.versions is None:
        return page(request, who, "engineering/calibration", model=None, calibrated=None, why="")
    press, _ = state.work.versions.in_use()
    model = press.detectors.get(default_name(press))
    calibrated, why = _calibrated(state, state.work.versions, press)
    model = model if isinstance(model, Recalibrates) else None
    return page(request, who, "engineering/calibration", model=model, calibrated=calibrated, why=why)


@router.get("/press/engineering/work")
def work_part(request: Request, who: ViewerPage) -> Response:
    """Return the state of the step that is being done."""
    state = console(request)
    may_change = who.role.may(Role.ENGINEER)
    in_use = "" if state.work.versions is None else state.work.versions.in_use()[1]
    task = state.work.task
    effect = None if task is None else _effect(task.facts.get("effect"))
    return page(
        request, who, "engineering/work", task=task, effect=effect, may_change=may_change, digest=in_use
    )


@router.post("/press/engineering/work")
def begin(
    request: Request,
    who: EngineerPage,
    step: Annotated[Step, Form()],
    guaranteed_pages: Annotated[float | None, Form(ge=2, le=1e6)] = None,
    job: Annotated[int, Form(ge=1, le=1000)] = 1,
    good: Annotated[bool, Form()] = False,
    false_alarm_cents: Cents = None,
    missed_misprint_cents: Cents = None,
) -> Response:
    """Begin a step. Learning requires that a person has examined the pages: only good ones may be learned."""
    state = console(request)
    versions = _versions(state)
    learnable = dict(enumerate(_learnable(state), start=1))
    if step == "learn" and not good:
        raise Problem(422, "good", "confirm that you have examined these pages, and that all are good")
    if step == "learn" and job not in learnable:
        raise Problem(422, "scans", "there are no scans of this job: start the console with --scans")
    job_path, scans = learnable[job] if step == "learn" else (None, None)
    digests = {one.digest for one in versions.listed()} | {versions.in_use()[0].digest}
    request_ = StepRequest(
        step=step,
        press=versions.press,
        journal=state.settings.journal,
        folder=versions.folder,
        guaranteed_pages=guaranteed_pages,
        job=job_path,
        scans=scans,
        press_file=state.settings.press_file,
        false_alarm_cents=_cents("false_alarm_cents", false_alarm_cents),
        missed_misprint_cents=_cents("missed_misprint_cents", missed_misprint_cents),
        digests=frozenset(digests),
    )
    state.work.begin(request_, by=who.name)
    return work_part(request, who)


@router.post("/press/engineering/work/{task}/cancel")
def cancel(request: Request, who: EngineerPage, task: Annotated[str, Path(max_length=40)]) -> Response:
    """Cancel the step that is being done."""
    console(request).work.cancel(task, by=who.name)
    return work_part(request, who)


@router.post("/press/engineering/use")
def use(request: Request, who: EngineerPage, digest: Digest, seen: Digest) -> Response:
    """Put a version to use for the runs that begin from now on. seen: digest of the one in use as the page shows it."""
    _versions(console(request)).use(digest, seen=seen, who=who)
    return Response(status_code=204, headers={"HX-Redirect": "/press/engineering"})


def _versions(state: Console) -> PressVersions:
    if state.work.versions is None:
        raise Problem(409, "no-press", "start the console with --press")
    return state.work.versions


def _cents(name: str, text: str | None) -> float | None:
    """Return a cost as typed, with a decimal point or comma; Problem 422: it is none."""
    if text is None:
        return None
    try:
        cents = float(text.strip().replace(",", "."))
    except ValueError:
        cents = math.nan
    if not 0 < cents <= MOST_CENTS:
        what = f"{name}: {text.strip()!r} is not a cost; give an amount in cents above 0, such as 0.01"
        raise Problem(422, "cost", what)
    return cents


def _learnable(state: Console) -> list[tuple[Any, Any]]:
    """Return the jobs of which there are scans, and these."""
    return list(zip(state.settings.jobs, state.settings.scans, strict=False))


def _effect_of(version: Version) -> Effect | None:
    return _effect(version.facts.get("effect"))


def _effect(facts: Any) -> Effect | None:
    try:
        return Effect(**facts)
    except TypeError:
        return None


def _threshold_effects(state: Console, press: Press) -> list[ThresholdEffect]:
    """Return the effects of thresholds; none where the press has none that could change, or there is no journal."""
    name, journal = default_name(press), state.settings.journal
    if not isinstance(press.detectors.get(name), Recalibrates) or not journal.exists():
        return []
    same = same_scale(press, name)
    with Journal.open(str(journal), read_only=True) as opened:
        own = (run for run in opened.runs(damaged=lambda _: None) if run.facts.press_digest in same)
        runs = recent_runs(own, now_s=time.time())
        sheets = list(judged_sheets(opened, LabelStore(journal), runs, detector=name, same_scale=same))
    return of_thresholds(sheets, press, name)


def _calibrated(state: Console, versions: PressVersions, press: Press) -> tuple[float | None, str]:
    """Return the threshold that the labels so far would give, or None and why they give none."""
    journal = state.settings.journal
    if not isinstance(press.detectors.get(default_name(press)), Recalibrates) or not journal.exists():
        return None, ""
    try:
        with Journal.open(str(journal), read_only=True) as opened:
            given = recalibrated(
                press,
                [opened],
                detector=None,
                guaranteed_pages=None,
                half_life_days=None,
                replay=0,
                now_s=time.time(),
                where=versions.press,
            )
    except ProoflightError as error:
        return None, str(error)
    return given.threshold, ""

"""Interactive set-up of a line camera: prompts, measurements, messages and edits; it may be stopped and resumed.

The results are written into the press file after each step, whole or not at all. Next to it a protocol (JSON)
records which steps are done, every question with its answer, and how long each took.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from prooflight.commissioning.camera.exposures import Exposure
from prooflight.commissioning.characterise import PROTOCOLS
from prooflight.commissioning.file_edit import write_edits
from prooflight.errors import ProoflightError, RequestError
from prooflight.files.atomic import whole_file
from prooflight.press.press_file import PressFile
from prooflight_line.camera_set_up.bench import Bench
from prooflight_line.camera_set_up.steps import STEPS

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight_line.camera_set_up.bench import StepResult
    from prooflight_line.camera_set_up.line_reader import CameraLineReader
    from prooflight_line.camera_set_up.steps import Step

_VERSION: Final = 1
State = Literal["good", "poor", "skipped", "not needed", "failed"]


class Stopped(Exception):
    """Raised when a person stops; completed steps are stored."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Prompts:
    """Input and output of the prompts."""

    say: Callable[[str, Literal["title", "plain", "good", "poor", "faint"]], None]
    answer: Callable[[str, str, str], str]
    """Function that returns a person's answer, by key, text and the answer of Enter.

    ``Stopped``: nobody answers any more.
    """
    attended: bool
    """Whether somebody can correct a fault: without, the first error ends the set-up."""


@dataclass(slots=True, kw_only=True)
class Protocol:
    """Record of the completed steps."""

    camera: str
    begun: bool
    """Whether the press file was begun for this camera."""
    steps: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Results by step: state, says, values, edits, unmeasured, seconds."""
    questions: list[dict[str, Any]] = field(default_factory=list)
    """Questions: key, words, answer, and seconds until it was given."""
    asking: str = ""
    """Key of the last question."""
    finished: bool = False
    dark: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    columns: list[dict[str, list[float]]] = field(default_factory=list)
    """Columns of each sensor: offset without light [DN], and signal over the mean of all columns."""

    @classmethod
    def of(cls, path: Path, *, camera: str) -> Protocol | None:
        """Read an unfinished protocol.

        None: there is no such file. RequestError: it is of another camera, or damaged.
        """
        if not path.exists():
            return None
        try:
            document = json.loads(PROTOCOLS.read_text(path))
            if document.pop("version") != _VERSION:
                return None
            protocol = cls(**document)
            protocol.dark_exposures()
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise RequestError(
                path, "is not the protocol of a set-up", remedy="delete it to start over"
            ) from error
        if protocol.finished:
            return None
        if protocol.camera != camera:
            what = f"belongs to camera {protocol.camera}, and is unfinished"
            raise RequestError(path, what, remedy="use --again to start over with this camera")
        return protocol

    def keep(self, path: Path) -> None:
        """Write it, whole or not at all."""
        with whole_file(path) as unfinished:
            unfinished.write_text(
                json.dumps({"version": _VERSION, **asdict(self)}, indent=1) + "\n", encoding="utf-8"
            )

    def dark_exposures(self) -> dict[float, tuple[Exposure, ...]]:
        """Return the dark exposures as the steps need them."""
        return {
            float(at): tuple(
                Exposure(**{**one, "column_mean_dn": np.array(one["column_mean_dn"], np.float64)})
                for one in some
            )
            for at, some in self.dark.items()
        }


def protocol_path(press_file: Path) -> Path:
    """Return the path of the protocol, next to the press file."""
    return press_file.with_name(f"{press_file.stem}.set-up.json")


@dataclass(frozen=True, slots=True, kw_only=True)
class SetUp:
    """Set-up of one camera for one press file."""

    line_reader: CameraLineReader
    path: Path
    prompts: Prompts
    protocol: Protocol
    steps: Sequence[Step] = STEPS
    clock: Callable[[], float] = time.monotonic

    def run(self) -> Protocol:
        """Run all steps that are not done; ``Stopped`` keeps the completed ones.

        Raises errors of a step where nobody can correct them.
        """
        bench = Bench(
            line_reader=self.line_reader,
            press=PressFile.read(self.path),
            begun=self.protocol.begun,
            described="camera" in self.protocol.steps,
            ask=self._ask,
            dark=self.protocol.dark_exposures(),
        )
        for at, step in enumerate(self.steps, start=1):
            head = f"{at}/{len(self.steps)} {step.title}"
            done = self.protocol.steps.get(step.key, {}).get("state")
            if done in ("good", "poor", "skipped") and not step.again:
                self.prompts.say(f"{head}: done before ({done})", "faint")
                continue
            if why := step.spared(bench):
                self.prompts.say(f"{head}: not needed, {why}", "faint")
                self._record(step, "not needed", remarks=[why])
                continue
            self.prompts.say(head, "title")
            self._step(step, bench)
        self.protocol.asking, self.protocol.finished = "", True
        self._save()
        return self.protocol

    def _step(self, step: Step, bench: Bench) -> None:
        while True:
            if step.do and self._ask(step.key, f"{step.do} Enter: measure, s: skip, q: stop", "") == "s":
                self._record(step, "skipped", remarks=["skipped"])
                return
            begun_s = self.clock()
            try:
                result = step.measure(bench)
            except (ProoflightError, np.linalg.LinAlgError) as error:
                self.prompts.say(str(error), "poor")
                if not self.prompts.attended:
                    self._record(step, "failed", remarks=[str(error)])
                    raise
                if not step.do and self._ask(f"{step.key}.keep", "r: again, s: skip, q: stop", "s") != "r":
                    self._record(step, "skipped", remarks=[str(error)])
                    return
                continue
            seconds = self.clock() - begun_s
            self._report(result)
            question = (
                "Enter: keep, r: again, s: skip"
                if result.good
                else "Not good. r: again, Enter: keep, s: skip"
            )
            answer = self._ask(f"{step.key}.keep", question, "") if step.do else ""
            if answer == "r":
                continue
            if answer == "s":
                self._record(step, "skipped", remarks=list(result.remarks), seconds=seconds)
                return
            if result.edits:
                bench.press = write_edits(self.path, result.edits)
            self.protocol.dark = {
                str(at): [asdict(one) | {"column_mean_dn": one.column_mean_dn.tolist()} for one in some]
                for at, some in bench.dark.items()
            }
            if bench.columns:
                self.protocol.columns = [
                    {"offset_dn": offset.round(4).tolist(), "gain": gain.round(6).tolist()}
                    for offset, gain in bench.columns
                ]
            self._record(step, "good" if result.good else "poor", result=result, seconds=seconds)
            return

    def _report(self, result: StepResult) -> None:
        for line in result.remarks:
            self.prompts.say(line, "good" if result.good else "poor")
        for line in result.unmeasured:
            self.prompts.say(f"not measured: {line}", "faint")
        for edit in result.edits:
            self.prompts.say(f"{edit.name} = {edit.value}", "plain")

    def _ask(self, key: str, question: str, usual: str) -> str:
        self.protocol.asking = key
        self._save()
        begun_s = self.clock()
        answer = self.prompts.answer(key, question, usual).strip() or usual
        self.protocol.questions.append(
            {"key": key, "question": question, "answer": answer, "seconds": round(self.clock() - begun_s, 3)}
        )
        if answer == "q":
            self._save()
            raise Stopped
        return answer

    def _record(
        self,
        step: Step,
        state: State,
        *,
        remarks: Sequence[str] = (),
        result: StepResult | None = None,
        seconds: float = 0.0,
    ) -> None:
        self.protocol.steps[step.key] = {
            "title": step.title,
            "state": state,
            "says": list(remarks if result is None else result.remarks),
            "values": {} if result is None else {name: asdict(one) for name, one in result.values.items()},
            "written": {} if result is None else {edit.name: edit.value for edit in result.edits},
            "unmeasured": [] if result is None else list(result.unmeasured),
            "seconds": round(seconds, 3),
        }
        self._save()

    def _save(self) -> None:
        self.protocol.keep(protocol_path(self.path))


def answers_of(given: Mapping[str, Any], keys: Sequence[str], *, where: object) -> Callable[[str], str]:
    """Return the answers of a file: by key one text, or a list of them for a question that comes again; else Enter.

    RequestError: a key is no question's, or its value is no text.
    """
    left: dict[str, list[str]] = {}
    for key, value in given.items():
        several = value if isinstance(value, list) else [value]
        if key not in keys:
            raise RequestError(where, f"{key!r} is not a question", remedy=f"use {', '.join(keys)}")
        if not all(isinstance(one, str | int | float) and not isinstance(one, bool) for one in several):
            raise RequestError(
                where, f"{key} has a value that is not an answer", remedy='write e.g. focus = "s"'
            )
        left[key] = [str(one) for one in several]

    def answer(key: str) -> str:
        some = left.get(key, [])
        return (some.pop(0) if len(some) > 1 else some[0]) if some else ""

    return answer

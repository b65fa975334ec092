"""The step that is being done, one at a time: begun, followed, cancelled; its result becomes a version, not in use."""

from __future__ import annotations

import secrets
import threading
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, Literal

from prooflight_console.child_process import END_S, begin_process, end_process, messages_until_end
from prooflight_console.engineering.steps import StepProgress, StepRefused, StepResult, step_aside
from prooflight_console.engineering.versions import Version
from prooflight_console.problems import Problem, not_found

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from multiprocessing.connection import Connection
    from multiprocessing.process import BaseProcess

    from prooflight_console.accounts.account_store import Accounts
    from prooflight_console.engineering.steps import Step, StepRequest
    from prooflight_console.engineering.versions import PressVersions

State = Literal["running", "done", "failed", "cancelled"]
PROCESS_ENDED: Final = "the process ended before it was done, perhaps because memory ran out; start again"


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """State of one step."""

    id: str
    step: Step
    by: str
    began_s: float
    """Unix time. [s]"""
    state: State = "running"
    progress: StepProgress
    left_s: float | None = None
    """Time that is left, by what was done so far; None: not known. [s]"""
    why: str = ""
    digest: str = ""
    """Digest of the version that was made; empty: none was."""
    facts: Mapping[str, Any] = field(default_factory=dict)


class Work:
    """The steps of one console; the last is remembered. The methods are thread-safe."""

    def __init__(
        self,
        versions: PressVersions | None,
        accounts: Accounts,
        *,
        work: Callable[[StepRequest, Connection], None] = step_aside,
    ) -> None:
        """Create the service. versions: None: the console has no press. work: importable by its name."""
        self.versions = versions
        self._accounts, self._work = accounts, work
        self._guard = threading.Condition()
        self._task: Task | None = None
        self._process: BaseProcess | None = None
        self._part_s = self._seen_s = 0.0  # when the part began, and when its progress was last reported

    @property
    def task(self) -> Task | None:
        """The step that is being done, or the last one; None: there was none."""
        with self._guard:
            return self._task

    def begin(self, request: StepRequest, *, by: str) -> Task:
        """Begin a step; raises ``Problem`` 409 if another is being done, 503 if no process can be started."""
        with self._guard:
            if self._process is not None:
                now = self._task
                assert now is not None
                if now.state == "cancelled":
                    self._guard.wait_for(lambda: self._process is None, END_S)
                if self._process is not None:
                    raise Problem(
                        409, "busy", f"a step that {now.by} started is in progress; wait, or cancel it"
                    )
            try:
                process, receiver = begin_process(self._work, request, name="press-engineering")
            except OSError as error:
                what = f"no process can be started ({error.strerror})"
                raise Problem(503, "no-process", what) from error
            self._process = process
            self._part_s = self._seen_s = self._accounts.clock()
            self._task = task = Task(
                id=secrets.token_hex(8),
                step=request.step,
                by=by,
                began_s=self._seen_s,
                progress=StepProgress(what="starting"),
            )
        self._accounts.note(by, "press.begin", request.press.name, after={"step": request.step})
        threading.Thread(target=self._follow, args=(task.id, process, receiver), daemon=True).start()
        return task

    def cancel(self, task_id: str, *, by: str) -> Task:
        """Cancel the step that is being done; one that has ended stays as it is. Raises ``Problem`` 404."""
        with self._guard:
            task = self._task
            if task is None or task.id != task_id:
                raise not_found(f"there is no step {task_id[:20]!r}")
            if self._process is None or task.state != "running":
                return task
            self._process.terminate()
            self._task = task = replace(task, state="cancelled")
        self._accounts.note(by, "press.cancel", task.step)
        return task

    def close(self) -> None:
        """End the step that is being done."""
        with self._guard:
            process = self._process
        if process is not None:
            process.terminate()
            end_process(process)

    def _follow(self, task_id: str, process: BaseProcess, receiver: Connection) -> None:
        last: StepResult | StepRefused = StepRefused(why=PROCESS_ENDED)
        for message in messages_until_end(process, receiver):
            if isinstance(message, StepProgress):
                self._now(task_id, progress=message)
            else:
                last = message
        with self._guard:
            self._process = None
            self._guard.notify_all()
            task = self._task
        if task is None or task.id != task_id or task.state != "running":
            if isinstance(last, StepResult) and last.path is not None:
                last.path.unlink(missing_ok=True)
        elif isinstance(last, StepRefused):
            self._now(task_id, state="failed", why=last.why)
        else:
            self._keep(task, last)

    def _keep(self, task: Task, result: StepResult) -> None:
        """Store the artefact that was made as a version."""
        if result.path is not None and self.versions is not None:
            version = Version(
                digest=result.digest,
                kind=task.step,
                created_s=self._accounts.clock(),
                by=task.by,
                facts=result.facts,
            )
            try:
                self.versions.add(result.path, version)
            except OSError as error:
                why = f"the version cannot be stored ({error.strerror})"
                self._now(task.id, state="failed", why=why)
                return
            after = {"step": task.step, "digest": result.digest}
            self._accounts.note(task.by, "press.made", self.versions.press.name, after=after)
        self._now(task.id, state="done", digest=result.digest, facts=result.facts)

    def _now(self, task_id: str, **changes: Any) -> None:
        with self._guard:
            task = self._task
            if task is not None and task.id == task_id and task.state == "running":
                self._task = replace(task, **changes, left_s=self._left_s(task, changes.get("progress")))

    def _left_s(self, task: Task, progress: StepProgress | None) -> float | None:
        """Return the time left of the part that is being done, by the part of it that is done.

        A part begins with its first report, or with the last of the part before where steps are done by then.
        """
        if progress is None:
            return None
        seen_s, self._seen_s = self._seen_s, self._accounts.clock()
        if progress.what != task.progress.what:
            self._part_s = seen_s if progress.done else self._seen_s
        if not progress.done:
            return None
        spent_s = self._seen_s - self._part_s
        return spent_s * (progress.total - progress.done) / progress.done

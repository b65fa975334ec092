"""``watch --queue --on-start``: jobs are started by people at the console, each in a process of its own."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from prooflight.cli.exit_codes import EXIT_MISPRINT, NOT_ALL_INSPECTED, OVERLOADED
from prooflight.errors import RequestError
from prooflight_line.job_queue.hot_folder import HotFolder
from prooflight_line.journal.opening import default_journal, journal_path
from prooflight_line.journal.run_control import RunControl, Starter

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from prooflight_line.cli.watch.options import WatchOptions

POLL_S: Final = 0.25
"""Period at which requests are looked for. [s]"""
OF_RUNS: Final = (0, EXIT_MISPRINT, NOT_ALL_INSPECTED, OVERLOADED)
"""Exit codes of `watch` whose run took place."""
OPTION: Final = "--on-start"


def refuse_unfit(options: WatchOptions) -> None:
    """Refuse options beside which nobody could start a job. RequestError."""
    if not options.start.queue:
        raise RequestError(OPTION, "starts jobs of a hot folder", remedy="give --queue and the folder")
    if options.record.journal == "none":
        remedy = "leave out --journal none"
        raise RequestError(OPTION, "needs a journal: the console requests a start next to it", remedy=remedy)
    if options.start.resume:
        raise RequestError(OPTION, "starts new runs", remedy="leave out --resume, or resume without it")
    if options.console.serve:
        remedy = "leave out --serve, and run `prooflight serve --queue FOLDER` separately"
        raise RequestError(OPTION, "waits without a run that --serve could show", remedy=remedy)


@contextmanager
def started(folder: Path, job: str, journal: str | None) -> Iterator[None]:
    """Note for the people who started a job why it could not begin, if so."""
    with control_of(journal).trouble_noted(Starter(folder=str(folder.resolve()), job=job)):
        yield


def run_on_start(
    folder: Path, *, journal: str | None, arguments: Sequence[str], say: Callable[[str], None]
) -> None:
    """Run each job that people start, one after another, until an interrupt ends this process.

    A signal is passed on to the run, which ends as it does by itself. Each run is a process of its own, so that one
    that is killed costs no other, and that each reads the press in use.

    Parameters
    ----------
    arguments
        Command line by which this process was called.
    say
        Prints a line for people.

    Raises
    ------
    RequestError
        Another process waits for starts of this journal, or nothing can be written next to it.
    """
    control, signals, runs = control_of(journal), list[int](), list[subprocess.Popen[bytes]]()
    jobs = HotFolder.open(folder)
    waiting = Starter(folder=str(jobs.path.resolve()))

    def pass_on(number: int, _frame: object) -> None:
        signals.append(number)
        for run in runs:
            run.send_signal(number)

    before = {number: signal.signal(number, pass_on) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        with control.starting(waiting):
            jobs.put_back()  # of a run that was killed, so that it can be started again
            say("waiting until an operator starts the next job in the console")
            while not signals:
                request = control.start_request()
                if request is None:
                    time.sleep(POLL_S)
                    continue
                say(f"{request.by} started job {request.of}")
                control.write_starter(replace(waiting, job=request.of))
                # A group of its own: Ctrl-C of the terminal comes once, by this process.
                run = subprocess.Popen(_command(arguments, request.of), process_group=0)
                runs[:] = [run]
                if signals:
                    run.send_signal(signals[-1])
                code = run.wait()
                runs.clear()
                noted = control.starter
                trouble = "" if code in OF_RUNS or noted is None else noted.trouble or _ended(code)
                jobs.put_back()
                control.write_starter(replace(waiting, trouble=trouble))
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def control_of(journal: str | None) -> RunControl:
    """Return the requests of the journal of the option."""
    return RunControl(journal=journal_path(journal or str(default_journal())))


def _command(arguments: Sequence[str], job: str) -> list[str]:
    """Return the command of one run: the same, for this job alone."""
    same = [one for one in arguments[1:] if one != OPTION]
    return [sys.executable, "-m", "prooflight", arguments[0], "--started", job, *same]


def _ended(code: int) -> str:
    how = f"by signal {-code}" if code < 0 else f"with exit code {code}"
    return f"the run ended {how} before it was complete; its messages are in the output of `prooflight watch`"

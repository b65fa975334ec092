"""A long computation in a process of its own and of the lowest priority, which sends its progress and its result."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import os
import signal
from typing import TYPE_CHECKING, Any, Final, TypeVar

from prooflight.errors import ProoflightError
from prooflight.pages.process import LOWEST, settle_process

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from multiprocessing.connection import Connection
    from multiprocessing.process import BaseProcess

Request = TypeVar("Request")
Result = TypeVar("Result")
Refusal = TypeVar("Refusal")

_log = logging.getLogger(__name__)

END_S: Final = 10.0
"""Time that a process has to end before it is killed. [s]"""
FULL: Final = "there was not enough memory; close other programs on this machine, and start again"
FAULT: Final = "it failed by a fault in Prooflight; the console's log contains the details"


def begin_process(
    work: Callable[[Request, Connection], None], request: Request, *, name: str
) -> tuple[BaseProcess, Connection]:
    """Start ``work`` on a request; return its process, and what receives from it. OSError: none can be started."""
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=work, args=(request, sender), name=name, daemon=True)
    try:
        process.start()
    except OSError:
        receiver.close()
        raise
    finally:
        sender.close()  # so that reading ends when the process does
    return process, receiver


def messages_until_end(process: BaseProcess, receiver: Connection) -> Iterator[Any]:
    """Yield what a process sends, until it has ended."""
    while True:
        try:
            message = receiver.recv()
        except (EOFError, OSError):
            break
        yield message
    receiver.close()
    end_process(process)


def end_process(process: BaseProcess) -> None:
    """Wait until a process has ended, and kill it after ``END_S``."""
    process.join(END_S)
    if process.is_alive():
        process.kill()
        process.join()


def send_result(sender: Connection, result: Callable[[], object]) -> None:
    """Compute a result in the child and send it; end when nobody receives any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles the terminal's Ctrl-C
    yield_to_all()
    settle_process()
    try:
        with contextlib.suppress(BrokenPipeError):
            sender.send(result())
    finally:
        sender.close()


def result_or_refusal(
    compute: Callable[[], Result], refused: Callable[[str], Refusal], *, what: str
) -> Result | Refusal:
    """Compute a result; where that fails, return ``refused`` with the reason in a line for people.

    what: names the computation in the log. BrokenPipeError: nobody receives any more.
    """
    try:
        return compute()
    except ProoflightError as error:
        return refused(str(error))
    except BrokenPipeError:
        raise
    except MemoryError:
        return refused(FULL)
    except OSError as error:
        return refused(
            f"a file cannot be read or written ({error.strerror}: {error.filename}); correct this, and start again"
        )
    except Exception:
        _log.exception("%s", what)
        return refused(FAULT)


def yield_to_all() -> None:
    """Run only while no other process wants to, so that no verdict is delayed; a computation may take long."""
    if hasattr(os, "SCHED_IDLE"):
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    if hasattr(os, "nice"):
        os.nice(LOWEST)

"""What runs in the processes that read mutants."""

from __future__ import annotations

import contextlib
import io
import resource
import traceback
import warnings
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from prooflight.errors import ProoflightError

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    from tests.fuzz.harness import Target

COMMAND_EVERY = 20
LONGEST_MESSAGE = 2000
_PAGE_BYTES = resource.getpagesize()


@dataclass(frozen=True, kw_only=True)
class Order:
    """Which mutant to read."""

    target: Target
    samples: Path
    seed: int
    index: int


def serve(pipe: Connection, folder: Path, bytes_more: int) -> None:
    """Make and read the mutants that are ordered, until the other end closes.

    Two answers each: one when the mutant lies in ``folder``, one when it was read or refused.
    """
    # What numpy only warns of is a number that nobody asked for: no reader may let it through.
    warnings.simplefilter("error", RuntimeWarning)
    samples: dict[str, list[bytes]] = {}
    with contextlib.suppress(EOFError):
        while True:
            order = pipe.recv()
            target = order.target
            path = folder / f"mutant{target.suffix}"
            try:
                if target.name not in samples:
                    samples[target.name] = _good(order, path)
                path.write_bytes(mutant_of(order, samples[target.name]))
            except Exception:
                pipe.send(f"{target.name} cannot be tried: {traceback.format_exc()}")
                return
            pipe.send(None)
            with _no_more_memory_than(bytes_more):
                answer = _answer(order, path)
            pipe.send(answer)


def _good(order: Order, path: Path) -> list[bytes]:
    """The samples, each of which must be read; the first time also imports and compiles, which is not counted."""
    samples = [file.read_bytes() for file in sorted(order.samples.iterdir())]
    for data in samples:
        path.write_bytes(data)
        order.target.read(path)
    return samples


def mutant_of(order: Order, samples: list[bytes]) -> bytes:
    """The same for the same seed, target and number."""
    rng = np.random.default_rng([order.seed, zlib.crc32(order.target.name.encode()), order.index])
    return order.target.mutate(samples[int(rng.integers(len(samples)))], rng)


@contextlib.contextmanager
def _no_more_memory_than(bytes_more: int):
    memory = Path("/proc/self/statm")
    if not memory.exists():  # only Linux says how much is held
        yield
        return
    held = int(memory.read_text().split()[0]) * _PAGE_BYTES
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (held + bytes_more, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (hard, hard))


def _answer(order: Order, path: Path) -> tuple[str, str]:
    by_command = order.target.command is not None and order.index % COMMAND_EVERY == COMMAND_EVERY - 1
    try:
        return _by_command(order.target, path) if by_command else _by_reader(order.target, path)
    except MemoryError:
        return "memory", traceback.format_exc()[-20_000:]
    except BaseException:
        return "traceback", traceback.format_exc()[-20_000:]


def _by_reader(target: Target, path: Path) -> tuple[str, str]:
    try:
        target.read(path)
    except ProoflightError as error:
        return _refused(target, str(error), path)
    except OSError as error:
        return _refused(target, f"{str(error.filename)[-200:]!r}: {error.strerror or error}", path)
    return "accepted", ""


def _by_command(target: Target, path: Path) -> tuple[str, str]:
    from prooflight.cli import run
    from prooflight.cli.exit_codes import UNUSABLE_INPUT

    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        code = run(target.command(path))
    text = said.getvalue()
    if code == UNUSABLE_INPUT:
        return _refused(target, text.rstrip("\n"), path)
    return ("accepted", "") if code in (0, 1) else ("traceback", f"exit {code}: {text[-20_000:]}")


def _refused(target: Target, message: str, path: Path) -> tuple[str, str]:
    clear = len(message.splitlines()) == 1 and len(message) <= LONGEST_MESSAGE
    clear = clear and (path.name in message or not target.named)
    return ("clean" if clear else "unclear"), message[:20_000]

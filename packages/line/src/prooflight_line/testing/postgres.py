"""A PostgreSQL server of this machine in a folder of its own, for tests and studies: started, stopped, killed."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from prooflight.errors import RequestError

if TYPE_CHECKING:
    from collections.abc import Iterator

START_S: Final = 60.0
_DEBIAN: Final = Path("/usr/lib/postgresql")


def server_programs() -> Path | None:
    """Return the folder of PostgreSQL's programs; None: they are not installed."""
    if (found := shutil.which("initdb")) is not None:
        return Path(found).resolve().parent
    folders = sorted(_DEBIAN.glob("*/bin/initdb"), key=lambda file: int(file.parts[-3]))
    return folders[-1].parent if folders else None


class LocalPostgres:
    """A server that listens on a socket in its own folder only. RequestError: PostgreSQL is not installed."""

    def __init__(self, folder: Path, *, settings: tuple[str, ...] = ()) -> None:
        programs = server_programs()
        if programs is None:
            raise RequestError("PostgreSQL", "is not installed", remedy="install it, as Debian's postgresql")
        self._programs, self.folder, self._settings = programs, folder, settings
        self.url = f"postgresql://postgres@/postgres?host={folder}"
        # The server refuses to run as root.
        self._user: dict[str, Any] = (
            {} if os.geteuid() else {"user": "postgres", "group": "postgres", "extra_groups": ()}
        )
        folder.mkdir(parents=True, exist_ok=True)
        if self._user:
            shutil.chown(folder, "postgres", "postgres")
        self._run("initdb", "-A", "trust", "-U", "postgres", "-E", "UTF8", "--no-sync")

    def start(self) -> None:
        """Start the server, and wait until it answers."""
        options = f"-k {self.folder} -c listen_addresses= " + " ".join(f"-c {one}" for one in self._settings)
        log = self.folder / "server.log"
        self._run("pg_ctl", "-w", "-t", f"{START_S:.0f}", "-l", str(log), "-o", options, "start")

    def stop(self) -> None:
        """Stop the server as an administrator does, without waiting for its clients."""
        self._run("pg_ctl", "-w", "-m", "fast", "stop")

    def kill(self) -> None:
        """Kill the server with all its processes, as a machine that loses its power."""
        leader = int((self._data / "postmaster.pid").read_text().splitlines()[0])
        children = Path(f"/proc/{leader}/task/{leader}/children").read_text().split()
        for number in (leader, *map(int, children)):
            os.kill(number, signal.SIGKILL)
        # Where no process reaps a dead leader, its locks seem to be of one that lives.
        for lock in (self._data / "postmaster.pid", *self.folder.glob(".s.PGSQL.*")):
            lock.unlink()

    @property
    def _data(self) -> Path:
        return self.folder / "data"

    def _run(self, program: str, *arguments: str) -> None:
        command = [str(self._programs / program), "-D", str(self._data), *arguments]
        done = subprocess.run(
            command,
            cwd=self.folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            **self._user,
        )
        if done.returncode:
            raise RuntimeError(f"{program}: {done.stderr.strip()}")


@contextmanager
def local_postgres(*settings: str) -> Iterator[LocalPostgres]:
    """Run a server for the block. settings: as fsync=off."""
    # A socket's path may have 107 characters: not within a long folder of a test.
    folder = Path(tempfile.mkdtemp(prefix="prooflight-pg-"))
    try:
        server = LocalPostgres(folder, settings=settings)
        server.start()
        try:
            yield server
        finally:
            if (folder / "data" / "postmaster.pid").exists():
                server.stop()
    finally:
        shutil.rmtree(folder, ignore_errors=True)

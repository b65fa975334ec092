"""The hot folder: every file ends in one stage, once, whenever the process is killed."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from prooflight.errors import RequestError
from prooflight.files.content import content_digest
from prooflight_line.job_queue.arrivals import Arrivals, being_written
from prooflight_line.job_queue.examining import Examined
from prooflight_line.job_queue.filling import Examine, fill_once
from prooflight_line.job_queue.hot_folder import OWN, REASON, STAGES, HotFolder

FILES = {"a.pdf": b"good a", "b.pdf": b"bad b", "again.pdf": b"good a", "c.tif": b"good c", REASON: b"bad r"}


class Killed(BaseException):
    """The process is no more."""


def examine(path: Path, _ticket: object = None) -> Examined:
    return Examined(pages=1, refused="" if path.read_bytes().startswith(b"good") else "is bad")


@pytest.fixture
def folder(tmp_path: Path) -> HotFolder:
    return HotFolder.open(tmp_path)


def write(folder: HotFolder) -> None:
    for age, (name, content) in enumerate(FILES.items()):
        (folder.path / name).write_bytes(content)
        os.utime(folder.path / name, ns=(0, 10**18 + age))  # the order of arrival


def fill(folder: HotFolder, examine: Examine = examine) -> list[tuple[str, str]]:
    arrivals = Arrivals(folder=folder.path, settle_s=0.0)
    ended = [one.entry for one in fill_once(folder, arrivals, examine)]
    return [(one.stage, one.file.name) for one in ended]


def contents(folder: HotFolder) -> Counter[bytes]:
    """What lies anywhere in the folder, except reasons and locks."""
    files = [
        path for path in folder.path.rglob("*")
        if path.is_file() and path.suffix != ".lock" and not (path.name in OWN and path.parent != folder.path)
    ]  # fmt: skip
    return Counter(path.read_bytes() for path in files)


def test_each_file_ends_once_with_a_reason_beside_what_is_bad(folder: HotFolder) -> None:
    write(folder)
    assert fill(folder) == [
        ("queued", "a.pdf"),
        ("rejected", "b.pdf"),
        ("rejected", "again.pdf"),
        ("queued", "c.tif"),
        ("rejected", f"_{REASON}"),
    ]
    reasons = [entry.reason for entry in folder.entries("rejected")]
    assert reasons[0] == reasons[2] == "is bad"
    first, _ = folder.entries("queued")
    assert reasons[1] == f"the same content is queued as {first.path.name}/a.pdf, and is printed once"
    assert contents(folder) == Counter(FILES.values())
    assert fill(folder) == []
    with folder.printing() as printing:
        printing.finished = True
    (folder.path / "again.pdf").write_bytes(b"good a")
    assert fill(folder) == [("rejected", "again.pdf")]
    assert "is done as" in folder.entries("rejected")[-1].reason
    (folder.path / "again.pdf").write_bytes(
        b"bad b"
    )  # sent once more after it was rejected: it is looked at again
    assert fill(folder) == [("rejected", "again.pdf")]
    assert folder.entries("rejected")[-1].reason == "is bad"


def test_files_that_share_a_part_of_their_digest_are_two_jobs(folder: HotFolder) -> None:
    (folder.path / "a.pdf").write_bytes(b"good a")
    fill(folder)
    digest = content_digest(folder.entries("queued")[0].file)
    (folder.path / "b.pdf").write_bytes(b"good b")
    assert folder.same_as(folder.path / "b.pdf", digest) is None
    (folder.path / "b.pdf").write_bytes(b"good a")
    assert folder.same_as(folder.path / "b.pdf", digest) == folder.entries("queued")[0]


CHANGES = ("rename", "mkdir", "rmdir", "write_text", "unlink")


@contextmanager
def killed_at(change: int, monkeypatch: pytest.MonkeyPatch, *, after: bool) -> Iterator[list[int]]:
    """Kill the process before or after its nth change of a file or folder: from then on it changes nothing."""
    made = [0]

    def counted(own: Callable[..., object]) -> Callable[..., object]:
        def call(*args: object, **more: object) -> object:
            made[0] += 1
            if made[0] > change or (made[0] == change and not after):
                raise Killed
            result = own(*args, **more)
            if made[0] == change:
                raise Killed
            return result

        return call

    with monkeypatch.context() as patched:
        for name in CHANGES:
            patched.setattr(Path, name, counted(getattr(Path, name)))
        yield made


@pytest.mark.parametrize("after", [False, True])
def test_a_kill_at_any_change_loses_nothing_and_doubles_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, after: bool
) -> None:
    change, made = 0, [1]
    while made[0] >= change:  # until the process has ended before it could be killed
        change += 1
        path = tmp_path / str(change)
        path.mkdir()
        folder = HotFolder.open(path)
        write(folder)
        with killed_at(change, monkeypatch, after=after) as made:
            try:
                fill(folder)
                with folder.printing() as printing:
                    printing.finished = True
            except Killed:
                pass
        assert contents(folder) == Counter(FILES.values()), change
        fill(folder)
        folder.put_back()
        assert contents(folder) == Counter(FILES.values()), change
        assert not folder.entries("checking", "printing")
        good = [entry.file.read_bytes() for entry in folder.entries("queued", "done")]
        assert sorted(good) == [b"good a", b"good c"], change
        assert len(folder.entries("rejected")) == 3
        assert all(entry.reason for entry in folder.entries("rejected"))
        numbers = [entry.number for entry in folder.entries(*STAGES)]
        assert len(set(numbers)) == len(FILES)
    assert change > 2 * len(FILES)


def test_the_queue_is_printed_in_order_and_what_did_not_end_stays_in_its_place(folder: HotFolder) -> None:
    write(folder)
    fill(folder)
    printing = folder.printing()
    assert printing.__enter__().entry.file.name == "a.pdf"
    assert printing.__exit__(KeyboardInterrupt, KeyboardInterrupt(), None) is False
    with folder.printing() as first:
        assert first.entry.file.name == "a.pdf"
        assert first.entry.stage == "printing"
        assert folder.put_back() == []  # it is being printed
        with folder.printing() as other:  # a second press takes the next
            assert other.entry.file.name == "c.tif"
            other.finished = True
            with pytest.raises(RequestError, match="no job that is queued"), folder.printing():
                pass
        first.finished = True
    assert [entry.file.name for entry in folder.entries("done")] == ["a.pdf", "c.tif"]


def test_one_process_fills_a_folder(folder: HotFolder) -> None:
    with folder.filling(), pytest.raises(RequestError, match="another process"), folder.filling():
        pass
    with folder.filling():
        pass


def test_what_cannot_be_a_hot_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match="is not a folder"):
        HotFolder.open(tmp_path / "none")
    (tmp_path / "queued").write_text("a file")
    with pytest.raises(RequestError, match="a file called queued"):
        HotFolder.open(tmp_path)


def test_a_file_is_whole_when_it_has_settled_and_nobody_writes_it(tmp_path: Path) -> None:
    now = [100.0]
    arrivals = Arrivals(folder=tmp_path, settle_s=2.0, clock=lambda: now[0])
    for name in (".hidden.pdf", "job.pdf.part", "Job.TMP"):
        (tmp_path / name).write_bytes(b"x")
    (tmp_path / "folder").mkdir()
    job = tmp_path / "job.pdf"
    with job.open("wb") as writer:
        writer.write(b"half of")
        writer.flush()
        assert arrivals.whole() == []
        now[0] += 3
        assert being_written(job)
        assert arrivals.whole() == []  # it has settled, and is open
    now[0] += 1
    assert arrivals.whole() == ["job.pdf"]
    job.write_bytes(b"half of a job")
    assert arrivals.whole() == []
    now[0] += 1.9
    job.write_bytes(b"a whole job")
    assert arrivals.whole() == []  # its size has changed: the time begins again
    now[0] += 1.9
    assert arrivals.whole() == []
    now[0] += 0.2
    assert arrivals.whole() == ["job.pdf"]
    assert arrivals.pending == []
    job.unlink()
    (tmp_path / "job.pdf.part").rename(tmp_path / "other.pdf")
    assert arrivals.whole() == []
    now[0] += 2
    assert arrivals.whole() == ["other.pdf"]


def test_a_file_that_changes_while_it_is_examined_is_examined_again(folder: HotFolder) -> None:
    job = folder.path / "job.pdf"
    job.write_bytes(b"bad: half of ")

    def written_meanwhile(path: Path, _ticket: object) -> Examined:
        first = examine(path)
        path.write_bytes(b"good: a whole job")
        return first

    assert fill(folder, written_meanwhile) == []
    assert contents(folder) == Counter([b"good: a whole job"])
    assert fill(folder) == [("queued", "job.pdf")]


def test_a_fault_of_one_file_costs_that_file_and_one_of_the_machine_none(
    folder: HotFolder, caplog: pytest.LogCaptureFixture
) -> None:
    write(folder)
    (folder.path / "link.pdf").symlink_to("/dev/zero")
    os.mkfifo(folder.path / "pipe.pdf")

    def failing(path: Path, _ticket: object) -> Examined:
        if path.name == "b.pdf":
            raise ZeroDivisionError("no pages")
        if path.name == "c.tif":
            raise OSError(28, "No space left on device")
        return examine(path)

    with pytest.raises(OSError, match="No space left"):
        fill(folder, failing)
    assert [entry.file.name for entry in folder.entries("checking")] == ["c.tif"]
    rejected = {entry.file.name: entry.reason for entry in folder.entries("rejected")}
    assert rejected["b.pdf"] == "checking it failed (ZeroDivisionError: no pages)"
    assert "b.pdf cannot be checked" in caplog.text
    assert rejected["link.pdf"] == rejected["pipe.pdf"] == "is not a regular file; send the file itself"
    assert fill(folder) == [("queued", "c.tif")]


FILLING = """
import sys, time
from pathlib import Path
from prooflight_line.job_queue.arrivals import Arrivals
from prooflight_line.job_queue.examining import Examined
from prooflight_line.job_queue.filling import fill_once
from prooflight_line.job_queue.hot_folder import HotFolder

def examine(path, ticket):
    time.sleep(0.002)
    return Examined(pages=1, refused="" if path.read_bytes().startswith(b"good") else "is bad")

folder = HotFolder.open(Path(sys.argv[1]))
with folder.filling():
    print("filling", flush=True)
    while True:
        list(fill_once(folder, Arrivals(folder=folder.path, settle_s=0.0), examine))
"""


def test_processes_that_are_killed_lose_nothing(folder: HotFolder) -> None:
    """Three processes, each killed by the system after a part of 150 files, a third of which are duplicates."""
    sent = Counter[bytes]()
    for number in range(150):
        content = f"{'good' if number % 4 else 'bad'} {number % 100}".encode()
        (folder.path / f"{number}.pdf").write_bytes(content)
        sent[content] += 1
    for part in range(3):
        process = subprocess.Popen(
            [sys.executable, "-c", FILLING, str(folder.path)], stdout=subprocess.PIPE, text=True
        )
        assert process.stdout is not None
        assert process.stdout.readline() == "filling\n"
        while len(folder.entries("queued", "rejected")) < 30 * (part + 1):
            time.sleep(0.001)
        process.kill()
        process.wait()
        process.stdout.close()
        assert contents(folder) == sent
    assert list(folder.path.glob("*.pdf"))  # they were killed on the way
    fill(folder)
    assert contents(folder) == sent
    queued = [entry.file.read_bytes() for entry in folder.entries("queued")]
    assert len(queued) == len(set(queued)) == len({one for one in sent if one.startswith(b"good")})

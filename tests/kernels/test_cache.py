"""Kernels compile where nothing can be written, and where what was kept is damaged."""

from __future__ import annotations

import gc
import itertools
import os
import subprocess
import sys
from pathlib import Path

import pytest

from prooflight.kernels.cache import few_collections

KERNEL = """
from numba import njit
from prooflight.kernels.cache import keep

@njit
def twice(x):
    return 2 * x

keep(twice, twice.py_func)
print(twice(21), twice._cache.cache_path, sum(twice.stats.cache_hits.values()))
"""


def call(folder: Path) -> subprocess.CompletedProcess[str]:
    known = {
        name: value for name, value in os.environ.items() if name not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")
    }
    return subprocess.run(
        [sys.executable, "-B", str(folder / "kernel.py")],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
        env=known | {"TMPDIR": str(folder / "tmp"), "HOME": str(folder / "home")},
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("tmp", "home"):
        (tmp_path / name).mkdir()
    (tmp_path / "kernel.py").write_text(KERNEL)
    return tmp_path


def test_a_kernel_that_was_kept_is_not_compiled_again(folder: Path) -> None:
    first, again = call(folder), call(folder)
    place = folder / "__pycache__"
    assert first.stdout.split() == ["42", str(place), "0"]
    assert again.stdout.split() == ["42", str(place), "1"]
    assert first.stderr == again.stderr == ""


KERNELS = """
from numba import njit
from prooflight.kernels.cache import keep

def kernel(factor):
    def times(x):
        return factor * x
    times.__name__ = times.__qualname__ = f"times_{factor}"
    compiled = njit(times)
    keep(compiled, times)
    return compiled

for factor in range(6):
    one = kernel(factor)
    print(one(21), sum(one.stats.cache_hits.values()))
"""
DAMAGES = {"empty": b"", "cut short": b"\x80", "other": b"no pickle"}


def test_damaged_files_are_made_anew_and_said(folder: Path) -> None:
    """Index and code of six kernels, each damaged in one way."""
    (folder / "kernel.py").write_text(KERNELS)
    call(folder)
    for factor, (kind, content) in enumerate(itertools.product(("nbi", "nbc"), DAMAGES.values())):
        (file,) = (folder / "__pycache__").glob(f"*times_{factor}-*.{kind}")
        file.write_bytes(content)
    mended, again = call(folder), call(folder)
    assert [line.split()[0] for line in mended.stdout.splitlines()] == ["0", "21", "42", "63", "84", "105"]
    assert mended.stderr.count("a compiled kernel is damaged") == 6
    assert "Traceback" not in mended.stderr
    assert ([line.split()[1] for line in again.stdout.splitlines()], again.stderr) == (["1"] * 6, "")


def test_where_nothing_can_be_written_a_temporary_folder_is_used_and_said(folder: Path) -> None:
    (folder / "__pycache__").write_text("a file, so that no folder can be made here, not even by root")
    (folder / "home" / ".cache").write_text("nor here")
    first, again = call(folder), call(folder)
    place = folder / "tmp" / f"prooflight-kernels-{os.getuid()}"
    assert f"compiled kernels are stored in {place}" in first.stderr
    assert first.stdout.split()[0] == "42"
    assert again.stdout.split()[2] == "1"  # the next run finds them
    assert place.stat().st_mode & 0o077 == 0


def test_a_folder_that_others_can_write_is_not_trusted(folder: Path) -> None:
    (folder / "__pycache__").write_text("")
    (folder / "home" / ".cache").write_text("")
    place = folder / "tmp" / f"prooflight-kernels-{os.getuid()}"
    place.mkdir()
    place.chmod(0o777)
    said = call(folder)
    assert said.stdout.split()[0] == "42"
    assert not list(place.iterdir())


TOGETHER = """
import sys
from pathlib import Path
from time import sleep
from numba import njit
from prooflight.kernels.cache import keep

@njit
def inner(x):
    return x + 1

@njit
def outer(x):
    for _ in range(3):
        x = inner(x) + len(str(x))
    return x

for one in (inner, outer):
    keep(one, one.py_func)
me, folder = sys.argv[1], Path(__file__).parent
if me == "errs":
    try:
        outer(None)
    except Exception as error:
        print(type(error).__name__, flush=True)
    sys.stdin.read()
else:
    (folder / me).touch()
    while len(list(folder.glob("starter*"))) < 2:
        sleep(0.01)
    print(outer(1), *(sum(one.stats.cache_misses.values()) for one in (inner, outer)))
"""


def started(folder: Path, me: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-B", str(folder / "kernel.py"), me],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"},
    )


def test_of_processes_that_start_together_one_compiles_a_kernel(tmp_path: Path) -> None:
    (tmp_path / "kernel.py").write_text(TOGETHER)
    both = [started(tmp_path, me) for me in ("starter 1", "starter 2")]
    said = [one.communicate(timeout=300)[0].split() for one in both]
    assert [words[0] for words in said] == ["7", "7"]
    assert sum(int(words[1]) for words in said) == 1  # inner; a process that loads outer does not ask for it
    assert sum(int(words[2]) for words in said) == 1
    assert len(list((tmp_path / "__pycache__").glob("*.nbc"))) == 2


def test_who_fails_to_compile_lets_others(tmp_path: Path) -> None:
    (tmp_path / "kernel.py").write_text(TOGETHER)
    with started(tmp_path, "errs") as errs:
        assert errs.stdout is not None
        assert errs.stdout.readline() == "TypingError\n"
        (tmp_path / "starter 0").touch()
        with started(tmp_path, "starter 1") as other:
            said = other.communicate(timeout=60)[0]  # less than the patience of who waits
        assert errs.poll() is None
        errs.communicate("")
    assert said.split()[0] == "7"


def test_a_threshold_of_collections_that_changes_while_a_kernel_compiles_stays() -> None:
    """A command's first collection, which was put off, may come then."""
    usual = gc.get_threshold()
    try:
        with few_collections(), few_collections():
            assert gc.get_threshold()[0] > usual[0]
        assert gc.get_threshold() == usual
        gc.set_threshold(300_000, 10, 10)
        with few_collections():
            gc.set_threshold(700, 10, 10)
        assert gc.get_threshold() == (700, 10, 10)
    finally:
        gc.set_threshold(*usual)

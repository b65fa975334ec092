"""A kernel's machine code depends on its source alone: not on what a process compiled or loaded before."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from prooflight.kernels.cache import source_digest
from prooflight.kernels.compiled import inner_kernel, kernel

MANY = """
import numpy as np
from prooflight.kernels.compiled import inner_kernel, kernel

@inner_kernel()
def many(x):  # too much to be inlined
    LINES
    return x

@kernel("x")
def twice(x):
    return many(x) + many(x + 1)

print(twice(0.5).hex())
"""
RUN = """
import runpy, sys

for script in sys.argv[1:]:
    runpy.run_path(script, run_name="of_one_name")
"""

INNER = """
from prooflight.kernels.compiled import inner_kernel

@inner_kernel()
def inner(x):
    return x + STEP

STEP = 1
"""
OUTER = """
from inner import inner
from prooflight.kernels.compiled import kernel

@kernel("x")
def outer(x):
    return 10 * inner(x)

print(outer(1), sum(outer.compiled.stats.cache_hits.values()))
"""


def printed(script: Path, *arguments: str) -> list[str]:
    """Words that a script prints in a process of its own, which stores kernels beside the script."""
    done = subprocess.run(
        [sys.executable, "-B", script, *arguments],
        env={name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"},
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
    return done.stdout.split()


@pytest.mark.slow
def test_a_kernel_calls_its_own_copies_of_functions(tmp_path: Path) -> None:
    """Functions from two processes have the same name; a third process loads both, and calls each from its kernel."""
    run = tmp_path / "run.py"
    run.write_text(RUN)
    scripts = []
    for factor in (2, 3):
        script = tmp_path / f"times_{factor}.py"
        script.write_text(MANY.replace("LINES", f"x = np.sin(x) * {factor} + np.cos(x)\n    " * 60))
        scripts.append(str(script))
    two, three = (printed(run, script) for script in scripts)
    assert two != three
    assert printed(run, *scripts) == two + three
    assert printed(run, *reversed(scripts)) == three + two


@pytest.mark.slow
def test_a_change_in_a_file_of_what_a_kernel_calls_compiles_it_again(tmp_path: Path) -> None:
    inner, script = tmp_path / "inner.py", tmp_path / "outer.py"
    inner.write_text(INNER)
    script.write_text(OUTER)
    assert printed(script) == ["20", "0"]
    assert printed(script) == ["20", "1"]
    inner.write_text(INNER.replace("x + STEP", "x + 2 * STEP"))
    assert printed(script) == ["30", "0"]


@pytest.mark.slow
def test_a_new_kernel_calls_one_that_is_stored(tmp_path: Path) -> None:
    """The bitcode of the stored one is needed only now; it runs by itself too, as machine code that was loaded."""
    stored, script = tmp_path / "inner.py", tmp_path / "outer.py"
    stored.write_text(INNER.replace("inner_kernel()", 'kernel("x")').replace("inner_kernel", "kernel"))
    script.write_text(OUTER)
    assert printed(script) == ["20", "0"]
    script.write_text(OUTER.replace("10 *", "100 *").replace("outer(1),", "inner(1), outer(1),"))
    assert printed(script) == ["2", "200", "0"]
    assert printed(script) == ["2", "200", "1"]


@inner_kernel()
def quotient(a, b):
    return a / b


@inner_kernel()
def product_and_sum(a, b, c):
    return a * b + c


@kernel("values (N)", error_model="numpy", fastmath=True)
def fast_quotient(values):
    return quotient(values[0], values[1])


@kernel("values (N)", error_model="numpy", fastmath=True)
def fast_product_and_sum(values):
    return product_and_sum(values[0], values[1], values[2])


def test_a_loop_is_compiled_with_its_own_options_and_not_with_those_of_its_caller() -> None:
    """(1 + e) (1 - e) rounds to 1, and less 1 is 0; multiplied and added at once, as fastmath allows, it is -e^2."""
    with pytest.raises(ZeroDivisionError):
        fast_quotient(np.array([1.0, 0.0]))
    e = 2.0**-30
    assert fast_product_and_sum(np.array([1 + e, 1 - e, -1.0])) == 0.0


def test_the_digest_of_sources_counts_numbers_of_other_modules(monkeypatch: pytest.MonkeyPatch) -> None:
    before = digest_now()
    assert digest_now() == before
    monkeypatch.setitem(globals(), "STEP", 2)
    assert digest_now() != before


STEP = 1


def of_step(x):
    return x + STEP


def digest_now() -> str:
    """Without what is stored of it."""
    return source_digest.__wrapped__(of_step)


@kernel("values (N), out (N)", error_model="numpy", fastmath=True)
def roots(values, out):
    total = np.float32(0)
    for i in range(out.size):
        root = np.sqrt(values[i])
        out[i] = root
        total += root
    return total


def test_results_depend_on_the_values_in_arrays_and_not_on_where_these_lie() -> None:
    """A sum rounds otherwise in another order; one array may also be read and written."""
    values = np.random.default_rng(1).uniform(1, 1000, 40).astype(np.float32)
    room = np.concatenate([values, np.zeros(200, np.float32)])
    sums = {roots(room[:40], room[place : place + 40]) for place in range(40, 200)}
    assert len(sums) == 1
    roots(room[:40], room[:40])
    np.testing.assert_allclose(room[:40], np.sqrt(values), rtol=1e-6)

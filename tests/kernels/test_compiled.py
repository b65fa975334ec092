"""Compiled loops look at shapes before they touch memory, and none that Python calls goes without."""

from __future__ import annotations

import ast
import importlib
import pickle
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numba
import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

import prooflight
from prooflight.kernels.compiled import InnerKernel, Kernel, inner_kernel, kernel
from prooflight.kernels.residuals.fit import InkImages
from prooflight.kernels.residuals.residuals import FittedAmounts, residuals, take_columns

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import ModuleType

SOURCE = Path(prooflight.__file__).parent
HALF = 2


class Pair(NamedTuple):
    first: np.ndarray
    second: np.ndarray


@inner_kernel()
def added(a, b):
    return a + b


@kernel("image (L, P), count, out (L, P // HALF)", where="0 <= count, count <= L")
def summed(image, count, out):
    for line in range(count):
        out[line, 0] = added(image[line, 0], image[line, P_LAST])


P_LAST = 3


@kernel("image (L, P), out (L, P // HALF)")
def summed_all(image, out):
    summed(image, image.shape[0], out)


@kernel("pair.first (N), pair.second (N + 1), lights[] (K, N), pairs[].first (K, N)")
def of_tuples(pair, lights, pairs):
    return pair.first.size + len(lights) + len(pairs)


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="compiling is switched off")
def test_an_inner_loop_has_no_entry_for_python() -> None:
    with pytest.raises(TypeError, match="added is called by compiled loops only"):
        added(1, 2)


def test_what_fits_is_done() -> None:
    image, out = np.arange(12.0).reshape(3, 4), np.zeros((3, 2))
    summed(image, count=2, out=out)
    np.testing.assert_array_equal(out[:, 0], [3, 11, 0])
    summed_all(image, out)  # one compiled loop calls the other
    np.testing.assert_array_equal(out[:, 0], [3, 11, 19])
    two, three = np.zeros(2), np.zeros(3)
    assert of_tuples(Pair(two, three), (two, two), (Pair(two, two), Pair(two, three))) == 6


@pytest.mark.parametrize(
    ("count", "shape", "told"),
    [
        (3, (4, 2), r"summed: out is of shape \(4, 2\) and should be \(L, P // HALF\).*L = 3, P = 4"),
        (3, (3, 4), r"out is of shape \(3, 4\)"),
        (3, (6,), r"out is of shape \(6,\)"),
        (4, (3, 2), r"summed: count <= L does not hold.*count = 4"),
        (-1, (3, 2), r"0 <= count does not hold"),
    ],
)
def test_what_does_not_fit_is_refused(count: int, shape: tuple[int, ...], told: str) -> None:
    out = np.zeros(shape)
    with pytest.raises(ValueError, match=told):
        summed(np.ones((3, 4)), count, out)
    assert not out.any()


def test_tuples_are_looked_into() -> None:
    two, three = np.zeros(2), np.zeros(3)
    for pair, lights, pairs in (
        (Pair(two, two), (two,), (Pair(two, two),)),
        (Pair(two, three), (two, three), (Pair(two, two),) * 2),
        (Pair(two, three), (two, two), (Pair(two, two),)),
        (Pair(two, three), (two,), (Pair(three, two),)),
    ):
        with pytest.raises(ValueError, match="of_tuples"):
            of_tuples(pair, lights, pairs)


class Grid(NamedTuple):
    places: np.ndarray
    pitch: int


@kernel("grid.places (K), grid.pitch, out (L, 2 * grid.pitch)", where="(K - 1) * grid.pitch >= L")
def of_record(grid, out):
    out[:] = grid.places[0] + grid.pitch
    return grid.places.size


def test_numbers_of_records_are_looked_at() -> None:
    assert of_record(Grid(np.zeros(3), 2), np.zeros((4, 4))) == 3
    with pytest.raises(ValueError, match=r"of_record: .*does not hold; grid_pitch = 2, K = 3, L = 5"):
        of_record(Grid(np.zeros(3), 2), np.zeros((5, 4)))
    with pytest.raises(ValueError, match=r"out is of shape \(4, 4\) and should be \(L, 2 \* grid.pitch\)"):
        of_record(Grid(np.zeros(3), 3), np.zeros((4, 4)))


def test_a_number_is_no_array() -> None:
    with pytest.raises(ValueError, match=r"known is of shape \(2,\) and should be a number"):
        kernel("known, out (_)")(lambda known, out: None)(np.zeros(2), np.zeros(2))


@pytest.mark.parametrize(
    "shapes",
    ["image (L, P)", "out (L), image (L, P)", "image (L, P), out (M + 1)", "image (L, P), out (L) 3"],
)
def test_a_contract_that_says_too_little_is_refused(shapes: str) -> None:
    with pytest.raises(TypeError):
        kernel(shapes)(lambda image, out: None)


def test_kernels_travel_by_name() -> None:
    assert pickle.loads(pickle.dumps(take_columns)) is take_columns


def test_residuals_of_a_longer_scan_are_refused() -> None:
    """They wrote behind their output, and the heap broke."""
    image, areas = np.zeros((20, 12), np.float32), np.zeros((4, 20, 12), np.float32)
    row, bells, weights = (
        np.zeros(12, np.float32),
        np.zeros((4, 256, 16), np.float32),
        np.zeros(16, np.float32),
    )
    amounts = [np.zeros(shape, np.float32) for shape in ((4, 3), (4,), (4, 2))]
    inks = InkImages(gain=areas, dot=areas, texture=image, cover=areas, shown=np.ones((3, 4, 2, 1), bool))
    rest = image, row, image > 0, inks, bells, FittedAmounts(weights, row, *amounts), 0, 20, image.copy()
    residuals(image, *rest)
    with pytest.raises(ValueError, match=r"expected is of shape \(20, 12\) and should be \(L, P\)"):
        residuals(np.zeros((25, 12), np.float32), *rest)


# --- every kernel of the package ---


@cache
def modules() -> tuple[tuple[Path, ModuleType], ...]:
    """Every module of the package but its entry."""
    found = []
    for path in sorted(SOURCE.rglob("*.py")):
        parts = path.relative_to(SOURCE.parent).with_suffix("").parts
        if parts[-1] != "__main__":
            found.append((path, importlib.import_module(".".join(parts).removesuffix(".__init__"))))
    return tuple(found)


def in_python(tree: ast.Module) -> Iterator[ast.AST]:
    """All of a module but what is compiled."""
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.FunctionDef) and any(
            word in ast.unparse(one) for one in node.decorator_list for word in ("kernel", "intrinsic")
        ):
            continue
        yield node
        waiting += ast.iter_child_nodes(node)


def imported(tree: ast.Module) -> dict[str, Any]:
    """What a module imports from others of the package, also within functions."""
    return {
        alias.asname or alias.name: getattr(importlib.import_module(node.module), alias.name, None)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("prooflight")
        for alias in node.names
    }


def test_python_calls_no_kernel_that_does_not_say_what_shapes_it_takes() -> None:
    entered = set()
    for path, module in modules():
        if "gpu" in path.parts:  # its bodies are compiled whole, for a card and for the processor
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        names = vars(module) | imported(tree)
        for node in in_python(tree):
            if isinstance(node, ast.Name):
                found = names.get(node.id)
            elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                found = getattr(names.get(node.value.id), node.attr, None)
            else:
                continue
            if isinstance(found, Kernel):
                entered.add(found.py_func)
            has_none = isinstance(found, Dispatcher | InnerKernel) and not isinstance(found, Kernel)
            assert not has_none, f"{path}: {ast.unparse(node)} has no contract"
    assert len(entered) > 60


def test_one_place_alone_compiles() -> None:
    """Bodies that also run on a graphics card are compiled for both in a place of their own."""
    for path, _ in modules():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        names = {
            alias.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for alias in node.names
        }
        assert path.name in ("compiled.py", "body.py") or not names & {
            "njit",
            "jit",
            "vectorize",
            "guvectorize",
        }, path

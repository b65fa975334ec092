"""Spoilt press artefacts, digested anew: whoever made them had the right tools and the wrong numbers."""

from __future__ import annotations

import copy
import json
from typing import TYPE_CHECKING, Any

import numpy as np
from safetensors.numpy import load, save

from prooflight.press import artefact as press

if TYPE_CHECKING:
    from collections.abc import Callable

    Arrays = dict[str, np.ndarray[Any, Any]]
    Rng = np.random.Generator

NUMBERS = (
    float("nan"),
    float("inf"),
    float("-inf"),
    -1,
    0,
    1,
    0.5,
    -1e-9,
    1e-30,
    1e9,
    1e308,
    2**31,
    2**63,
    10**400,
)
OTHERS = (None, True, "", "nan", "\x1b[31m", "a" * 3000, "\ud800", [], [1], {}, {"a": 1})
EXTREMES = (np.nan, np.inf, -np.inf, 0, -1, 1, 1e-30, -1e30, 1e38)


def mutants(source: bytes, rng: Rng) -> bytes:
    """A press artefact with something wrong in its document, its arrays or its bytes."""
    texts, arrays = taken_apart(source)
    way = int(rng.integers(8))
    if way == 0:
        return bytes_spoilt(source, rng)
    if way < 4:
        document = json.loads(texts["document"])
        document_spoilt(document, rng)
        texts["document"] = json.dumps(document, sort_keys=True)
    else:
        arrays_spoilt(arrays, rng)
    return press_of(texts, arrays)


def press_of(texts: dict[str, str], arrays: Arrays) -> bytes:
    """A press artefact with a right digest, whatever it holds."""
    return _saved(arrays, texts | {"digest": press._digest(arrays, texts["document"])})


def taken_apart(source: bytes) -> tuple[dict[str, str], Arrays]:
    """Texts and arrays of a file."""
    header = int.from_bytes(source[:8], "little")
    texts = json.loads(source[8 : 8 + header])["__metadata__"]
    return dict(texts), load(source)


def document_spoilt(document: Any, rng: Rng) -> None:
    """One or two values of a document are others, gone, or have neighbours that nobody knows; in place."""
    for _ in range(int(rng.integers(1, 3))):
        holder, key = _place(document, rng)
        way = int(rng.integers(6))
        value = copy.deepcopy((*NUMBERS, *OTHERS)[int(rng.integers(len(NUMBERS) + len(OTHERS)))])
        if way == 0:
            del holder[key]
        elif way == 1 and isinstance(holder, dict):
            holder["another"] = value
        elif way == 2 and isinstance(holder, list):
            holder.append(copy.deepcopy(holder[key]))
        elif way == 3 and isinstance(holder[key], int | float):
            holder[key] = holder[key] * 10.0 ** int(rng.integers(-6, 7))
        else:
            holder[key] = value


def arrays_spoilt(arrays: Arrays, rng: Rng) -> None:
    """One or two arrays hold what they must not, are of another shape or kind, gone, or more; in place."""
    for _ in range(int(rng.integers(1, 3))):
        name = sorted(arrays)[int(rng.integers(len(arrays)))]
        SPOILERS[int(rng.integers(len(SPOILERS)))](arrays, name, rng)


def bytes_spoilt(source: bytes, rng: Rng) -> bytes:
    """Bits turned, a piece lost, or another length of header."""
    way, at = int(rng.integers(4)), int(rng.integers(len(source)))
    if way == 0:
        return source[:at]
    if way == 1:
        return int(rng.integers(0, 2**63)).to_bytes(8, "little") + source[8:]
    if way == 2:
        return source[:at] + source[at + int(rng.integers(1, 100)) :]
    spoilt = bytearray(source)
    header = min(8 + int.from_bytes(source[:8], "little"), len(source))
    reach = header if rng.random() < 0.7 else len(source)
    for _ in range(int(rng.integers(1, 5))):
        spoilt[int(rng.integers(reach))] ^= 1 << int(rng.integers(8))
    return bytes(spoilt)


def _place(document: Any, rng: Rng) -> tuple[Any, Any]:
    """A value somewhere in a document, all depths alike: what holds it, and its name or number there."""
    places: list[list[tuple[Any, Any]]] = []

    def go(holder: Any, depth: int) -> None:
        keys = list(holder) if isinstance(holder, dict) else range(len(holder))
        for key in keys:
            if len(places) <= depth:
                places.append([])
            places[depth].append((holder, key))
            if isinstance(holder[key], dict | list):
                go(holder[key], depth + 1)

    go(document, 0)
    found = [level for level in places if level]
    if not found:
        document["another"] = 1
        return document, "another"
    level = found[int(rng.integers(len(found)))]
    return level[int(rng.integers(len(level)))]


def _one_value(arrays: Arrays, name: str, rng: Rng) -> None:
    if not arrays[name].size:
        return
    array = arrays[name] = arrays[name].copy()
    if array.dtype.kind == "f":
        value: Any = EXTREMES[int(rng.integers(len(EXTREMES)))]
    elif array.dtype.kind == "b":
        value = not array.reshape(-1)[0]
    else:
        ends = np.iinfo(array.dtype)
        value = (ends.min, ends.max, 0, int(array.max()))[int(rng.integers(4))]
    with np.errstate(over="ignore"):
        array.reshape(-1)[int(rng.integers(array.size))] = value


def _all_values(arrays: Arrays, name: str, rng: Rng) -> None:
    array = arrays[name]
    factor = np.float64((0, -1, 1e-6, 1e6)[int(rng.integers(4))])
    with np.errstate(over="ignore", invalid="ignore"):
        arrays[name] = (array * factor).astype(array.dtype)


def _order(arrays: Arrays, name: str, rng: Rng) -> None:
    array = arrays[name]
    arrays[name] = array[::-1].copy() if rng.random() < 0.5 else array.T.copy()


def _shape(arrays: Arrays, name: str, rng: Rng) -> None:
    array = arrays[name]
    ways: tuple[Callable[[], Any], ...] = (
        lambda: array.reshape(-1),
        lambda: array[:-1],
        lambda: array[:0],
        lambda: array[None],
        lambda: np.concatenate([array, array]),
        lambda: array[..., :1],
    )
    arrays[name] = np.ascontiguousarray(ways[int(rng.integers(len(ways)))]())


def _kind(arrays: Arrays, name: str, rng: Rng) -> None:
    kinds = (np.float64, np.float32, np.float16, np.int32, np.int64, np.uint8, np.bool_)
    with np.errstate(all="ignore"):
        arrays[name] = arrays[name].astype(kinds[int(rng.integers(len(kinds)))])


def _gone(arrays: Arrays, name: str, rng: Rng) -> None:
    array = arrays.pop(name)
    if rng.random() < 0.5 or not arrays:
        arrays[name + "x"] = array


SPOILERS = (_one_value, _one_value, _one_value, _all_values, _order, _shape, _kind, _gone)


def _saved(arrays: Arrays, texts: dict[str, str]) -> bytes:
    contiguous = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    return save(contiguous, told_in_utf8(texts))


def told_in_utf8(texts: dict[str, str]) -> dict[str, str]:
    """Without lone surrogates, which no such file can hold."""
    return {
        name.encode("utf-8", "replace").decode(): text.encode("utf-8", "replace").decode()
        for name, text in texts.items()
    }

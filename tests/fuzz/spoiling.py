"""Ways to spoil bytes and text, for all targets; each takes what it spoils and random numbers."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy as np

    BytesSpoiler = Callable[[bytes, np.random.Generator], bytes]
    TextSpoiler = Callable[[str, np.random.Generator], str]

EXTREMES = (
    *("nan", "inf", "-inf", "NaN", "Infinity", "-Infinity", "1e400", "-1e400", "1e308", "1e-308", "5e-324"),
    *(
        "0",
        "-0.0",
        "-1",
        "1",
        "0.5",
        "1e9",
        "-1e9",
        "1e18",
        "255",
        "65536",
        "2147483648",
        "9223372036854775808",
    ),
    *(
        "0x" + "f" * 5000,
        "9" * 5000,
        "-" + "9" * 400,
        "1_000",
        "1,5",
        "0,25",
        "1.5.5",
        "٣",
        "½",
        "1e",
        "+",
        "--1",
    ),
    *(
        "",
        " ",
        '"',
        '""',
        "'",
        "true",
        "null",
        "[]",
        "{}",
        "[",
        "{",
        "#",
        "\x00",
        "\ufeff",
        "\x1b[31m",
        "a" * 3000,
    ),
    *(
        "[red]",
        "../x",
        "/dev/zero",
        "\ud800".encode("utf-8", "replace").decode(),
        "é",
        "\u2028",
        "\x85",
        "%s",
        "$(x)",
    ),
)
"""Cells and values as people, programs and attackers leave them."""
DEEP = ("[", "{", "(", '"', "'", "a.", "[[", ".a", "{a=", '{"a":', "\\", "\t", "#", "-", "9", "a")
_NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
_WORD = re.compile(r"[^\s,;=]+")


def pick(things: Sequence[str], rng: np.random.Generator) -> str:
    return things[int(rng.integers(len(things)))]


def _span(size: int, rng: np.random.Generator) -> tuple[int, int]:
    """A piece, mostly a short one."""
    start = int(rng.integers(size + 1))
    length = int(min(rng.exponential(1 + size / 20), size - start))
    return start, start + length


def flip(data: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 9))):
        if changed:
            changed[int(rng.integers(len(changed)))] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def overwrite(data: bytes, rng: np.random.Generator) -> bytes:
    start, end = _span(len(data), rng)
    filling = (b"\x00", b"\xff", b"\x7f", b"\x80")[int(rng.integers(4))] * (end - start)
    return data[:start] + (filling if rng.random() < 0.5 else rng.bytes(end - start)) + data[end:]


def truncate(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: int(rng.integers(len(data) + 1))]


def remove(data: bytes, rng: np.random.Generator) -> bytes:
    start, end = _span(len(data), rng)
    return data[:start] + data[end:]


def duplicate(data: bytes, rng: np.random.Generator) -> bytes:
    start, end = _span(len(data), rng)
    return data[:end] + data[start:end] * int(rng.integers(1, 20)) + data[end:]


def swap(data: bytes, rng: np.random.Generator) -> bytes:
    a, b, c, d = sorted(int(rng.integers(len(data) + 1)) for _ in range(4))
    return data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:]


BYTES: tuple[BytesSpoiler, ...] = (flip, overwrite, truncate, remove, duplicate, swap)


def spoil_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    """One to three of the above."""
    for _ in range(int(rng.integers(1, 4))):
        data = BYTES[int(rng.integers(len(BYTES)))](data, rng)
    return data


def number(text: str, rng: np.random.Generator) -> str:
    return _replaced(_NUMBER, text, pick(EXTREMES, rng), rng)


def word(text: str, rng: np.random.Generator) -> str:
    return _replaced(_WORD, text, pick(EXTREMES, rng), rng)


def scaled(text: str, rng: np.random.Generator) -> str:
    """A number by a power of ten, to thirty up or down."""
    found = list(_NUMBER.finditer(text))
    if not found:
        return text
    at = found[int(rng.integers(len(found)))]
    value = f"{at[0]}e{int(rng.integers(-30, 31))}" if "e" not in at[0].lower() else f"-{at[0]}"
    return text[: at.start()] + value + text[at.end() :]


def _replaced(pattern: re.Pattern[str], text: str, by: str, rng: np.random.Generator) -> str:
    found = list(pattern.finditer(text))
    if not found:
        return text + by
    at = found[int(rng.integers(len(found)))]
    return text[: at.start()] + by + text[at.end() :]


def insert(text: str, rng: np.random.Generator) -> str:
    at = int(rng.integers(len(text) + 1))
    return text[:at] + pick(EXTREMES, rng) + text[at:]


def nest(text: str, rng: np.random.Generator) -> str:
    """A long run of something that opens or joins."""
    at = int(rng.integers(len(text) + 1))
    count = int(10 ** rng.uniform(1, 5))
    return text[:at] + pick(DEEP, rng) * count + text[at:]


def nest_value(text: str, rng: np.random.Generator) -> str:
    """A number as deep as that, properly closed."""
    count = int(10 ** rng.uniform(0.5, 4))
    opening, closing = (("[", "]"), ("{a=", "}"), ('{"a":', "}"), ('"', '"'))[int(rng.integers(4))]
    return _replaced(_NUMBER, text, opening * count + "1" + closing * count, rng)


def lines(text: str, rng: np.random.Generator) -> str:
    """Lines dropped, doubled, moved or shuffled."""
    rows = text.splitlines(keepends=True)
    if not rows:
        return text
    at = int(rng.integers(len(rows)))
    match int(rng.integers(5)):
        case 0:
            del rows[at]
        case 1:
            rows[at:at] = [rows[at]] * int(10 ** rng.uniform(0, 3))
        case 2:
            rows.insert(int(rng.integers(len(rows))), rows.pop(at))
        case 3:
            rng.shuffle(rows)
        case _:
            rows[at] = rows[at].rstrip("\n")
    return "".join(rows)


def separators(text: str, rng: np.random.Generator) -> str:
    old, new = (pick((",", ";", "\t", " ", "=", ".", ":", '"', "\n", "[", "]"), rng) for _ in range(2))
    return text.replace(old, new, int(rng.integers(1, 50)))


TEXT: tuple[TextSpoiler, ...] = (
    *(number, number, number, word, scaled, scaled),
    *(insert, nest, nest_value, lines, lines, separators),
)
ENCODINGS = ("utf-16", "utf-16-le", "utf-8-sig", "latin-1", "cp1252", "utf-32", "utf-7")
LINE_ENDS = ("\r\n", "\r", "\n\r", "\x0b", "\x0c", "\x1e", "\x85", "\u2028")


def spoil_text(data: bytes, rng: np.random.Generator) -> bytes:
    """As text in most cases, as bytes in some; at times in another encoding or with other line ends."""
    if rng.random() < 0.2:
        return spoil_bytes(data, rng)
    text = data.decode("utf-8", errors="replace")
    for _ in range(int(rng.integers(1, 4))):
        text = TEXT[int(rng.integers(len(TEXT)))](text, rng)
    if rng.random() < 0.05:
        text = text.replace("\n", pick(LINE_ENDS, rng))
    encoding = pick(ENCODINGS, rng) if rng.random() < 0.05 else "utf-8"
    return text.encode(encoding, errors="replace")

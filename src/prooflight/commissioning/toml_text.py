"""Values as TOML, the inverse of ``tomllib``."""

from __future__ import annotations

import json
import math
import re
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def toml_value(value: Any) -> str:
    """Return one value on one line; TypeError for one that a press file cannot hold (dates).

    >>> toml_value({"wave_nm": [380, 730.0], "file": "a.csv"})
    '{ wave_nm = [380, 730.0], file = "a.csv" }'
    """
    match value:
        case bool():
            return "true" if value else "false"
        case int():
            return str(value)
        case float():
            return repr(value) if math.isfinite(value) else f"{value}"
        case str():
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case list() | tuple():
            return "[" + ", ".join(toml_value(item) for item in value) + "]"
        case dict():
            return (
                "{ "
                + ", ".join(f"{toml_key(key)} = {toml_value(item)}" for key, item in value.items())
                + " }"
            )
        case _:
            message = f"{type(value).__name__} has no place in a press file"
            raise TypeError(message)


def toml_key(key: str) -> str:
    """Return a key, quoted where it must be."""
    return key if _BARE_KEY.fullmatch(key) else toml_value(key)


def toml_text(tree: Mapping[str, Any]) -> str:
    """Write single values, ``[blocks]`` and ``[[lists of blocks]]`` as text.

    ``tomllib.loads`` gives ``tree`` back.
    """
    single = [f"{toml_key(key)} = {toml_value(value)}" for key, value in tree.items() if not _is_block(value)]
    parts = ["\n".join(single)] if single else []
    for key, value in tree.items():
        if isinstance(value, dict):
            parts.append(_block(f"[{toml_key(key)}]", value))
        elif _is_block(value):
            parts.extend(_block(f"[[{toml_key(key)}]]", block) for block in value)
    return "\n\n".join(parts) + "\n"


def _block(head: str, fields: Mapping[str, Any]) -> str:
    return "\n".join([head, *(f"{toml_key(key)} = {toml_value(value)}" for key, value in fields.items())])


def _is_block(value: Any) -> bool:
    return isinstance(value, dict) or (
        isinstance(value, list) and bool(value) and all(isinstance(item, dict) for item in value)
    )

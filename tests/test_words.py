"""Names in the code use the words of the field, as docs/reference/words.md asks."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
WORDS = (ROOT / "docs" / "reference" / "words.md").read_text(encoding="utf-8")
PART = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+")


def table(title: str) -> list[list[str]]:
    """Rows of the first table below a heading."""
    lines = WORDS.partition(f"\n## {title}\n")[2].partition("\n## ")[0].splitlines()
    return [
        [cell.strip(" `") for cell in line.strip("| ").split("|")] for line in lines if line.startswith("| `")
    ]


AVOIDED = {word.strip(" `"): row[1] for row in table("Words that names avoid") for word in row[0].split(",")}
STAY = {(name.strip(" `"), row[1]) for row in table("Names that stay") for name in row[0].split(",")}


def defined(tree: ast.Module, path: Path) -> Iterator[str]:
    """Names of the module, its classes, functions, parameters and variables."""
    yield path.stem if path.stem != "__init__" else path.parent.name
    for node in ast.walk(tree):
        match node:
            case ast.ClassDef(name=name):
                yield name
            case ast.FunctionDef(name=name, args=given) | ast.AsyncFunctionDef(name=name, args=given):
                yield name
                yield from (one.arg for one in (*given.posonlyargs, *given.args, *given.kwonlyargs))
            case ast.AnnAssign(target=ast.Name(id=name)):
                yield name
            case ast.Assign(targets=targets):
                yield from (one.id for one in targets if isinstance(one, ast.Name))


def private(name: str) -> set[str]:
    """Parts of a name that the table avoids."""
    return {part.lower() for part in PART.findall(name)} & AVOIDED.keys()


PACKAGES = (
    "src/prooflight",
    "packages/line/src/prooflight_line",
    "packages/console/src/prooflight_console",
    "studies/prooflight_studies",
)


@pytest.mark.parametrize("package", PACKAGES)
def test_names_avoid_private_words(package: str) -> None:
    found = []
    for path in sorted((ROOT / package).rglob("*.py")):
        inside = path.relative_to((ROOT / package).parent).as_posix()
        for name in defined(ast.parse(path.read_text(encoding="utf-8")), path):
            if (words := private(name)) and not any(
                name == stays and inside.startswith(where) for stays, where in STAY
            ):
                found.append(f"{inside}: {name}: say {', '.join(AVOIDED[word] for word in sorted(words))}")
    assert not found, "\n".join(found)


def test_a_private_word_would_be_seen() -> None:
    assert private("GateTold") == {"told"}
    assert private("kept_bytes") == {"kept"}
    assert private("lookup_table") == set()
    assert AVOIDED["told"]
    assert ("book", "prooflight/simulation/corpus/") in STAY

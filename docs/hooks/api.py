"""The API reference: one page a room, in the order in which the rooms lie one above the other."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

sys.path.insert(0, str(Path(__file__).parent))
from root_pages import expanded

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / "src" / "prooflight"
INDEX = "reference/api/index.md"


def on_config(config: MkDocsConfig) -> None:
    """List the rooms in the navigation."""
    config.nav = expanded(config.nav, INDEX, [INDEX, *({room: page_of(room)} for room in rooms())])


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """A page for every room, and the list of them."""
    lines = [
        "# API\n",
        "What a program or a notebook needs is in `import prooflight as pf`; each name is loaded when it is touched.\n",
        "| name | is |\n|---|---|",
        *(
            f'| <autoref identifier="prooflight.{home}.{name}" optional>`{name}`</autoref> | {text} |'
            for name, home, text in public_names()
        ),
        "\n## The rooms\n",
        "From the bottom to the top: a room imports only rooms that stand above it in this table.\n",
        "| room | holds |\n|---|---|",
        *(f"| [`{room}`]({room}.md) | {first_line(SOURCE / room)} |" for room in rooms()),
    ]
    files.append(File.generated(config, INDEX, content="\n".join(lines)))
    for room in rooms():
        files.append(File.generated(config, page_of(room), content=room_page(room)))
    return files


def public_names() -> list[tuple[str, str, str]]:
    """Each name of ``import prooflight``, the module it comes from, and what the package's docstring says it is."""
    tree = ast.parse((SOURCE / "__init__.py").read_text(encoding="utf-8"))
    rows = re.findall(r"^(\w+) {2,}(\S.*)$", ast.get_docstring(tree) or "", re.MULTILINE)
    homes = {
        alias.name: node.module.removeprefix("prooflight.")
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("prooflight.")
        for alias in node.names
    }
    return [(name, homes[name], text) for name, text in rows if name in homes]


def rooms() -> list[str]:
    """Packages and modules of Prooflight from the bottom up, as the contract of import-linter has them."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    layers = project["tool"]["importlinter"]["contracts"][0]["layers"]
    names = [name.strip() for layer in reversed(layers) for name in layer.split("|")]
    return [name for name in names if not name.startswith("_")]


def page_of(room: str) -> str:
    """Where a room's page lies."""
    return f"reference/api/{room}.md"


def room_page(room: str) -> str:
    """Every module of a room that says what it is."""
    at = SOURCE / room
    modules = sorted(at.rglob("*.py")) if at.is_dir() else [at.with_suffix(".py")]
    names = [
        ".".join(("prooflight", *path.relative_to(SOURCE).with_suffix("").parts))
        for path in modules
        if path.name != "__init__.py"
    ]
    return "\n\n".join((f"# {room}", first_line(at), *(f"::: {name}" for name in names)))


def first_line(room: Path) -> str:
    """What a room says of itself."""
    path = room / "__init__.py" if room.is_dir() else room.with_suffix(".py")
    said = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return said.split("\n\n")[0].replace("\n", " ")

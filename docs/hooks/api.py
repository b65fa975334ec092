"""The API reference: one page a room, in the order in which packages and rooms lie one above the other."""

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
SOURCES = {
    "prooflight": ROOT / "src",
    "prooflight_line": ROOT / "packages" / "line" / "src",
    "prooflight_console": ROOT / "packages" / "console" / "src",
}
"""Source folders of the packages, from the lowest to the highest."""
INDEX = "reference/api/index.md"


def on_config(config: MkDocsConfig) -> None:
    """List the rooms in the navigation."""
    pages: list[object] = [INDEX]
    for package in SOURCES:
        pages.append({package: [{room: page_of(package, room)} for room in rooms(package)]})
    config.nav = expanded(config.nav, INDEX, pages)


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """A page for every room, and the list of them."""
    lines = [
        "# API\n",
        "What a program or a notebook needs is in `import prooflight as pf`, and of a running press in\n"
        "`import prooflight_line`; each name is loaded when it is touched.\n",
    ]
    for package in SOURCES:
        lines += [f"\n## {package}\n", "| name | is |\n|---|---|"]
        for name, home, text in public_names(package):
            lines.append(
                f'| <autoref identifier="{package}.{home}.{name}" optional>`{name}`</autoref> | {text} |'
            )
        lines += [
            "\nFrom the bottom to the top: a room imports only rooms that stand above it.\n",
            "| room | holds |\n|---|---|",
        ]
        for room in rooms(package):
            page = page_of(package, room).removeprefix("reference/api/")
            lines.append(f"| [`{room}`]({page}) | {first_line(SOURCES[package] / package / room)} |")
            files.append(File.generated(config, page_of(package, room), content=room_page(package, room)))
    files.append(File.generated(config, INDEX, content="\n".join(lines)))
    return files


def public_names(package: str) -> list[tuple[str, str, str]]:
    """Each public name of a package, the module it comes from, and what the package's docstring says it is."""
    tree = ast.parse((SOURCES[package] / package / "__init__.py").read_text(encoding="utf-8"))
    rows = re.findall(r"^(\w+) {2,}(\S.*)$", ast.get_docstring(tree) or "", re.MULTILINE)
    homes = {
        alias.name: node.module.removeprefix(f"{package}.")
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(f"{package}.")
        for alias in node.names
    }
    return [(name, homes[name], text) for name, text in rows if name in homes]


def rooms(package: str) -> list[str]:
    """Rooms of a package from the bottom up, as the contracts of import-linter have them; else by name."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    for contract in project["tool"]["importlinter"]["contracts"]:
        if contract.get("containers") == [package]:
            names = [name.strip() for layer in reversed(contract["layers"]) for name in layer.split("|")]
            return [name for name in names if not name.startswith("_")]
    inside = (SOURCES[package] / package).iterdir()
    found = {path.stem for path in inside if path.suffix == ".py" or (path / "__init__.py").is_file()}
    return sorted(name for name in found if not name.startswith("_"))


def page_of(package: str, room: str) -> str:
    """Return the path of a room's page."""
    return f"reference/api/{package}/{room}.md"


def room_page(package: str, room: str) -> str:
    """Return the page of a room: each of its modules."""
    source = SOURCES[package]
    at = source / package / room
    modules = sorted(at.rglob("*.py")) if at.is_dir() else [at.with_suffix(".py")]
    names = [
        ".".join(path.relative_to(source).with_suffix("").parts)
        for path in modules
        # Scripts in a folder that is no package, as migrations, are no modules.
        if path.name != "__init__.py" and (path.parent / "__init__.py").is_file()
    ]
    return "\n\n".join((f"# {room}", first_line(at), *(f"::: {name}" for name in names)))


def first_line(room: Path) -> str:
    """Return the first paragraph of a room's docstring."""
    path = room / "__init__.py" if room.is_dir() else room.with_suffix(".py")
    docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return docstring.split("\n\n")[0].replace("\n", " ")

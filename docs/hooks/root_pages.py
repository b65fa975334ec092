"""Pages that stand at the repository's root and decisions, in the site."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[2]
PAGES = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "packages/line/README.md": "line.md",
    "packages/console/README.md": "console.md",
}
DECISIONS = "explanation/decisions/"


def on_config(config: MkDocsConfig) -> None:
    """List the decisions in the navigation."""
    config.nav = expanded(config.nav, DECISIONS, decisions())


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """The packages' READMEs, CONTRIBUTING and CHANGELOG as pages of the site."""
    for source, page in PAGES.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, page, content=as_page(text)))
    return files


def as_page(text: str) -> str:
    """A text of the root with links that hold in the site."""

    def here(link: re.Match[str]) -> str:
        target = re.sub(r"^(\.\./)+", "", link[1]).removeprefix("docs/")
        return f"]({PAGES.get(target, target)}{link[2] or ''})"

    return re.sub(r"\]\((?!https?:)([^)#]+)(#[^)]*)?\)", here, text)


def decisions() -> list[str]:
    """All pages of decisions, the list of them first."""
    folder = ROOT / "docs" / DECISIONS
    pages = sorted(folder.rglob("0*.md"), key=lambda path: path.name)
    return [DECISIONS + "README.md", *(DECISIONS + path.relative_to(folder).as_posix() for path in pages)]


def expanded(entry: Any, placeholder: str, pages: list[Any]) -> Any:
    """The navigation with ``pages`` where it names ``placeholder``."""
    if isinstance(entry, list):
        return [expanded(part, placeholder, pages) for part in entry]
    if isinstance(entry, dict):
        return {name: expanded(part, placeholder, pages) for name, part in entry.items()}
    return pages if entry == placeholder else entry

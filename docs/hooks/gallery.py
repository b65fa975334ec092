"""The gallery: every file of examples/ is run, and its page shows what it says, prints and draws.

An example begins with a docstring in Markdown, a title first, and is run as ``python examples/NAME.py FOLDER``.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files

sys.path.insert(0, str(Path(__file__).parent))
from root_pages import expanded

ROOT = Path(__file__).resolve().parents[2]
INDEX = "gallery/index.md"
FIRST = (
    "predict_a_page",
    "table_1_small",
    "second_sensor",
    "teach_a_press",
    "golden_copy",
    "write_a_detector",
)
LONGEST_S = 300.0


@dataclass(frozen=True, kw_only=True)
class Example:
    """One file of examples/, as it stands and as it went."""

    name: str
    title: str
    text: str
    """What it shows, in Markdown, below its title."""
    code: str
    printed: str
    pictures: dict[str, bytes]
    """By file name."""

    @property
    def page(self) -> str:
        """Where its page lies."""
        return f"gallery/{self.name}.md"


def on_config(config: MkDocsConfig) -> None:
    """List the examples in the navigation."""
    pages = [f"gallery/{path.stem}.md" for path in paths()]
    config.nav = expanded(config.nav, INDEX, [INDEX, *pages])


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Run all examples, and write their pages."""
    examples = [run(path) for path in paths()]
    files.append(File.generated(config, INDEX, content=index(examples)))
    for example in examples:
        files.append(File.generated(config, example.page, content=markdown(example)))
        for name, content in example.pictures.items():
            files.append(File.generated(config, picture_of(example, name), content=content))
    return files


def paths() -> list[Path]:
    """The examples in the order of the gallery; those it does not know come last, by name."""
    place = {name: index for index, name in enumerate(FIRST)}
    found = (ROOT / "examples").glob("*.py")
    return sorted(found, key=lambda path: (place.get(path.stem, len(place)), path.stem))


def run(path: Path) -> Example:
    """Run one example in a folder of its own; PluginError: it failed."""
    source = path.read_text(encoding="utf-8")
    said = ast.parse(source).body[0]
    title, _, text = (ast.get_docstring(ast.parse(source)) or path.stem).partition("\n")
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, str(path), folder]
        done = subprocess.run(
            command, cwd=ROOT, capture_output=True, text=True, timeout=LONGEST_S, check=False
        )
        if done.returncode:
            raise PluginError(f"examples/{path.name} ended with {done.returncode}:\n{done.stderr}")
        pictures = {found.name: found.read_bytes() for found in sorted(Path(folder).glob("*.png"))}
    return Example(
        name=path.stem,
        title=title.lstrip("# "),
        text=text.strip(),
        code="\n".join(source.splitlines()[said.end_lineno :]).strip(),
        printed=done.stdout.replace(folder, "OUT").strip(),
        pictures=pictures,
    )


def markdown(example: Example) -> str:
    """An example's page."""
    parts = [f"# {example.title}", example.text]
    parts += [f"![{words(name)}](pictures/{example.name}-{name})" for name in example.pictures]
    if example.printed:
        parts += ["## What it prints", f"```text\n{example.printed}\n```"]
    parts += ["## The program", f"```bash\npython examples/{example.name}.py OUT\n```"]
    parts += [f'```python title="examples/{example.name}.py"\n{example.code}\n```']
    return "\n\n".join(parts)


def index(examples: list[Example]) -> str:
    """The page that shows all of them."""
    cards = []
    for example in examples:
        name = next(iter(example.pictures), None)
        picture = f"![{words(name)}](pictures/{example.name}-{name})" if name else ""
        first = re.split(r"\n\s*\n", example.text)[0].replace("\n", " ")
        link = f"[{example.title}]({example.name}.md)"
        cards.append(f'<div class="card" markdown>\n\n### {link}\n\n{picture}\n\n{first}\n\n</div>')
    return "\n\n".join(
        (
            "# Gallery",
            "Each example is a file of `examples/` that was run when these pages were built: its pictures and its "
            "printed lines are what it gave.",
            '<div class="cards" markdown>',
            *cards,
            "</div>",
        )
    )


def picture_of(example: Example, name: str) -> str:
    """Where a picture lies."""
    return f"gallery/pictures/{example.name}-{name}"


def words(name: str) -> str:
    """A file's name as one says it."""
    return Path(name).stem.replace("-", " ").replace("_", " ")

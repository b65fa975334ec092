"""The packages: what each may need, that each is whole, and what the program says where one is not installed."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Final

import pytest

ROOT: Final = Path(__file__).resolve().parents[1]
FOLDERS: Final = {
    "prooflight": ROOT,
    "prooflight_line": ROOT / "packages" / "line",
    "prooflight_console": ROOT / "packages" / "console",
    "prooflight_studies": ROOT / "studies",
}
"""Packages from the lowest to the highest."""
WHOLE: Final = (
    "docs",
    "examples",
    "frozen",
    "fuzz",
    "packaging",
    "conftest.py",
    "test_packages.py",
    "test_rng.py",
)
"""What lies in ``tests`` and tests the whole repository."""
PROJECTS: Final = {
    name: tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))
    for name, folder in FOLDERS.items()
}


def files_of_tests(package: str) -> list[Path]:
    """Python files of the tests of a package alone."""
    found = sorted((FOLDERS[package] / "tests").rglob("*.py"))
    return [
        path
        for path in found
        if package != "prooflight" or path.relative_to(ROOT / "tests").parts[0] not in WHOLE
    ]


def imported(path: Path) -> set[str]:
    """Modules that a file imports."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


@pytest.mark.parametrize("package", FOLDERS)
def test_no_test_of_a_package_needs_a_package_above_it(package: str) -> None:
    above = [name for name in FOLDERS if list(FOLDERS).index(name) > list(FOLDERS).index(package)]
    theirs = [FOLDERS[name].relative_to(ROOT).as_posix().replace("/", ".") + ".tests" for name in above]
    files = files_of_tests(package)
    assert files
    for path in files:
        for name in imported(path):
            assert name.partition(".")[0] not in above, f"{path} imports {name}"
            assert not any(name == one or name.startswith(f"{one}.") for one in theirs), (
                f"{path} imports {name}"
            )


@pytest.mark.parametrize("package", FOLDERS)
def test_each_package_is_described_and_of_one_version(package: str) -> None:
    project, version = PROJECTS[package]["project"], PROJECTS["prooflight"]["project"]["version"]
    assert project["name"] == package.replace("_", "-")
    assert (FOLDERS[package] / project["readme"]).is_file()
    assert project["version"] == version
    for needed in project["dependencies"]:
        if needed.startswith("prooflight"):
            assert needed.partition("==")[2] == version


def needed_by(package: str) -> set[str]:
    """Names of the libraries without which a package cannot be installed."""
    return {re.split(r"[^\w.-]", one)[0] for one in PROJECTS[package]["project"]["dependencies"]}


def test_prooflight_needs_no_server_no_database_and_no_library_of_plants() -> None:
    above = needed_by("prooflight_line") | needed_by("prooflight_console")
    extras = [
        one for name in ("prooflight_line", "prooflight_console")
        for some in PROJECTS[name]["project"]["optional-dependencies"].values() for one in some
    ]  # fmt: skip
    only_above = {"fastapi", "uvicorn", "argon2-cffi", "python-multipart", "sqlalchemy"}
    assert only_above <= above
    own = needed_by("prooflight")
    assert not own & (only_above | {re.split(r"[^\w.-]", one)[0] for one in extras})


@pytest.mark.parametrize("package", ["prooflight_line", "prooflight_console"])
def test_public_names_are_there_and_documented(package: str) -> None:
    module = __import__(package)
    rows = [line.split()[0] for line in module.__doc__.split("=\n")[1].splitlines() if line[:1].isalpha()]
    assert sorted([*rows, "__version__"]) == sorted(module.__all__)
    assert module.__version__ == PROJECTS[package]["project"]["version"]
    for name in rows:
        assert getattr(module, name).__doc__ or name == "Event", name
    with pytest.raises(AttributeError, match="no attribute 'Printer'"):
        _ = module.Printer


# --- the program ---

WITHOUT: Final = """
import importlib.metadata, sys
found = importlib.metadata.entry_points
def entry_points(*, group, **more):
    entries = found(group=group, **more)
    return [one for one in entries if not one.value.startswith({without!r})]
importlib.metadata.entry_points = entry_points
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {without!r}:
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Absent())
from prooflight.cli import run
sys.exit(run(sys.argv[1:]))
"""
LINE_ON: Final = ("prooflight_line", "prooflight_console", "prooflight_studies")


def called(without: tuple[str, ...], *words: str) -> subprocess.CompletedProcess[str]:
    """The program with some packages hidden."""
    command = [sys.executable, "-c", WITHOUT.format(without=without), *words]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("without", "words", "package"),
    [
        (LINE_ON, ("watch", "job.pdf", "--press", "x.press"), "prooflight-line"),
        (LINE_ON, ("run", "show", "--json"), "prooflight-line"),
        (LINE_ON, ("camera", "record", "ID", "-o", "x"), "prooflight-line"),
        (LINE_ON, ("camera", "set-up", "--help"), "prooflight-line"),
        (LINE_ON, ("job", "prepare", "job.pdf"), "prooflight-line"),
        (LINE_ON, ("press", "recalibrate", "x.press"), "prooflight-line"),
        (LINE_ON[1:], ("serve", "--demo"), "prooflight-console"),
        (LINE_ON[1:], ("audit", "verify"), "prooflight-console"),
        (LINE_ON[2:], ("study", "ink", "--chart", "x"), "prooflight-studies"),
        (LINE_ON[2:], ("bench", "--json"), "prooflight-studies"),
    ],
)
def test_a_command_of_a_package_that_is_not_installed_says_which(
    without: tuple[str, ...], words: tuple[str, ...], package: str
) -> None:
    ended = called(without, *words)
    assert ended.returncode == 2, ended.stderr
    assert ended.stdout == ""
    (line,) = ended.stderr.splitlines()
    assert line.startswith(f"prooflight: prooflight {words[0]}")
    assert f"{package} is not installed; " in line


def test_help_lists_what_is_there_and_what_other_packages_have() -> None:
    alone, whole = called(LINE_ON, "--help"), called((), "--help")
    assert alone.returncode == whole.returncode == 0
    for package in ("prooflight-line", "prooflight-console", "prooflight-studies"):
        assert f"Commands of {package}, which is not installed:" in alone.stdout
    assert "not installed" not in whole.stdout
    first = alone.stdout.partition("Commands of")[0]
    assert all(f"\n  {name} " in first for name in ("demo", "inspect", "press", "camera"))
    assert not any(f"\n  {name} " in first for name in ("watch", "serve", "study"))
    assert all(f"\n  {name} " in alone.stdout for name in ("watch", "serve", "study"))
    group = called(LINE_ON, "camera", "--help")
    assert "record Needs prooflight-line: Record a camera's lines." in " ".join(group.stdout.split())


def test_a_run_with_a_console_says_that_there_is_none(tmp_path: Path) -> None:
    tried = """
from pathlib import Path
from prooflight.errors import RequestError
from prooflight_line.cli.watch.console import console_alongside
try:
    with console_alongside(True, journal="x.sqlite", press=Path("x"), job=Path("x"), port=0):
        pass
except RequestError as error:
    print(error)
"""
    hidden = WITHOUT.format(without=LINE_ON[1:]).partition("from prooflight.cli import run")[0]
    ended = subprocess.run(
        [sys.executable, "-c", hidden + tried], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert "prooflight-console is not installed; pip install prooflight-console" in ended.stdout, ended.stderr


def test_what_is_listed_is_there_and_listing_it_loads_nothing() -> None:
    listed = """
import sys
from prooflight.cli import run
assert run(["--help"]) == 0
heavy = {"numpy", "numba", "cv2", "sqlalchemy", "prooflight_line", "prooflight_console", "prooflight_studies"}
assert not heavy & set(sys.modules)
from prooflight.cli.commands import LISTED, WITHIN, Commands
group = Commands()
assert set(LISTED) == set(group.list_commands(None))
for name in LISTED:
    assert group.get_command(None, name).name == name
for name, within in WITHIN.items():
    commands = group.get_command(None, name).commands
    for one in within:
        assert not commands[one].context_settings.get("ignore_unknown_options"), one
"""
    ended = subprocess.run([sys.executable, "-c", listed], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    assert all(f"\n  {name} " in ended.stdout for name in ("demo", "inspect", "run", "press", "study"))


def test_a_commands_options_are_shown_without_what_it_needs() -> None:
    """Some are shown as a user asks for it; of all others, whatever shows them is loaded."""
    words = ("demo", "inspect", "watch", "runs", "run tidy", "press build", "press recalibrate", "camera mtf",
             "camera set-up", "job prepare", "study paper", "bench")  # fmt: skip
    shown = f"""
import sys, typer
from prooflight.cli import run
from prooflight.cli.commands import Commands

def load(path, command):
    command.get_params(typer.Context(command))
    loaded = {{"numpy", "numba", "scipy", "cv2", "sqlalchemy", "matplotlib"}} & set(sys.modules)
    assert not loaded, f"{{' '.join(path)}} --help loads {{', '.join(sorted(loaded))}}"
    for name, one in getattr(command, "commands", {{}}).items():
        load([*path, name], one)

for words in {words}:
    assert run([*words.split(), "--help"]) == 0
group = Commands()
for name in group.list_commands(None):
    load([name], group.get_command(None, name))
"""
    ended = subprocess.run([sys.executable, "-c", shown], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    assert all(f"Usage: prooflight {word} " in ended.stdout for word in words)

"""Pages of studies from results that were kept. ``pages/`` holds made-up results of every study, and their pages."""

from __future__ import annotations

import copy
import inspect
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from jinja2 import UndefinedError

from prooflight.cli import run
from prooflight.errors import InputError
from prooflight_studies.commands import paper, world
from prooflight_studies.harness.page import STUDIES, TEMPLATE, page_again, page_text, plain, write_page

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

PAGES = Path(__file__).parent / "pages"
DOCS = Path(__file__).resolve().parents[3] / "docs"
KEPT = sorted(PAGES.glob("*.json"))
UNPUBLISHED: set[str] = set()
"""Studies that have not been run in full yet."""
named = pytest.mark.parametrize("kept", KEPT, ids=lambda path: path.stem)


def read(path: Path) -> dict[str, Any]:
    results: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return results


@named
def test_a_page_is_made_from_its_results_alone(kept: Path, tmp_path: Path) -> None:
    page = page_again(kept, tmp_path / "page.md")
    assert page.read_text(encoding="utf-8") == kept.with_suffix(".md").read_text(encoding="utf-8")


@named
def test_results_that_lack_a_field_make_no_page(kept: Path) -> None:
    results = read(kept)
    for name in results:
        if name != "study":
            with pytest.raises(UndefinedError):
                page_text({key: value for key, value in results.items() if key != name})


@named
def test_rows_that_lack_a_field_make_no_page_or_leave_nothing_out(kept: Path) -> None:
    """Whatever is taken away deeper down, a page is refused, or was never going to say it."""
    results = read(kept)
    whole = page_text(results)
    for place in places(results):
        less: Any = copy.deepcopy(results)
        inner = less
        for step in place[:-1]:
            inner = inner[step]
        del inner[place[-1]]
        try:
            text = page_text(less)
        except (UndefinedError, KeyError):
            continue
        assert text == whole, place


def places(value: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Where objects that lie in lists have their fields.

    Of a list its first and its last object: a template treats all others as one of these.
    """
    if isinstance(value, list):
        ends = sorted({*range(len(value))[:1], *range(len(value))[-1:]})
        return [place for index in ends for place in places(value[index], (*at, index))]
    if not isinstance(value, dict):
        return []
    own = [(*at, key) for key in value] if at and isinstance(at[-1], int) else []
    return own + [place for key, one in value.items() for place in places(one, (*at, key))]


def test_every_study_with_a_template_has_results_here() -> None:
    with_template = {path.parent.name for path in STUDIES.glob(f"*/{TEMPLATE}")}
    assert {read(path)["study"] for path in KEPT} == with_template


def test_what_is_written_can_be_written_again(tmp_path: Path) -> None:
    results = read(PAGES / "ink.json")
    write_page(tmp_path / "first.md", "ink", {key: value for key, value in results.items() if key != "study"})
    assert read(tmp_path / "first.json") == results
    assert (
        page_again(tmp_path / "first.json", tmp_path / "again.md").read_bytes()
        == (tmp_path / "first.md").read_bytes()
    )


def test_the_command_makes_a_page_beside_its_results(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = tmp_path / "ink.json"
    kept.write_bytes((PAGES / "ink.json").read_bytes())
    assert run(["study", "page", str(kept)]) == 0
    assert (tmp_path / "ink.md").read_bytes() == (PAGES / "ink.md").read_bytes()
    assert "ink.md" in capsys.readouterr().out
    assert run(["study", "page", str(kept), "-o", str(tmp_path / "other.md"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"page": str(tmp_path / "other.md")}
    assert (tmp_path / "other.md").read_bytes() == (PAGES / "ink.md").read_bytes()
    kept.write_text("[1, 2]", encoding="utf-8")
    assert run(["study", "page", str(kept)]) == 2
    assert "is not the results of a study" in capsys.readouterr().err


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "{}", '{"study": "no-such"}', '{"study": ""}', '"ink"', "\xff"]
)
def test_a_file_that_holds_no_results_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(InputError, match="is not the results of a study"):
        page_again(path)


@pytest.mark.parametrize(
    ("name", "spoilt"),
    [
        ("ink", {"models": [{"model": "hybrid"}]}),
        ("ink", {"models": None}),
        ("ink", {"folds": {}, "measured_rise": "much"}),
        ("stress", {"rate": "much"}),
        ("paper", {"parts": [[]]}),
    ],
)
def test_results_without_what_the_page_says_are_refused(
    name: str, spoilt: dict[str, Any], tmp_path: Path
) -> None:
    path = tmp_path / "spoilt.json"
    path.write_text(json.dumps(read(PAGES / f"{name}.json") | spoilt), encoding="utf-8")
    with pytest.raises(InputError, match="lacks a value that its page needs"):
        page_again(path)
    assert not (tmp_path / "spoilt.md").exists()


def test_results_become_what_json_has() -> None:
    @dataclass
    class Row:
        name: str
        value: float

    found = {
        "rows": (Row("a", float("nan")), Row("b", 1.5)),
        "counts": np.array([[1, 2]]),
        "one": np.float32(0.5),
    }
    assert plain(found) == {
        "rows": [{"name": "a", "value": None}, {"name": "b", "value": 1.5}],
        "counts": [[1, 2]],
        "one": 0.5,
    }
    for other in ({1: "a"}, {"a"}, Path("a"), b"a"):
        with pytest.raises(TypeError):
            plain(other)


def test_what_templates_say_of_every_run_stands_in_the_published_pages() -> None:
    """Text that hangs on no figure; a template and its page in docs/results cannot drift apart."""
    analysed_modes = 0
    for template in STUDIES.glob(f"*/{TEMPLATE}"):
        study = template.parent.name
        if study in UNPUBLISHED:
            assert not [*(DOCS / "results").rglob(f"{study}.md")], f"{study} is published"
            continue
        fixed = list(said_always(template.read_text(encoding="utf-8")))
        published = "\n".join(page.read_text(encoding="utf-8") for page in published_pages(study))
        assert [line for line in fixed if line not in published] == [], study
        analysed_modes += len(fixed)
    assert analysed_modes > 100


def said_always(template: str) -> Iterator[str]:
    """Lines without a figure that hang on no condition."""
    conditions = 0
    for line in template.splitlines():
        opened, closed = line.count("{% if "), line.count("{% endif ")
        conditions += opened - closed
        if not conditions and len(line) > 20 and not any(mark in line for mark in ("{{", "{%", "{#")):
            yield line


def published_pages(study: str) -> list[Path]:
    if study == "speed":
        return [DOCS / "performance.md"]
    results = DOCS / "results"
    return [*results.rglob(f"{study}.md"), *results.rglob(f"{study}-*.md")]


@pytest.mark.parametrize(
    ("command", "page"),
    [
        (world.registration, "registration"),
        (world.worlds, "worlds"),
        (world.corpus, "corpus"),
        (world.calibration, "calibration"),
        (paper.paper, "paper"),
        (paper.robustness, "robustness"),
    ],
)
def test_the_seed_of_a_published_page_is_the_default_of_its_command(
    command: Callable[..., None], page: str
) -> None:
    (published,) = (DOCS / "results").rglob(f"{page}.md")
    said = re.findall(r"\bseed (\d+)", published.read_text(encoding="utf-8"))
    assert said
    assert {int(seed) for seed in said} == {inspect.signature(command).parameters["seed"].default}

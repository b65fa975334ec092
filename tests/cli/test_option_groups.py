from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import typer
from typer.testing import CliRunner

from prooflight.cli.option_groups import with_options


@dataclass(frozen=True, kw_only=True)
class Drum:
    every: Annotated[int, typer.Option(help="Period.", min=1)] = 10


@dataclass(frozen=True, kw_only=True)
class Options:
    job: Annotated[str, typer.Argument()]
    drum: Drum = field(default_factory=Drum)
    seed: int = 1


def test_fields_of_groups_are_options_in_the_order_of_help() -> None:
    calls = []

    def print_job(options: Options, context: typer.Context) -> None:
        """Print a job."""
        calls.append((options, context.info_name))

    program = typer.Typer()
    program.command()(with_options(print_job, Options))
    run = CliRunner().invoke
    assert run(program, ["a.pdf", "--every", "3"]).exit_code == 0
    assert calls == [(Options(job="a.pdf", drum=Drum(every=3)), "print-job")]
    text = run(program, ["--help"]).stdout
    assert "Print a job." in text
    assert text.index("--every") < text.index("--seed")
    assert run(program, ["a.pdf", "--every", "0"]).exit_code == 2

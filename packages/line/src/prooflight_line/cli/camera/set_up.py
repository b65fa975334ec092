"""``prooflight camera set-up``: set-up of a line camera step by step, with the results written to the press file."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer
from rich.text import Text

from prooflight.cli import show
from prooflight.cli.options import Json
from prooflight.errors import RequestError
from prooflight_line.cli.camera.line_cameras import CameraId

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.press.press_file import PressFile
    from prooflight_line.camera_set_up.wizard import Protocol

STYLES: Final = {"title": "bold", "plain": "", "good": "green", "poor": "bold red", "faint": "dim"}


def set_up(
    name: CameraId,
    press_file: Annotated[
        Path,
        typer.Argument(
            metavar="PRESS.toml", help="Press file; copied from the prototype's if it does not exist."
        ),
    ],
    like: Annotated[
        Path | None, typer.Option(metavar="OTHER.toml", help="Start a new press file from this one.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Run unattended, with Enter to every question.")] = False,
    answers: Annotated[
        Path | None,
        typer.Option(
            metavar="A.toml", help='Run unattended: key = "answer" for a question; Enter to the others.'
        ),
    ] = None,
    again: Annotated[
        bool, typer.Option("--again", help="Start over instead of continuing an unfinished set-up.")
    ] = False,
    json: Json = False,
) -> None:
    """Set a line camera up step by step: dark, light, focus, width, encoder; and write the press file.

    Each step shows what to do, waits for Enter, measures, and reports its result. Comments of the press file
    remain. A set-up that was stopped continues where it ended.
    """
    from prooflight.press.press_file import PressFile
    from prooflight_line.camera_set_up import wizard
    from prooflight_line.camera_set_up.line_reader import CameraLineReader
    from prooflight_line.camera_set_up.steps import QUESTIONS
    from prooflight_line.cameras.backends import camera_named, ready

    given = None if answers is None else wizard.answers_of(_answers(answers), QUESTIONS, where=answers)
    camera = camera_named(name)
    begun = not press_file.exists()
    unfinished = wizard.protocol_path(press_file)
    left = None if again or begun else wizard.Protocol.of(unfinished, camera=camera.id)
    press = _source(like) if begun else PressFile.read(press_file)
    settings = press.camera_settings()
    opened = ready(camera, settings, where=str(press_file))
    try:
        reader = CameraLineReader(opened, names=settings.names.get(camera.model))
        if begun:
            _begin(press_file, press, sensors=reader.sensors, camera=camera.id)
            _say(f"{press_file} is started from {press.path.name}", "faint", quiet=json)
        protocol = left or wizard.Protocol(camera=camera.id, begun=begun)
        attended = not yes and given is None
        prompts = wizard.Prompts(
            say=lambda text, kind: _say(text, kind, quiet=json),
            answer=_typed if attended else _given(given, quiet=json),
            attended=attended,
        )
        try:
            wizard.SetUp(line_reader=reader, path=press_file, prompts=prompts, protocol=protocol).run()
        except wizard.Stopped:
            _say("stopped; the same command continues from here", "faint", quiet=json)
    finally:
        opened.close()
    if json:
        show.print_json(_facts(protocol, press_file))
    else:
        _summary(protocol, press_file)


def _source(like: Path | None) -> PressFile:
    """Return the press file that a new one is copied from."""
    from prooflight.press.press_file import PressFile

    return PressFile.prototype() if like is None else PressFile.read(like)


def _begin(path: Path, source: PressFile, *, sensors: int, camera: str) -> None:
    """Copy the source to a new press file; RequestError if it describes another kind of camera."""
    from prooflight.files.atomic import whole_file

    described = len(source.camera().sensors)
    if described != sensors:
        what = f"{camera} sends {sensors} sensors, {source.path.name} describes {described}"
        raise RequestError(
            path, what, remedy="use --like OTHER.toml, a press file with as many [[sensor]] blocks"
        )
    with whole_file(path) as unfinished:
        unfinished.write_bytes(source.text.encode())


def _answers(path: Path) -> dict[str, Any]:
    from prooflight.files.given import GivenFiles

    files = GivenFiles(error=RequestError, remedy='give a file of key = "answer" (TOML)', largest_mb=1)
    try:
        tree = tomllib.loads(files.read_text(path))
    except tomllib.TOMLDecodeError as error:
        raise RequestError(path, f"is not TOML ({error})", remedy=files.remedy) from error
    return _flat(tree)


def _flat(tree: dict[str, Any], before: str = "") -> dict[str, Any]:
    """Flatten a tree, so that ``sheet.across = "..."`` equals ``"sheet.across" = "..."``."""
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        flat |= _flat(value, f"{before}{key}.") if isinstance(value, dict) else {f"{before}{key}": value}
    return flat


def _say(text: str, kind: Literal["title", "plain", "good", "poor", "faint"], *, quiet: bool) -> None:
    if not quiet:
        show.people.print(
            text if kind == "title" else f"  {text}", style=STYLES[kind], highlight=False, soft_wrap=True
        )


def _typed(_key: str, question: str, usual: str) -> str:
    """Read one line; the question goes to standard error, so that standard output may be a document."""
    from prooflight_line.camera_set_up.wizard import Stopped

    show.errors.print(f"> {question}{f' [{usual}]' if usual else ''} ", end="", style="cyan", highlight=False)
    show.errors.file.flush()
    line = sys.stdin.readline()
    if not line:
        raise Stopped
    return line


def _given(given: Callable[[str], str] | None, *, quiet: bool) -> Callable[[str, str, str], str]:
    def answer(key: str, question: str, usual: str) -> str:
        reply = given(key) if given is not None else ""
        _say(f"> {question} [{reply or usual or 'Enter'}]", "faint", quiet=quiet)
        return reply

    return answer


def _facts(protocol: Protocol, press_file: Path) -> dict[str, Any]:
    return {
        "camera": protocol.camera,
        "press_file": press_file,
        "finished": protocol.finished,
        "steps": protocol.steps,
        "questions": protocol.questions,
        "asked": len(protocol.questions),
        "measured_s": round(sum(one["seconds"] for one in protocol.steps.values()), 3),
        "waited_s": round(sum(one["seconds"] for one in protocol.questions), 3),
    }


def _summary(protocol: Protocol, press_file: Path) -> None:
    from prooflight_line.camera_set_up.wizard import protocol_path

    table = show.table_of("", ("step", "state", "seconds"), text_columns=("step", "state"))
    for one in protocol.steps.values():
        style = {"good": "green", "poor": "bold red", "failed": "bold red"}.get(one["state"], "dim")
        table.add_row(one["title"], Text(one["state"], style=style), f"{one['seconds']:.1f}")
    show.people.print(table)
    unmeasured = [line for one in protocol.steps.values() for line in one["unmeasured"]]
    skipped = [one["title"] for one in protocol.steps.values() if one["state"] == "skipped"]
    if skipped:
        show.people.print("skipped, unchanged in the press file:", ", ".join(skipped), highlight=False)
    for line in unmeasured:
        show.people.print("not measured:", line, highlight=False, style="dim")
    show.people.print(show.strong(press_file), "contains the measured values")
    if protocol.finished:
        show.people.print(
            f"Next: prooflight press build {press_file} -o {press_file.stem}.press"
            f" --columns {protocol_path(press_file)}",
            highlight=False,
        )

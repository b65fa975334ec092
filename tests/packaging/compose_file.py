"""The services of packaging/compose.yaml as processes of this machine: their commands, variables and folders."""

from __future__ import annotations

import json
import os
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import yaml

ROOT: Final = Path(__file__).resolve().parents[2]
PACKAGING: Final = ROOT / "packaging"
OWN: Final = "prooflight:"
"""Begin of the name of the image that packaging/Containerfile describes."""
_VARIABLE: Final = re.compile(r"\$(?:\$|\{(?P<name>\w+)(?::-(?P<default>[^}]*))?\})")


@dataclass(frozen=True, kw_only=True)
class Image:
    """What packaging/Containerfile says of every container of its image."""

    entrypoint: tuple[str, ...]
    command: tuple[str, ...]
    environment: dict[str, str]

    @classmethod
    def read(cls) -> Image:
        """Read the last stage."""
        text = (PACKAGING / "Containerfile").read_text(encoding="utf-8").replace("\\\n", " ")
        stage = text.rpartition("\nFROM ")[2].splitlines()

        def after(word: str) -> str:
            (line,) = [one for one in stage if re.match(rf"\s*{word} ", one)]
            return line.split(word + " ", 1)[1]

        environment = dict(pair.split("=", 1) for pair in after("ENV").split())
        return cls(
            entrypoint=tuple(json.loads(after("ENTRYPOINT"))),
            command=tuple(json.loads(after("CMD"))),
            environment=environment,
        )


@dataclass(frozen=True, kw_only=True)
class Service:
    """A service as a process of this machine."""

    name: str
    image: str
    arguments: tuple[str, ...]
    environment: dict[str, str]


def document() -> dict[str, Any]:
    """Return the file as it is written."""
    return yaml.safe_load((PACKAGING / "compose.yaml").read_text(encoding="utf-8"))


def services(folder: Path, *, ports: dict[int, int], variables: dict[str, str]) -> dict[str, Service]:
    """Return all services, with what their volumes hold in ``folder``.

    ports: of this machine, by those of the file. variables: those that the file asks for.
    """
    image = Image.read()
    made = {}
    for name, given in document()["services"].items():
        own = given["image"].startswith(OWN)
        places = _places(given.get("volumes", ()), folder, ports)
        entrypoint = given.get("entrypoint", image.entrypoint if own else ())
        command = given.get("command", image.command if own else ())
        environment = {**(image.environment if own else {}), **given.get("environment", {})}

        def here(text: str, places: dict[str, str] = places) -> str:
            return _here(_interpolated(text, variables), places, ports)

        made[name] = Service(
            name=name,
            image=given["image"],
            arguments=tuple(map(here, (*entrypoint, *command))),
            environment={key: here(value) for key, value in environment.items()},
        )
    return made


def environment_here(service: Service) -> dict[str, str]:
    """Return all variables of a service's process: its own, and what finds this checkout's program.

    Kernels are those that this checkout has compiled; to compile all of them takes minutes.
    """
    programs = Path(sys.executable).parent
    path = f"{programs}:{os.environ['PATH']}"
    mine = {name: os.environ[name] for name in ("PYTHONPATH", "OPENBLAS_CORETYPE") if name in os.environ}
    own = {name: value for name, value in service.environment.items() if name != "NUMBA_CACHE_DIR"}
    return {**mine, **own, "PATH": path}


def health_here(name: str, ports: dict[int, int]) -> tuple[str, ...]:
    """Return the command by which a service's health is checked."""
    how, *command = document()["services"][name]["healthcheck"]["test"]
    assert how == "CMD"
    return tuple(_here(part, {}, ports) for part in command)


def _places(volumes: Any, folder: Path, ports: dict[int, int]) -> dict[str, str]:
    """Return folders and files of this machine by their places in the container; files with the ports of here."""
    places = {}
    for volume in volumes:
        source, target = volume.split(":")[:2]
        if source.startswith("."):
            content = _here((PACKAGING / source).resolve().read_text(encoding="utf-8"), {}, ports)
            place = folder / "files" / target.lstrip("/")
            place.parent.mkdir(parents=True, exist_ok=True)
            if "prometheus" in target:  # which names the token's place
                content = content.replace("/run/prooflight/", f"{folder / 'token'}/")
            place.write_text(content, encoding="utf-8")
        else:
            place = folder / source
            place.mkdir(parents=True, exist_ok=True)
        places[target] = str(place)
    # Variables of the image that name the folder above: commands add the program's own folder.
    for target in ("/var/lib/prooflight", "/var/cache/prooflight"):
        if target in places:
            above = folder / f"{Path(places[target]).name}-above"
            above.mkdir(exist_ok=True)
            if not (above / "prooflight").exists():
                (above / "prooflight").symlink_to(places[target])
            places[str(Path(target).parent)] = str(above)
    return places


def _here(text: str, places: dict[str, str], ports: dict[int, int]) -> str:
    for target in sorted(places, key=len, reverse=True):
        text = re.sub(rf"(?<![\w/]){re.escape(target)}(?![\w-])", places[target], text)
    for port, other in ports.items():
        text = re.sub(rf"\b{port}\b", str(other), text)
    return text


def _interpolated(text: str, variables: dict[str, str]) -> str:
    """Replace variables as the Compose specification says."""

    def value(match: re.Match[str]) -> str:
        name = match["name"]
        return "$" if name is None else variables.get(name) or match["default"] or ""

    return _VARIABLE.sub(value, str(text))

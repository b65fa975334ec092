"""``[plant.*]`` of a press file: the receivers of a run's events, and how they are reached.

Passwords and secrets never stand in a press file: it names a file or a variable of the environment that holds
one.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

from pydantic import BaseModel, Field, model_validator

from prooflight.errors import PressFileError
from prooflight.files.fields import NO_OTHER_FIELDS
from prooflight.files.given import GivenFiles, shortly

SECRET_FILES: Final = GivenFiles(
    error=PressFileError, remedy="name a file of one line that holds the secret", largest_mb=0.01
)
LEAST_SECRET: Final = 16
"""Least number of characters of a webhook's secret.

assumed: 16 random letters and digits cannot be guessed.
"""

Text = Annotated[str, Field(strict=True, min_length=1, max_length=500)]
Port = Annotated[int, Field(strict=True, ge=1, le=65535)]
Seconds = Annotated[float, Field(strict=True, ge=0.1, le=3600)]
Room = Annotated[int, Field(strict=True, ge=1, le=1_000_000)]
Url = Annotated[str, Field(strict=True, max_length=2000, pattern=r"^https?://[^/\s]+(/\S*)?$")]
Topic = Annotated[str, Field(strict=True, max_length=200, pattern=r"^[^#+\x00$/][^#+\x00]*$")]
Kind = Literal[
    "run-started",
    "run-ended",
    "sheet-judged",
    "sheet-at-gate",
    "incident-opened",
    "incident-changed",
    "incident-ended",
    "state-changed",
    "notice",
]


class _Block(BaseModel):
    model_config = NO_OTHER_FIELDS


class MqttBlock(_Block):
    """``[plant.mqtt]``."""

    host: Text
    port: Port | None = None
    """Port; None: 1883, with ``tls`` 8883."""
    topic: Topic | None = None
    """Prefix of all topics; None: prooflight/ and the press's name."""
    client_id: Text | None = None
    user: Text | None = None
    password_file: Text | None = None
    password_env: Text | None = None
    tls: Annotated[bool, Field(strict=True)] = False
    ca_file: Text | None = None
    """Certificates to trust; None: the system's."""
    keepalive_s: Annotated[int, Field(strict=True, ge=1, le=3600)] = 10

    @model_validator(mode="after")
    def _fits(self) -> Self:
        _one_of(self, "password_file", "password_env")
        _needs(self, "password_file", "user")
        _needs(self, "password_env", "user")
        if self.ca_file is not None and not self.tls:
            message = "ca_file needs tls = true"
            raise ValueError(message)
        return self


class WebhookBlock(_Block):
    """One ``[[plant.webhook]]``."""

    url: Url
    secret_file: Text | None = None
    secret_env: Text | None = None
    events: Annotated[tuple[Kind, ...], Field(min_length=1)] | None = None
    """Kinds of events to send; None: all."""
    timeout_s: Seconds = 10.0
    ca_file: Text | None = None

    @model_validator(mode="after")
    def _fits(self) -> Self:
        _one_of(self, "secret_file", "secret_env")
        if self.secret_file is None and self.secret_env is None:
            message = "needs secret_file or secret_env"
            raise ValueError(message)
        return self


class XjmfBlock(_Block):
    """``[plant.xjmf]``."""

    url: Url | None = None
    """Address to which signals are pushed; None: none are."""
    listen: Text | None = None
    """Address HOST:PORT at which queries are answered; None: none are."""
    device_id: Annotated[str, Field(strict=True, max_length=100, pattern=r"^[\w.:-]+$")] = "prooflight"
    sheets: Literal["all", "alarms"] = "all"
    """Sheets of which signals are pushed."""
    timeout_s: Seconds = 10.0
    ca_file: Text | None = None

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.url is None and self.listen is None:
            message = "needs url, listen or both"
            raise ValueError(message)
        if self.listen is not None:
            address(self.listen)
        return self


class OpcuaBlock(_Block):
    """``[plant.opcua]``."""

    listen: Text = "127.0.0.1:4840"
    certificate_file: Text | None = None
    key_file: Text | None = None
    anonymous: Annotated[bool, Field(strict=True)] = True
    user: Text | None = None
    password_file: Text | None = None
    password_env: Text | None = None

    @model_validator(mode="after")
    def _fits(self) -> Self:
        host, _ = address(self.listen)
        _one_of(self, "password_file", "password_env")
        if (self.certificate_file is None) != (self.key_file is None):
            message = "needs both certificate_file and key_file"
            raise ValueError(message)
        has_password = self.password_file is not None or self.password_env is not None
        if (self.user is None) == has_password:
            message = "needs user and either password_file or password_env"
            raise ValueError(message)
        if not self.anonymous and self.user is None:
            message = "anonymous = false needs user"
            raise ValueError(message)
        if self.user is not None and self.certificate_file is None:
            message = "user needs certificate_file and key_file, or its password would be sent unencrypted"
            raise ValueError(message)
        if not is_loopback(host) and self.certificate_file is None:
            message = f"listen beyond this machine ({host}) needs certificate_file and key_file"
            raise ValueError(message)
        return self


class PlantBlock(_Block):
    """``[plant]``."""

    room: Room = 10_000
    """Number of events that may wait at each outlet."""
    mqtt: MqttBlock | None = None
    webhook: Annotated[tuple[WebhookBlock, ...], Field(max_length=16)] = ()
    xjmf: XjmfBlock | None = None
    opcua: OpcuaBlock | None = None


def address(text: str) -> tuple[str, int]:
    """Return host and port of HOST:PORT, [IPV6]:PORT. ValueError: it is none."""
    host, colon, port = text.rpartition(":")
    if not (colon and host and port.isascii() and port.isdecimal() and 0 <= int(port) <= 65535):
        message = "listen must be HOST:PORT"
        raise ValueError(message)
    return host.strip("[]"), int(port)


def is_loopback(host: str) -> bool:
    """Return whether the host can be reached from this machine alone."""
    return host in ("localhost", "::1") or host.startswith("127.")


def secret(path: Path, where: str, block: BaseModel, name: str) -> str | None:
    """Return the secret in ``name``_file or ``name``_env of a block, without the line's end; None: neither is given.

    path: of the press file, to which the file's name is relative. where: the block, for errors.
    PressFileError: it is missing, or it is empty.
    """
    file, variable = getattr(block, f"{name}_file"), getattr(block, f"{name}_env")
    if file is not None:
        field = f"{where}.{name}_file"
        try:
            content = SECRET_FILES.read_text(path.parent / file).rstrip("\n")
        except (OSError, PressFileError) as error:
            raise PressFileError(
                path, f"{field}: {shortly(file)} cannot be read", remedy=SECRET_FILES.remedy
            ) from error
    elif variable is not None:
        field = f"{where}.{name}_env"
        content = os.environ.get(variable, "")
    else:
        return None
    if not content or "\n" in content:
        what = "is empty" if not content else "holds more than a line"
        named = shortly(file or variable)
        raise PressFileError(
            path, f"{field}: {named} {what}", remedy="it must contain the secret and nothing else"
        )
    return content


def _one_of(block: BaseModel, one: str, other: str) -> None:
    if getattr(block, one) is not None and getattr(block, other) is not None:
        message = f"needs {one} or {other}, not both"
        raise ValueError(message)


def _needs(block: Any, name: str, needed: str) -> None:
    if getattr(block, name) is not None and getattr(block, needed) is None:
        message = f"{name} needs {needed}"
        raise ValueError(message)

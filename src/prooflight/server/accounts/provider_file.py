"""The file by which people sign in at an OpenID provider: ``[oidc]`` and ``[oidc.roles]``, TOML.

Its secret never stands in it: it names a file or a variable of the environment that holds one.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, Final, Self
from urllib.parse import urlsplit

from pydantic import AfterValidator, Field, model_validator

from prooflight.errors import RequestError
from prooflight.files.given import GivenFiles
from prooflight.files.schema import Block, Misfit, Name, checked
from prooflight.press.outlets import is_loopback, secret
from prooflight.server.accounts.roles import Role

if TYPE_CHECKING:
    from pathlib import Path

FILES: Final = GivenFiles(
    error=RequestError, remedy="give a file (TOML, UTF-8) with a block [oidc]", largest_mb=0.25
)
REMEDY: Final = "see docs/how-to/console.md, sign in at the plant's own service"
RETURN_PATH: Final = "/sign-in/provider/return"
"""Under the console's address; the provider must know the two together as a redirect URI."""


def _address(text: str) -> str:
    """An address that nobody on the way can read along or change."""
    parts = urlsplit(text)
    if parts.scheme not in ("http", "https") or not parts.hostname or parts.query or parts.fragment:
        message = "must be an address such as https://login.example/plant"
        raise ValueError(message)
    if parts.scheme == "http" and not is_loopback(parts.hostname):
        message = "must begin with https: others could read along"
        raise ValueError(message)
    return text


Address = Annotated[str, Field(max_length=500), AfterValidator(_address)]
Groups = Annotated[tuple[Name, ...], Field(max_length=100)]


class _Roles(Block):
    """``[oidc.roles]``: what the claim must hold for a role."""

    viewer: Groups = ()
    operator: Groups = ()
    engineer: Groups = ()
    admin: Groups = ()


class _Oidc(Block):
    """``[oidc]``."""

    issuer: Address
    address: Address
    client_id: Name
    client_secret_file: Name | None = None
    client_secret_env: Name | None = None
    ca_file: Name | None = None
    name: Annotated[str, Field(min_length=1, max_length=40)] = "OpenID Connect"
    scopes: Annotated[tuple[Name, ...], Field(max_length=20)] = ("openid", "profile")
    claim: Name = "groups"
    name_claim: Name = "preferred_username"
    ask_again: bool = False
    sign_out_there: bool = True
    roles: _Roles

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.client_secret_file is not None and self.client_secret_env is not None:
            message = "needs client_secret_file or client_secret_env, not both"
            raise ValueError(message)
        if "openid" not in self.scopes:
            message = 'scopes must hold "openid"'
            raise ValueError(message)
        if not any(groups for _, groups in self.roles):
            message = "roles must map a group to at least one of viewer, operator, engineer, admin"
            raise ValueError(message)
        return self


@dataclass(frozen=True, slots=True, kw_only=True)
class ProviderSettings:
    """One OpenID provider, and which of its people may what."""

    issuer: str
    address: str
    """Of the console, as browsers reach it; no slash at its end."""
    client_id: str
    client_secret: str | None = field(repr=False)
    """None: a public client, which PKCE alone guards."""
    ca_file: Path | None
    """Certificates that the provider's are checked by, PEM; None: those of the system."""
    name: str
    """Of the service, on the button."""
    scopes: tuple[str, ...]
    claim: str
    """Of the ID token: what it holds is mapped to roles."""
    name_claim: str
    ask_again: bool
    """Whether the provider is to ask for the password each time: on screens that people share."""
    sign_out_there: bool
    """Whether signing out of the console also signs out there."""
    roles: tuple[tuple[str, Role], ...]
    """Group, and the role that it gives."""

    @classmethod
    def read(cls, path: Path) -> Self:
        """RequestError, PressFileError: the first thing that is wrong, with its field; OSError."""
        try:
            raw: Any = tomllib.loads(FILES.read_text(path))
        except tomllib.TOMLDecodeError as error:
            raise RequestError(path, f"is no TOML: {error}", remedy=FILES.remedy) from error
        if unknown := sorted(set(raw) - {"oidc"}):
            raise RequestError(path, f"{unknown[0]} is not known here", remedy=REMEDY)
        if not isinstance(raw.get("oidc"), dict):
            raise RequestError(path, "has no block [oidc]", remedy=FILES.remedy)
        if "client_secret" in raw["oidc"]:
            remedy = "write client_secret_file or client_secret_env, which names where it is"
            raise RequestError(path, "oidc.client_secret must not stand in a file of settings", remedy=remedy)
        try:
            block = checked(_Oidc, raw["oidc"], under="oidc.")
        except Misfit as error:
            raise RequestError(path, str(error), remedy=REMEDY) from error
        except TypeError as error:  # a date
            raise RequestError(path, "oidc holds a date", remedy=REMEDY) from error
        return cls(
            issuer=block.issuer,
            address=block.address.rstrip("/"),
            client_id=block.client_id,
            client_secret=secret(path, "oidc", block, "client_secret"),
            ca_file=_beside(path, block.ca_file),
            name=block.name,
            scopes=block.scopes,
            claim=block.claim,
            name_claim=block.name_claim,
            ask_again=block.ask_again,
            sign_out_there=block.sign_out_there,
            roles=tuple((group, Role(role)) for role, groups in block.roles for group in groups),
        )

    @property
    def return_address(self) -> str:
        """Where the provider sends browsers back to."""
        return self.address + RETURN_PATH

    def role(self, groups: tuple[str, ...]) -> Role | None:
        """The highest that one of these groups gives; None: none gives any."""
        found = [role for group, role in self.roles if group in groups]
        return max(found, key=lambda role: role.rank, default=None)


def _beside(path: Path, name: str | None) -> Path | None:
    if name is None:
        return None
    found = path.parent / name
    if not found.is_file():
        raise RequestError(path, f"oidc.ca_file: {name} is no file", remedy="name certificates as PEM")
    return found

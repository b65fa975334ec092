"""The file with the settings of an OpenID provider: ``[oidc]`` and ``[oidc.roles]``, TOML.

The secret is never part of it: the file names a file or an environment variable that holds the secret.
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
from prooflight_console.accounts.roles import Role

if TYPE_CHECKING:
    from pathlib import Path

FILES: Final = GivenFiles(
    error=RequestError, remedy="give a file (TOML, UTF-8) with a block [oidc]", largest_mb=0.25
)
REMEDY: Final = "see docs/how-to/console.md, sign in at the plant's own service"
RETURN_PATH: Final = "/sign-in/provider/return"
"""Path under the console's address; the provider must know the two together as a redirect URI."""


def _address(text: str) -> str:
    """Return the address if its traffic cannot be read or changed on the way; raises ValueError."""
    parts = urlsplit(text)
    if parts.scheme not in ("http", "https") or not parts.hostname or parts.query or parts.fragment:
        message = "must be an address such as https://login.example/plant"
        raise ValueError(message)
    if parts.scheme == "http" and not is_loopback(parts.hostname):
        message = "must begin with https: others could read the exchange"
        raise ValueError(message)
    return text


Address = Annotated[str, Field(max_length=500), AfterValidator(_address)]
Groups = Annotated[tuple[Name, ...], Field(max_length=100)]


class _Roles(Block):
    """``[oidc.roles]``: values of the claim that give each role."""

    viewer: Groups = ()
    operator: Groups = ()
    engineer: Groups = ()
    admin: Groups = ()


class _Oidc(Block):
    """``[oidc]``: the provider and the console's registration there."""

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
            message = 'scopes must contain "openid"'
            raise ValueError(message)
        if not any(groups for _, groups in self.roles):
            message = "roles must map a group to at least one of viewer, operator, engineer, admin"
            raise ValueError(message)
        return self


@dataclass(frozen=True, slots=True, kw_only=True)
class ProviderSettings:
    """Settings of one OpenID provider, and the roles that it gives to people."""

    issuer: str
    address: str
    """Address of the console as browsers reach it, without a slash at its end."""
    client_id: str
    client_secret: str | None = field(repr=False)
    """Secret of the client; None for a public client, which PKCE alone protects."""
    ca_file: Path | None
    """PEM file of the authorities that sign the provider's certificate; None for those of the system."""
    name: str
    """Name of the service on the button."""
    scopes: tuple[str, ...]
    claim: str
    """Claim of the ID token whose values are mapped to roles."""
    name_claim: str
    ask_again: bool
    """Whether the provider must ask for the password each time, as on screens that people share."""
    sign_out_there: bool
    """Whether signing out of the console also signs out there."""
    roles: tuple[tuple[str, Role], ...]
    """Pairs of a group and the role that it gives."""

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read the settings from a file.

        Raises RequestError or PressFileError for the first field that is wrong, and OSError.
        """
        try:
            raw: Any = tomllib.loads(FILES.read_text(path))
        except tomllib.TOMLDecodeError as error:
            raise RequestError(path, f"is not TOML: {error}", remedy=FILES.remedy) from error
        if unknown := sorted(set(raw) - {"oidc"}):
            raise RequestError(path, f"{unknown[0]} is unknown here", remedy=REMEDY)
        if not isinstance(raw.get("oidc"), dict):
            raise RequestError(path, "has no block [oidc]", remedy=FILES.remedy)
        if "client_secret" in raw["oidc"]:
            remedy = "write client_secret_file or client_secret_env, which states where it is"
            raise RequestError(path, "oidc.client_secret must not be in a file of settings", remedy=remedy)
        try:
            block = checked(_Oidc, raw["oidc"], under="oidc.")
        except Misfit as error:
            raise RequestError(path, str(error), remedy=REMEDY) from error
        except TypeError as error:  # a TOML date, which has no JSON form
            raise RequestError(path, "oidc contains a date", remedy=REMEDY) from error
        return cls(
            issuer=block.issuer,
            address=block.address.rstrip("/"),
            client_id=block.client_id,
            client_secret=secret(path, "oidc", block, "client_secret"),
            ca_file=_certificates(path, block.ca_file),
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
        """Address to which the provider sends browsers back."""
        return self.address + RETURN_PATH

    def role(self, groups: tuple[str, ...]) -> Role | None:
        """Return the highest role that one of these groups gives; None if none gives any."""
        roles = [role for group, role in self.roles if group in groups]
        return max(roles, key=lambda role: role.rank, default=None)


def _certificates(path: Path, name: str | None) -> Path | None:
    if name is None:
        return None
    certificates = path.parent / name
    if not certificates.is_file():
        raise RequestError(path, f"oidc.ca_file: {name} is not a file", remedy="give certificates as PEM")
    return certificates

"""What a console is started with."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from prooflight.server.accounts.provider_file import ProviderSettings

SUFFIX: Final = ".console.sqlite"
CACHE_SUFFIX: Final = ".console.tiles"


@dataclass(frozen=True, slots=True, kw_only=True)
class ConsoleSettings:
    """Of one console; its journal need not be there yet."""

    journal: Path
    data: Path
    """The console's own file."""
    tiles: Path
    """Folder of pictures that were made."""
    tiles_bytes: int = 2_000_000_000
    """The folder's bound; what was looked at longest ago goes first."""
    presses: tuple[Path, ...] = ()
    """Press artefacts, by which verdicts are made again and expected pages pictured; found by their digests."""
    jobs: tuple[Path, ...] = ()
    """Jobs, found by their digests."""
    secure: bool = False
    """Whether it is reached by TLS: cookies then go no other way."""
    origins: tuple[str, ...] = field(default=())
    """Addresses beside its own by which browsers may reach it, as behind a proxy: https://console.example."""
    trays: Path | None = None
    """The controller's log of its trays; it may grow."""
    trusted_proxies: tuple[str, ...] = ()
    """Addresses or networks of proxies that say for whom they ask (``X-Forwarded-For``)."""
    provider: ProviderSettings | None = None
    """At which people may sign in as well."""

    @classmethod
    def of(cls, journal: Path, *, data: Path | None = None, **told: object) -> ConsoleSettings:
        """Its own file and its pictures lie beside the journal unless somebody says otherwise."""
        own = data or journal.with_name(journal.name + SUFFIX)
        return cls(journal=journal, data=own, tiles=own.with_name(own.name + ".tiles"), **told)  # type: ignore[arg-type]

"""Settings with which a console is started."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from prooflight_console.accounts.provider_file import ProviderSettings

SUFFIX: Final = ".console.sqlite"


@dataclass(frozen=True, slots=True, kw_only=True)
class ConsoleSettings:
    """Settings of one console, whose journal need not exist yet."""

    journal: Path
    data: Path
    """The console's own database file."""
    tiles: Path
    """Folder in which pictures are cached."""
    tiles_bytes: int = 2_000_000_000
    """Largest size of the cache; the pictures used longest ago are removed first. [bytes]"""
    presses: tuple[Path, ...] = ()
    """Press artefacts for repeating verdicts and picturing expected pages, selected by their digests."""
    jobs: tuple[Path, ...] = ()
    """Jobs, selected by their digests."""
    scans: tuple[Path, ...] = ()
    """Recorded scans of good pages of the jobs, in their order, from which the first press may learn."""
    press_file: Path | None = None
    """Press file from which the first press may be built again."""
    secure: bool = False
    """Whether the console is reached by TLS; cookies are then sent by TLS alone."""
    origins: tuple[str, ...] = field(default=())
    """Further addresses at which browsers reach the console, as behind a proxy: https://console.example."""
    trays: Path | None = None
    """The controller's log of its trays, which may grow."""
    records: str | None = None
    """URL of the database with the records of many presses; None: only this press is shown."""
    queue: Path | None = None
    """Hot folder of the press, whose jobs are counted and shown, and take uploads; None: there is none."""
    trusted_proxies: tuple[str, ...] = ()
    """Addresses or networks of proxies whose ``X-Forwarded-For`` is trusted."""
    provider: ProviderSettings | None = None
    """OpenID provider for sign-in, in addition to the console's own accounts."""

    @classmethod
    def of(cls, journal: Path, *, data: Path | None = None, **values: object) -> ConsoleSettings:
        """Return settings with database and pictures next to the journal unless ``values`` name others."""
        own = data or journal.with_name(journal.name + SUFFIX)
        return cls(journal=journal, data=own, tiles=own.with_name(own.name + ".tiles"), **values)  # type: ignore[arg-type]

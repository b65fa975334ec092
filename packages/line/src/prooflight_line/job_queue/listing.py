"""Jobs of a hot folder as lists show them: where each is, what was ordered, and what was seen in its file."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from prooflight.errors import InputError, RequestError
from prooflight.files.lock import writer_lives
from prooflight_line.job_queue.arrivals import UNFINISHED
from prooflight_line.job_queue.hot_folder import FILL, LOCKS, HotFolder
from prooflight_line.job_queue.tickets.reading import read_ticket

if TYPE_CHECKING:
    from collections.abc import Iterable

    from prooflight_line.job_queue.hot_folder import Entry, Stage
    from prooflight_line.job_queue.tickets.ticket import Ticket

WAITING: Final[tuple[Stage, ...]] = ("printing", "queued", "held", "checking")
ENDED: Final[tuple[Stage, ...]] = ("done", "rejected")


@dataclass(frozen=True, slots=True, kw_only=True)
class Listed:
    """A job in a list."""

    number: int
    key: str
    name: str
    """Name of its file; empty: somebody has taken it away."""
    stage: Stage
    first: bool
    """Whether a person had it printed before others."""
    reason: str
    """Why it was rejected; empty: it was not."""
    ticket: Ticket | None
    examined: dict[str, Any]
    """What was seen when it was checked (``examining.Examined.facts``); empty: it was not yet."""

    @property
    def pages(self) -> int | None:
        """Pages of its file; None: not known."""
        pages = self.examined.get("pages")
        return pages if isinstance(pages, int) else None

    @property
    def of_file(self) -> tuple[str, ...]:
        """Records and printing condition of its file, as far as there are any."""
        return tuple(str(text) for name in ("records", "condition") if (text := self.examined.get(name)))

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings of the whole job."""
        notes = self.examined.get("notes", ())
        return tuple(map(str, notes)) if isinstance(notes, list | tuple) else ()


def listed(entries: Iterable[Entry]) -> list[Listed]:
    """Return jobs as lists show them."""
    return [
        Listed(
            number=entry.number,
            key=entry.key,
            name=_name(entry),
            stage=entry.stage,
            first=entry.rank > 0,
            reason=entry.reason,
            ticket=ticket_of(entry),
            examined=entry.examined,
        )
        for entry in entries
    ]


def _name(entry: Entry) -> str:
    with suppress(RequestError):
        return entry.file.name
    return ""


def arriving(folder: HotFolder) -> list[str]:
    """Return the names of the files that were not taken in yet."""
    names = sorted(path.name for path in folder.path.iterdir() if path.is_file())
    return [name for name in names if not name.startswith(".") and not name.lower().endswith(UNFINISHED)]


def filled(folder: HotFolder) -> bool:
    """Return whether a process takes jobs in now."""
    return writer_lives(folder.path / LOCKS / FILL)


def job_id(entry: Entry) -> str:
    """Return the job's ID in the ticket of a job; empty: it has none."""
    ticket = ticket_of(entry)
    return "" if ticket is None else ticket.job_id


def ticket_of(entry: Entry) -> Ticket | None:
    """Return the ticket of a job; None: it has none that can be read."""
    with suppress(InputError, OSError):
        return None if entry.ticket is None else read_ticket(entry.ticket, folder=entry.path.parent.parent)
    return None

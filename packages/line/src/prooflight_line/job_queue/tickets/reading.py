"""Reading of tickets, in the language in which each is written."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight_line.job_queue.tickets import jdf, xjdf
from prooflight_line.job_queue.tickets.xml import parsed

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight_line.job_queue.tickets.ticket import Ticket


def read_ticket(path: Path, *, folder: Path | None = None) -> Ticket:
    """Read a ticket; JobError names its line and element, and what would be right.

    folder: where the ticket came, for the files that it may name; None: its own.
    """
    document = parsed(path)
    readers = {xjdf.NAMESPACE: ("XJDF", xjdf.read), jdf.NAMESPACE: ("JDF", jdf.read)}
    root = document.root
    expected, read = readers.get(document.namespace, ("", None))
    if read is None or document.name(root) != expected:
        what = f"is not a ticket: {document.namespace or 'no namespace'}"
        raise document.refusal(root, what, f"send XJDF 2.x ({xjdf.NAMESPACE}) or JDF 1.x ({jdf.NAMESPACE})")
    return read(document, folder or path.parent)

"""Writing of a batch: evidence first, then one transaction with the rows that name it.

Data that can never be written must not block the rest. A page is therefore checked before it is written, and if a
transaction fails for another reason than the disk, its pages are written one by one.
"""

from __future__ import annotations

from collections import Counter, deque
from typing import TYPE_CHECKING, Any

from sqlalchemy.exc import (
    DataError,
    DBAPIError,
    IntegrityError,
    InterfaceError,
    NotSupportedError,
    ProgrammingError,
)

from prooflight_line.journal import packs, rows
from prooflight_line.journal.arrays import check_arrays, packed
from prooflight_line.journal.queue import Batch

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from numpy.typing import NDArray
    from sqlalchemy import Engine

    from prooflight_line.journal.aside import Refusals

_OF_ROWS = (DataError, IntegrityError, InterfaceError, NotSupportedError, ProgrammingError)


def may_pass(error: Exception) -> bool:
    """Return whether a failed write may succeed later: the disk is full, the database is busy or damaged."""
    return isinstance(error, OSError) or (isinstance(error, DBAPIError) and not isinstance(error, _OF_ROWS))


def write(engine: Engine, folder: Path, batch: Batch, refused: Refusals) -> None:
    """Write a batch except what is refused; after an error that ``may_pass`` the batch can be tried again."""
    _sift(batch, refused)
    try:
        _write_whole(engine, folder, batch)
    except Exception as error:
        if may_pass(error):
            raise
        _write_in_pieces(engine, folder, batch, refused)


def _sift(batch: Batch, refused: Refusals) -> None:
    for run_id, page in list(batch.pages):
        try:
            rows.page_row(run_id, page)
        except Exception as error:
            refused.page(batch, run_id, page, error)
            continue
        try:
            check_arrays(page.evidence or {})
        except Exception as error:
            refused.without_evidence(batch, run_id, page, error)


def _write_in_pieces(engine: Engine, folder: Path, batch: Batch, refused: Refusals) -> None:
    for piece in _pieces(batch):
        error = _write_piece(engine, folder, piece)
        if error is not None and piece.pages and piece.pages[0][1].evidence:
            run_id, page = piece.pages[0]
            piece.pages[0] = run_id, refused.without_evidence(batch, run_id, page, error)
            error = _write_piece(engine, folder, piece)
        if error is None:
            continue
        if piece.pages:
            refused.page(batch, *piece.pages[0], error)
        else:
            refused.run([*piece.begun, *piece.ended], error)


def _write_piece(engine: Engine, folder: Path, piece: Batch) -> Exception | None:
    """Write a piece; return why it can never be written, None: it was."""
    try:
        _write_whole(engine, folder, piece)
    except Exception as error:
        if may_pass(error):
            raise
        return error
    return None


def _pieces(batch: Batch) -> Iterator[Batch]:
    """Yield pieces so small that each fails alone; counts come last, as a retry must not add them twice."""
    for run_id, facts in batch.begun.items():
        yield Batch(begun={run_id: facts})
    for page in list(batch.pages):
        yield Batch(pages=deque([page]))
    for run_id, end in batch.ended.items():
        yield Batch(ended={run_id: end})
    if batch.dropped_pages or batch.dropped_evidence:
        yield Batch(
            dropped_pages=Counter(batch.dropped_pages), dropped_evidence=Counter(batch.dropped_evidence)
        )


def _write_whole(engine: Engine, folder: Path, batch: Batch) -> None:
    """Write evidence, one pack a run, then rows; leave nothing of a batch that cannot be written."""
    of_runs: dict[int, dict[int, Mapping[str, NDArray[Any]]]] = {}
    for run_id, page in batch.pages:
        if page.evidence:
            of_runs.setdefault(run_id, {})[page.sheet] = packed(page.evidence)
    written = {}
    try:
        for run_id, pages in of_runs.items():
            file = packs.pack_name(run_id, min(pages))
            written[run_id] = (file, packs.write_pack(packs.inside(folder, file), pages))
        with engine.begin() as connection:
            rows.write_rows(connection, batch, written)
    except BaseException:
        for file, _ in written.values():
            (folder / file).unlink(missing_ok=True)
        raise

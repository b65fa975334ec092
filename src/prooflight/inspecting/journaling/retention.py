"""What is too old or too large goes, in small steps: rows first, then the files that they named."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sqlalchemy import delete, func, select, update

from prooflight.inspecting.journaling.records import SECONDS_A_DAY
from prooflight.inspecting.journaling.schema import packs_table, pages_table, runs_table

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from pathlib import Path

    from sqlalchemy import Connection, Engine

    from prooflight.inspecting.journaling.records import Retention

ROWS_A_STEP: Final = 5000
PACKS_A_STEP: Final = 100
FREED_PAGES_A_STEP: Final = 2000
"""Of the database's file, given back to the system."""


def tidy(engine: Engine, folder: Path, retention: Retention, *, now_s: float) -> Iterator[None]:
    """Removes runs that ended too long ago; then the oldest evidence, then the oldest runs, until the rest fits.

    Works when it is iterated over, one short transaction a step. The latest run stays: its number must not be given
    again, and it may be under way. OSError, DBAPIError.
    """
    for run_id in _ended(engine, before_s=now_s - retention.days * SECONDS_A_DAY):
        yield from _remove_run(engine, folder, run_id)
    while (too_many := used_bytes(engine) - retention.megabytes * 1e6) > 0:
        if _remove_packs(engine, folder, at_least=too_many):
            yield
        elif oldest := _ended(engine)[:1]:
            yield from _remove_run(engine, folder, oldest[0])
        else:
            break
    while _give_back(engine):
        yield


def _ended(engine: Engine, *, before_s: float | None = None) -> list[int]:
    """Runs but the latest, oldest first: those that ended, or never will because a later one began."""
    over = func.coalesce(runs_table.c.ended_s, runs_table.c.started_s)
    query = select(runs_table.c.id).where(
        runs_table.c.id < select(func.max(runs_table.c.id)).scalar_subquery()
    )
    if before_s is not None:
        query = query.where(over < before_s)
    with engine.begin() as connection:
        return list(connection.execute(query.order_by(runs_table.c.id)).scalars())


def _remove_run(engine: Engine, folder: Path, run_id: int) -> Iterator[None]:
    of_run = pages_table.c.run_id == run_id
    while True:
        with engine.begin() as connection:
            until = connection.execute(
                select(pages_table.c.sheet).where(of_run).order_by(pages_table.c.sheet).limit(ROWS_A_STEP)
            ).scalars()
            sheets = list(until)
            if not sheets:
                break
            connection.execute(delete(pages_table).where(of_run, pages_table.c.sheet <= sheets[-1]))
        yield
    with engine.begin() as connection:
        files = list(
            connection.execute(select(packs_table.c.file).where(packs_table.c.run_id == run_id)).scalars()
        )
        connection.execute(delete(packs_table).where(packs_table.c.run_id == run_id))
        connection.execute(delete(runs_table).where(runs_table.c.id == run_id))
    _unlink(folder, files)
    yield


def _remove_packs(engine: Engine, folder: Path, *, at_least: float) -> bool:
    """The oldest packs, whose pages stay without evidence; False: there are none."""
    query = select(packs_table.c.id, packs_table.c.file, packs_table.c.bytes).order_by(packs_table.c.id)
    with engine.begin() as connection:
        packs = []
        for pack in connection.execute(query.limit(PACKS_A_STEP)).all():
            packs.append(pack)
            at_least -= pack.bytes
            if at_least <= 0:
                break
        drop_packs(connection, [pack.id for pack in packs])
    _unlink(folder, [pack.file for pack in packs])
    return bool(packs)


def drop_packs(connection: Connection, ids: Sequence[int]) -> None:
    """No row names these packs any more."""
    connection.execute(update(pages_table).where(pages_table.c.pack_id.in_(ids)).values(pack_id=None))
    connection.execute(delete(packs_table).where(packs_table.c.id.in_(ids)))


def _unlink(folder: Path, files: Iterable[str]) -> None:
    for file in files:
        (folder / file).unlink(missing_ok=True)


def used_bytes(engine: Engine) -> int:
    """Of rows and evidence, without what the database's file holds free."""
    with engine.begin() as connection:
        of_packs = connection.execute(select(func.sum(packs_table.c.bytes))).scalar() or 0
        pages, free, size = (
            int(connection.exec_driver_sql(f"PRAGMA {name}").scalar_one())
            for name in ("page_count", "freelist_count", "page_size")
        )
    return int(of_packs) + (pages - free) * size


def _give_back(engine: Engine) -> bool:
    """Some of the database's free pages to the system; False: none are free."""
    with engine.begin() as connection:
        free = connection.exec_driver_sql("PRAGMA freelist_count").scalar_one()
        for _ in range(min(free, FREED_PAGES_A_STEP)):
            # Asked for many, SQLite frees one a step, and the driver takes but one step of what returns no rows.
            connection.exec_driver_sql("PRAGMA incremental_vacuum(1)")
    return bool(free)

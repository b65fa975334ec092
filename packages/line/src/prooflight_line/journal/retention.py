"""Retention: removal of what is too old or too large, in small steps, rows first, then the files that they named.

Only what a row of the journal names is ever removed. A row that is invalid removes nothing, and is reported.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import case, delete, func, select, update

from prooflight_line.journal import packs
from prooflight_line.journal.columns import MOST_PACK_BYTES, PackColumns, RunColumns, complaint
from prooflight_line.journal.labels import key_of
from prooflight_line.journal.records import SECONDS_A_DAY, Due
from prooflight_line.journal.retention_rules import ARRAYS, customers_of
from prooflight_line.journal.schema import (
    JournalError,
    packs_table,
    pages_table,
    runs_table,
    stored_packs,
    stored_runs,
)

if TYPE_CHECKING:
    from collections.abc import Collection, Generator, Iterable, Iterator, Sequence
    from pathlib import Path

    from sqlalchemy import Connection, Engine, Row

    from prooflight_line.journal.records import Retention, Tidied
    from prooflight_line.journal.retention_rules import Class

ROWS_A_STEP: Final = 5000
PACKS_A_STEP: Final = 100
EXAMINED_A_STEP: Final = 5000
FREED_PAGES_A_STEP: Final = 2000
"""Free pages of the database's file that are returned to the system in one step."""


def tidy(
    engine: Engine,
    folder: Path,
    retention: Retention,
    done: Tidied,
    *,
    now_s: float,
    on_hold: Collection[str] = (),
) -> Iterator[None]:
    """Remove what is ``due``; then the oldest evidence, then the oldest runs, until the rest fits.

    It works while it is iterated over, one short transaction a step; ``done`` accumulates the results. The latest
    run stays: its number must not be reused, and it may be under way. on_hold: keys of runs of which nothing is
    removed. OSError, DBAPIError.
    """
    for one in due(engine, folder, retention, done, now_s=now_s, on_hold=on_hold):
        if "verdicts" in one.classes:
            yield from _remove_run(engine, folder, one.run, done)
        else:
            yield from _thin_packs(engine, folder, one, done)
    if retention.megabytes < math.inf:
        yield from _make_fit(engine, folder, retention.megabytes * 1e6, done)
    while _give_back(engine):
        yield


def due(
    engine: Engine,
    folder: Path,
    retention: Retention,
    done: Tidied,
    *,
    now_s: float,
    on_hold: Collection[str] = (),
) -> list[Due]:
    """Return what is stored longer than ``retention`` asks for, oldest runs first; the limit of size is not counted.

    done: is given the runs on hold, and what cannot be read. OSError, DBAPIError.
    """
    done.on_hold = _ids(engine, on_hold)
    every = []
    for run in _ended(engine, done):
        days = (now_s - (run.started_s if run.ended_s is None else run.ended_s)) / SECONDS_A_DAY
        classes = retention.over(run.settings, days)
        sizes = [size for _, size in _packs_with(engine, folder, run.id, classes, done)] if classes else []
        if sizes or "verdicts" in classes:
            every.append(
                Due(
                    run=run.id,
                    job=run.job,
                    customers=customers_of(run.settings),
                    days=days,
                    classes=classes,
                    packs=len(sizes),
                    bytes=sum(sizes),
                )
            )
    return every


def _packs_with(
    engine: Engine, folder: Path, run_id: int, classes: Collection[Class], done: Tidied
) -> Iterator[tuple[Row[Any], int]]:
    """Yield the rows of a run's packs that have arrays of these classes, and the size of those; verdicts: of all."""
    with engine.begin() as connection:
        rows = connection.execute(select(stored_packs).where(stored_packs.c.run_id == run_id)).all()
    every, names = "verdicts" in classes, [ARRAYS[name] for name in classes if name in ARRAYS]
    for row in rows:
        # What cannot be removed with its verdicts is reported where it is removed.
        path, size = _file(folder, row, None if every else done)
        if path is not None and not every:
            try:
                size = packs.bytes_of(path, names)
            except FileNotFoundError:
                continue
            except ValueError as error:  # JournalError is one
                _refuse(done, f"evidence {row.id} stays: it is damaged ({complaint(error)})")
                continue
        if size:
            yield row, size


def _thin_packs(engine: Engine, folder: Path, one: Due, done: Tidied) -> Iterator[None]:
    """Write the packs of a run again without the arrays of some classes; their verdicts can still be repeated.

    A file is first written anew, then named by the row, then the former one is removed: whoever dies in between leaves
    a file that no row names.
    """
    for row, size in list(_packs_with(engine, folder, one.run, one.classes, done)):
        path = folder / row.file
        file = packs.pack_name(one.run, int(path.name.rpartition("-")[0]))
        try:
            left = packs.write_without(path, folder / file, [ARRAYS[name] for name in one.classes])
        except ValueError as error:
            _refuse(done, f"evidence {row.id} stays: it is damaged ({error})")
            continue
        with engine.begin() as connection:
            if left:
                own = packs_table.c.id == row.id
                connection.execute(update(packs_table).where(own).values(file=file, bytes=left))
            else:
                _drop_packs(connection, [row.id])
        packs.remove_pack(folder, row.file)
        done.thinned += 1
        done.pack_bytes += size
        yield


def _make_fit(engine: Engine, folder: Path, most_bytes: float, done: Tidied) -> Iterator[None]:
    evidence = yield from _evidence_bytes(engine, folder)
    removed_before, after = done.pack_bytes, 0
    while (too_many := _row_bytes(engine) + evidence - (done.pack_bytes - removed_before) - most_bytes) > 0:
        last = _remove_packs(engine, folder, done, after=after, at_least=too_many)
        if last is not None:
            after = last
            yield
        elif oldest := _ended(engine, done)[:1]:
            yield from _remove_run(engine, folder, oldest[0].id, done)
        else:
            break


def _ended(engine: Engine, done: Tidied) -> list[RunColumns]:
    """Return all runs but the latest, oldest first: those that ended, or never will because a later one began."""
    number = stored_runs.c.id
    query = select(stored_runs).where(
        number < select(func.max(number)).scalar_subquery(), number.not_in(done.on_hold)
    )
    runs = []
    with engine.begin() as connection:
        for row in connection.execute(query.order_by(stored_runs.c.id)):
            try:
                runs.append(RunColumns(**row._asdict()))
            except ValueError as error:
                _refuse(done, f"run {row.id} stays: its row is damaged ({complaint(error)})")
    return runs


def _ids(engine: Engine, keys: Collection[str]) -> list[int]:
    """Return the numbers of the runs with these keys; a key of another journal's run has none."""
    wanted, run = set(keys), stored_runs.c
    numbers = [int(key.partition("@")[0]) for key in wanted if key.partition("@")[0].isdecimal()]
    with engine.begin() as connection:
        rows = connection.execute(select(run.id, run.started_s).where(run.id.in_(numbers))).all()
    # A start that is no number may be that of any key: the run stays.
    return sorted(
        row.id
        for row in rows
        if not isinstance(row.started_s, int | float) or key_of(row.id, row.started_s) in wanted
    )


def _remove_run(engine: Engine, folder: Path, run_id: int, done: Tidied) -> Iterator[None]:
    of_run = pages_table.c.run_id == run_id
    while True:
        with engine.begin() as connection:
            until = connection.execute(
                select(pages_table.c.sheet).where(of_run).order_by(pages_table.c.sheet).limit(ROWS_A_STEP)
            ).scalars()
            sheets = list(until)
            if not sheets:
                break
            deleted = connection.execute(delete(pages_table).where(of_run, pages_table.c.sheet <= sheets[-1]))
        if not deleted.rowcount:
            _refuse(done, f"run {run_id} stays: its pages cannot be removed, the journal is damaged")
            return
        yield
    with engine.begin() as connection:
        named = connection.execute(select(stored_packs).where(stored_packs.c.run_id == run_id)).all()
        _drop_packs(connection, [pack.id for pack in named])
        connection.execute(delete(runs_table).where(runs_table.c.id == run_id))
    done.runs.append(run_id)
    _remove_files(folder, named, done)
    yield


def _remove_packs(engine: Engine, folder: Path, done: Tidied, *, after: int, at_least: float) -> int | None:
    """Remove the oldest packs; their pages stay. Return the last one examined, None: there are none."""
    pack = stored_packs.c
    removed = (pack.id > after) & pack.run_id.not_in(done.on_hold)
    query = select(stored_packs).where(removed).order_by(pack.id).limit(PACKS_A_STEP)
    with engine.begin() as connection:
        examined, removable = None, []
        for row in connection.execute(query).all():
            examined = row.id
            if not (size := _file(folder, row, done)[1]):
                continue
            removable.append(row)
            at_least -= size
            if at_least <= 0:
                break
        _drop_packs(connection, [row.id for row in removable])
    _remove_files(folder, removable, done)
    return examined


def _drop_packs(connection: Connection, ids: Sequence[int]) -> None:
    """Remove all references of rows to these packs."""
    for first in range(0, len(ids), ROWS_A_STEP):
        some = ids[first : first + ROWS_A_STEP]
        connection.execute(update(pages_table).where(pages_table.c.pack_id.in_(some)).values(pack_id=None))
        connection.execute(delete(packs_table).where(packs_table.c.id.in_(some)))


def _remove_files(folder: Path, named: Iterable[Row[Any]], done: Tidied) -> None:
    for row in named:
        try:
            size = packs.remove_pack(folder, PackColumns(**row._asdict()).file)
        except JournalError as error:
            _refuse(done, f"{error.where} stays: it {error.what}")
        except ValueError as error:
            _refuse(done, f"evidence {row.id} stays: its row is damaged ({complaint(error)})")
        else:
            done.packs += bool(size)
            done.pack_bytes += size


def _file(folder: Path, row: Row[Any], done: Tidied | None = None) -> tuple[Path | None, int]:
    """Return a row's file and the bytes that removing it would free; None and 0: there is none that may be removed."""
    try:
        path = packs.inside(folder, PackColumns(**row._asdict()).file)
        return path, path.lstat().st_size
    except FileNotFoundError:
        return None, 0
    except ValueError as error:  # JournalError is one
        if done is not None:
            problem = (
                error.what if isinstance(error, JournalError) else f"its row is damaged ({complaint(error)})"
            )
            _refuse(done, f"evidence {row.id} stays: {problem}")
        return None, 0


def _evidence_bytes(engine: Engine, folder: Path) -> Generator[None, None, int]:
    """Return the bytes that removing all evidence would free, by the files, since rows may be damaged."""
    total = after = 0
    pack = stored_packs.c
    while True:
        query = select(stored_packs).where(pack.id > after).order_by(pack.id).limit(EXAMINED_A_STEP)
        with engine.connect() as connection:
            batch = connection.execute(query).all()
        if not batch:
            return total
        total += sum(_file(folder, row)[1] for row in batch)
        after = batch[-1].id
        yield


def _refuse(done: Tidied, line: str) -> None:
    if line not in done.refused:
        done.refused.append(line)


def used_bytes(engine: Engine) -> int:
    """Return the size of rows and evidence, without free pages of the database's file."""
    size = stored_packs.c.bytes
    believed = case((size.between(0, MOST_PACK_BYTES), size), else_=0)
    with engine.begin() as connection:
        of_packs = connection.execute(
            select(func.sum(believed)).where(func.typeof(size) == "integer")
        ).scalar()
    return int(of_packs or 0) + _row_bytes(engine)


def _row_bytes(engine: Engine) -> int:
    with engine.begin() as connection:
        pages, free, size = (
            int(connection.exec_driver_sql(f"PRAGMA {name}").scalar_one())
            for name in ("page_count", "freelist_count", "page_size")
        )
    return (pages - free) * size


def _give_back(engine: Engine) -> bool:
    """Return some free pages of the database to the system; False: none are free."""
    with engine.begin() as connection:
        free = connection.exec_driver_sql("PRAGMA freelist_count").scalar_one()
        for _ in range(min(free, FREED_PAGES_A_STEP)):
            # Asked for many, SQLite frees one a step, and the driver takes but one step of what returns no rows.
            connection.exec_driver_sql("PRAGMA incremental_vacuum(1)")
        left = connection.exec_driver_sql("PRAGMA freelist_count").scalar_one()
    return bool(left < free)

"""What a worker of the cluster does: it is asked for a piece of work, and says which parcels it lacks for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from distributed import get_worker
from llvmlite import binding  # type: ignore[import-untyped]

from prooflight.cluster.parcels import FileAt, Piece, store_piece, unpacked
from prooflight.errors import RequestError
from prooflight.files.program import program_parts
from prooflight.pages.parallel import settle_worker


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """Work on one item."""

    program: Mapping[str, str]
    """``program_parts`` of the head."""
    packages: tuple[str, ...]
    """Packages of which ``program`` consists."""
    work: str
    """Digest of the pickled work."""
    work_files: tuple[FileAt, ...]
    item: bytes
    item_files: tuple[FileAt, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Lacking:
    """Answer of a worker that lacks parcels of an order, and did nothing."""

    address: str
    worker_id: str
    """Id of the worker process: one that was restarted at the same address lacks everything."""
    digests: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    """Answer of a worker that did an order."""

    result: Any


def run(order: Order) -> Lacking | Done:
    """Do an order, or name the parcels that it needs; whatever the work raises is raised.

    RequestError: this worker's program is not the head's.
    """
    worker = get_worker()
    refuse_other_program(worker.address, program_parts(*order.packages), order.program)
    folder = _folder(worker)
    local = {file.digest: file.local(folder) for file in (*order.work_files, *order.item_files)}
    lacking = [digest for digest, path in local.items() if path is None]
    pickled = folder / order.work / order.work
    if not pickled.exists():
        lacking.append(order.work)
    if lacking:
        return Lacking(address=worker.address, worker_id=worker.id, digests=tuple(lacking))
    there = {digest: path for digest, path in local.items() if path is not None}
    work = _work(pickled, tuple(there[file.digest] for file in order.work_files), order.work_files)
    return Done(result=work(unpacked(order.item, there)))


def refuse_other_program(worker: str, own: Mapping[str, str], head: Mapping[str, str]) -> None:
    """Raise RequestError if a worker's program differs from the head's: its results could differ as well."""
    for name, wanted in head.items():
        if own.get(name, "") != wanted:
            what = f"has {name} {own.get(name) or 'not at all'}, and this machine {wanted or 'not at all'}"
            remedy = "install the same versions of Prooflight and its libraries on all machines"
            raise RequestError(f"worker {worker}", what, remedy=remedy)


def receive(piece: Piece, dask_worker: Any = None) -> str:
    """Store a piece of a parcel; return why it cannot be stored, or "". Dask gives the worker."""
    try:
        store_piece(piece, _folder(dask_worker))
    except OSError as error:
        return str(error)
    return ""


def describe(packages: tuple[str, ...]) -> tuple[dict[str, str], str]:
    """Return this process's ``program_parts``, and the processor that its kernels are compiled for."""
    return program_parts(*packages), str(binding.get_host_cpu_name())


def _folder(worker: Any) -> Path:
    """Return the folder of this worker process's parcels; Dask removes it when the worker ends."""
    return Path(worker.local_directory) / "prooflight" / worker.id


@lru_cache(maxsize=2)
def _work(pickled: Path, paths: tuple[Path, ...], files: tuple[FileAt, ...]) -> Any:
    """Load work once; the process is settled for it."""
    local = {file.digest: path for file, path in zip(files, paths, strict=True)}
    work = unpacked(pickled.read_bytes(), local)
    settle_worker(work)
    return work

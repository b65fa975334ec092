"""Store of prepared designs: prepared once for a job on a press, and read by every later run of both.

One file a design, in a folder whose name is a digest of job, press and program: whatever else could change a
prepared design changes that name. A file states the digest of its content; one that is damaged is removed, and
its design is prepared again. What the press already holds (its sensors, its detector) is not stored.
"""

from __future__ import annotations

import hashlib
import io
import logging
import mmap
import os
import pickle
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, is_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from prooflight.detectors.optional import StoresPages
from prooflight.files.atomic import whole_file
from prooflight.files.content import content_digest
from prooflight.files.program import READING, installed_version, program_digest
from prooflight.files.user_folders import user_folder
from prooflight.inspection.packed_design import PackedDesign
from prooflight.prediction.tables import SensorModel

if TYPE_CHECKING:
    from prooflight.inspection.inspector import Inspector, Prepared
    from prooflight.pages.job import JobSource

_log = logging.getLogger(__name__)

MAGIC: Final = b"prooflight prepared design 2\n\0\0\0"
HEAD_BYTES: Final = len(MAGIC) + 32
"""What precedes the content of a file: the magic, and the content's SHA-256."""
ALIGNED: Final = 64
"""Arrays begin at multiples of it, as processors read them fastest. [bytes]"""
MOST_BYTES: Final = 10_000_000_000
"""Size of all prepared jobs of a user; assumed: some 300 to 5,000 designs."""
OF_NUMBERS: Final = "numbers"
"""Kind of a reference to a type of numbers, by its name in numpy's array interface."""
OF_NUMPY: Final = frozenset(
    {
        ("numpy", "dtype"),
        ("numpy", "ndarray"),
        ("numpy._core.numeric", "_frombuffer"),
        ("numpy._core.multiarray", "_reconstruct"),
        ("numpy._core.multiarray", "scalar"),
    }
)
"""What is read besides the program's own classes."""


def mapped_file(path: Path) -> mmap.mmap:
    """Map a file for kernels, which take arrays that can be written; what nobody writes, processes share.

    OSError: it cannot be read.
    """
    with path.open("rb") as file:
        return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY)


@dataclass(frozen=True, slots=True, kw_only=True)
class PreparedStore:
    """Prepared designs of one job on one press."""

    folder: Path
    """Folder of this job, within that of all jobs."""
    inspector: Inspector

    @classmethod
    def of(cls, inspector: Inspector, job: JobSource, *, folder: Path | None = None) -> Self | None:
        """Return the store of a job; None if nothing can be stored.

        That is so of pages with zones, of a detector that does not store pages, and of a press whose own RIP draws,
        since nothing here tells its versions apart.

        folder: of all jobs; None: in the user's cache.
        """
        if not isinstance(inspector.detector, StoresPages) or inspector.zones is not None:
            return None
        if job.engine is not None and job.engine.program:
            return None
        parts = [
            program_digest(),
            program_digest("prooflight_line"),
            *(f"{name} {installed_version(name)}" for name in READING),
            inspector.press.digest,
            inspector.detector.name,
            content_digest(job.path),
            "" if job.profile is None else content_digest(job.profile),
            repr((job.dpi, job.drawn_dpi, job.layout, *job.spots)),
        ]
        name = hashlib.sha256("\n".join(parts).encode()).hexdigest()
        return cls(folder=(folder or prepared_folder()) / name, inspector=inspector)

    def load(self, design: int) -> PackedDesign | None:
        """Return a design as it was prepared; None if it was not, or if its file cannot be used."""
        path = self.path(design)
        try:
            ready = self.decoded(_checked(memoryview(mapped_file(path))))
            os.utime(self.folder)  # by which the least recently used job is found
        except FileNotFoundError:
            return None
        except Exception as error:  # pickle raises whatever the bytes make it raise
            _log.warning("%s cannot be used (%s); the design is prepared again", path, error)
            path.unlink(missing_ok=True)
            return None
        return ready

    def prepared(self, number: int) -> Prepared | None:
        """See ``inspection.job.StoredDesigns``."""
        packed = self.load(number)
        return None if packed is None else packed.unpacked()

    def save(self, design: int, packed: PackedDesign) -> None:
        """Store a prepared design, whole or not at all; OSError: it cannot be written."""
        with whole_file(self.path(design)) as unfinished, unfinished.open("wb") as file:
            file.writelines(self._content(packed))

    def content(self, packed: PackedDesign) -> bytes:
        """Return the file of a prepared design, which ``put`` stores on another machine."""
        return b"".join(self._content(packed))

    def put(self, design: int, content: bytes) -> None:
        """Store what ``content`` returned; OSError: it cannot be written. ValueError: it was damaged on the way."""
        _checked(memoryview(content))
        with whole_file(self.path(design)) as unfinished:
            unfinished.write_bytes(content)

    def holds(self, design: int) -> bool:
        """Return whether a design is stored, by the length of its file alone: a job may have 100,000 of them.

        A file that is damaged inside is found when it is loaded.
        """
        try:
            with self.path(design).open("rb") as file:
                data = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
            last = _places(data[HEAD_BYTES:])[-1][1]
            return bytes(data[: len(MAGIC)]) == MAGIC and HEAD_BYTES + -(-last // ALIGNED) * ALIGNED == len(
                data
            )
        except (OSError, ValueError, IndexError):  # IndexError: it ends before the number of its pieces
            return False

    @property
    def _detector(self) -> StoresPages:
        detector = self.inspector.detector
        assert isinstance(detector, StoresPages)  # see ``of``
        return detector

    def path(self, design: int) -> Path:
        """Return the file of a design, whether or not it is there."""
        return self.folder / f"{design:06d}.design"

    def _content(self, packed: PackedDesign) -> list[bytes | memoryview]:
        pieces, digest = self.encoded(packed), hashlib.sha256()
        for piece in pieces:
            digest.update(piece)
        return [MAGIC, digest.digest(), *pieces]

    def encoded(self, packed: PackedDesign) -> list[bytes | memoryview]:
        """Return a design in pieces, for ``decoded`` by an inspector on the same press."""
        file, arrays = io.BytesIO(), list[bytes | memoryview]()
        stored, shared = self._detector.stored(packed.bare.prepared_page)
        bare: Any = replace(packed.bare, prepared_page=None)  # type: ignore[arg-type] # it is restored
        pickler = _Pickler(file, {**shared, "own": self.inspector.detector.press_context.sensors}, arrays)
        pickler.dump((bare, stored, packed.arrays, packed.additional))
        pieces = [file.getvalue(), *arrays]
        sizes = np.array([len(pieces), *map(_size, pieces)], "<u8").tobytes()
        return [part for one in (sizes, *pieces) for part in (one, bytes(-_size(one) % ALIGNED))]

    def decoded(self, content: memoryview) -> PackedDesign:
        """Return the design in the joined pieces; its arrays stay there."""
        pieces = [content[begin:end] for begin, end in _places(content)]
        parts = {**self._detector.shared_sensors(), "own": self.inspector.detector.press_context.sensors}
        package = type(self.inspector.detector).__module__.partition(".")[0]
        unpickler = _Unpickler(io.BytesIO(pieces[0]), parts, pieces[1:], package)
        bare, stored, arrays, additional = unpickler.load()
        page = self._detector.restored(stored)
        return PackedDesign(bare=replace(bare, prepared_page=page), arrays=arrays, additional=additional)


def _checked(data: memoryview) -> memoryview:
    """Return what a file holds after its digest; ValueError: the digest does not match."""
    content = data[HEAD_BYTES:]
    if bytes(data[:HEAD_BYTES]) != MAGIC + hashlib.sha256(content).digest():
        raise ValueError("its digest does not match its content")
    return content


def _places(content: memoryview) -> list[tuple[int, int]]:
    """Return where each piece of a file's content begins and ends; ValueError: the content ends before it says so."""
    count = int(np.frombuffer(content[:8], "<u8")[0])
    sizes = np.frombuffer(content[8 : 8 + 8 * count], "<u8").astype(np.int64)
    room = -(-np.array([8 + 8 * count, *sizes]) // ALIGNED) * ALIGNED
    begins = np.cumsum(room)[:-1].tolist()
    return [(begin, begin + size) for begin, size in zip(begins, sizes.tolist(), strict=True)]


def _size(piece: bytes | memoryview) -> int:
    return memoryview(piece).nbytes


def prepared_folder() -> Path:
    """Return the folder of prepared jobs in the user's cache."""
    return user_folder("cache") / "prepared"


def clean(folder: Path, *, most_bytes: int, keep: Path | None = None) -> int:
    """Remove the least recently used jobs until the others take at most ``most_bytes``; return what they take.

    keep: a job that stays.
    """
    if not folder.is_dir():
        return 0
    jobs = sorted((one for one in folder.iterdir() if one.is_dir()), key=lambda one: one.stat().st_mtime)
    sizes = {job: sum(file.stat().st_size for file in job.iterdir()) for job in jobs}
    total = sum(sizes.values())
    for job in jobs:
        if total > most_bytes and job != keep:
            shutil.rmtree(job, ignore_errors=True)
            total -= sizes[job]
    return total


class _Pickler(pickle.Pickler):
    """Writes a design without what its press holds, and large arrays apart."""

    def __init__(
        self, file: io.BytesIO, shared: Mapping[str, Sequence[SensorModel]], arrays: list[bytes | memoryview]
    ) -> None:
        super().__init__(file, protocol=5, buffer_callback=lambda one: arrays.append(one.raw()))
        self._shared = {id(one): (kind, at) for kind, each in shared.items() for at, one in enumerate(each)}

    def persistent_id(self, one: Any) -> tuple[str, int | str] | None:
        """Return which of the press's parts an object is, or which type of numbers; None: neither.

        Types of numbers that came from another process are objects of their own, so that the same design would be
        other bytes there.
        """
        if isinstance(one, np.dtype) and one.names is None:
            return OF_NUMBERS, one.str
        if id(one) in self._shared:
            return self._shared[id(one)]
        if isinstance(one, SensorModel):
            raise TypeError("a sensor that the press does not hold")
        return None


class _Unpickler(pickle.Unpickler):
    """Reads designs, and makes no other objects than a design consists of."""

    def __init__(
        self,
        file: io.BytesIO,
        parts: Mapping[str, Sequence[SensorModel]],
        arrays: list[memoryview],
        package: str,
    ) -> None:
        super().__init__(file, buffers=arrays)
        self._parts, self._packages = parts, {"prooflight", package}

    def persistent_load(self, name: Any) -> SensorModel | np.dtype[Any]:
        """Return a part of the press, or a type of numbers; UnpicklingError: it is a type of objects."""
        kind, index = name
        if kind == OF_NUMBERS:
            numbers = np.dtype(str(index))
            if numbers.hasobject:
                raise pickle.UnpicklingError("objects are not part of a design")
            return numbers
        return self._parts[kind][index]

    def find_class(self, module: str, name: str) -> Any:
        """Return a class of which designs consist; UnpicklingError: it is no such class."""
        if (module, name) in OF_NUMPY:
            return super().find_class(module, name)
        if module.partition(".")[0] in self._packages:
            loaded = super().find_class(module, name)
            if isinstance(loaded, type) and (is_dataclass(loaded) or issubclass(loaded, tuple)):
                return loaded
        raise pickle.UnpicklingError(f"{module}.{name} is not part of a design")

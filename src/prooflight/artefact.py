"""Files of named arrays with a few texts (safetensors), read within bounds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from safetensors import SafetensorError, safe_open

from prooflight.files.schema import Misfit

if TYPE_CHECKING:
    from numpy.typing import NDArray

MOST_BYTES: Final = 1 << 30
"""Greatest size of a file; assumed: a press's tables take 10 MiB a sensor, the forests of a large study some
hundred."""
MOST_HEADER_BYTES: Final = 8 << 20
"""Greatest size of names, shapes and texts, which are read before anything else is checked."""
KINDS: Final = frozenset({"F64", "F32", "I64", "I32", "I16", "I8", "U64", "U32", "U16", "U8"})
"""Types of numbers that NumPy has as well."""


class Damaged(Exception):
    """Raised for a file of another format, or one that is truncated or longer than its header states."""


class Tensors:
    """An open file whose texts are read at once, and its arrays on request."""

    def __init__(self, path: Path) -> None:
        """Open a file; Damaged: it has another format. Misfit: it is larger than any of the project's."""
        size = path.stat().st_size
        if size > MOST_BYTES:
            raise Misfit("file", f"is {size >> 20} MiB large, must be at most {MOST_BYTES >> 20}")
        with path.open("rb") as file:
            header = int.from_bytes(file.read(8), "little")
        if not 0 < header <= min(MOST_HEADER_BYTES, size - 8):
            raise Damaged
        try:
            with safe_open(path, framework="numpy") as file:
                self.texts: dict[str, str] = dict(file.metadata() or {})
        except (SafetensorError, ValueError) as error:
            raise Damaged from error
        self._path = path

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return all arrays by name; they take no more memory than the file. Damaged, Misfit: as above."""
        tensors: dict[str, NDArray[Any]] = {}
        try:
            with safe_open(self._path, framework="numpy") as file:
                for name in file.keys():  # noqa: SIM118 - not a dict
                    if (kind := file.get_slice(name).get_dtype()) not in KINDS:
                        raise Misfit(name, f"is of type {kind}, which is not supported")
                    tensors[name] = file.get_tensor(name)
        except (SafetensorError, OverflowError, TypeError) as error:
            raise Damaged from error
        return tensors

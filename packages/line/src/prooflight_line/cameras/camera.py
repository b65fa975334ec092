"""Interface of cameras, whatever their maker and library.

A backend finds cameras and opens them; an open camera reports its features and returns blocks as they came
over the wire, with what did not arrive. ``counting`` turns these into lines, and ``source`` into an endless
source that survives the camera. A new backend is one module with these two classes: see ``aravis``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, Protocol

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

FeatureKind = Literal["integer", "float", "boolean", "enumeration", "string", "command", "other"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraInfo:
    """A camera that answered."""

    id: str
    """Identifier by which it is opened again: maker, model and serial number."""
    maker: str
    model: str
    serial: str
    address: str
    backend: str

    @property
    def names(self) -> tuple[str, ...]:
        """Names by which a user may call it."""
        return self.id, self.serial, self.address


@dataclass(frozen=True, slots=True, kw_only=True)
class Feature:
    """One feature of a camera, by its own description."""

    name: str
    kind: FeatureKind
    value: str = ""
    """Current value; empty if it cannot be read now."""
    choices: tuple[str, ...] = ()
    """Values that an enumeration accepts now."""
    least: float | None = None
    greatest: float | None = None
    writable: bool = True
    category: str = ""
    """Category under which the description lists it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grab:
    """One block as it came over the wire."""

    block_id: int
    """Number of the block by the camera."""
    id_wraps: bool
    """Whether that number has 16 bits and wraps around."""
    data: NDArray[np.uint8]
    """Payload, (bytes,), valid until the next block is requested."""
    missing: tuple[tuple[int, int], ...]
    """First byte, and the one after the last, of each part of the payload that did not arrive."""
    pixel_format: str
    lines: int
    pixels: int
    padding: int
    """Bytes after each line that are no pixels."""
    time_s: float
    """Time at which its last line was read, by the clock of ``time.monotonic``: about when its last byte
    arrived."""
    triggers: int | None = None
    """Line triggers that the camera had seen by its last line, taken or not; None if it does not report them.
    The counter may have 16 or 32 bits and wrap around."""
    encoder: int | None = None
    """Steps that the encoder had made by then, likewise."""
    chunks: Mapping[str, int] = field(default_factory=dict)
    """Values that the camera sent with it, by name: frame ID, timestamp and counts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """Condition of a camera and of its connection."""

    lines: int = 0
    lines_lost: int = 0
    lines_per_s: float = 0.0
    blocks: int = 0
    blocks_broken: int = 0
    """Blocks received with a part missing."""
    resends: int = 0
    """Packets that were requested again, by the backend's count."""
    buffers_free: int = 0
    """Buffers that wait to be filled; with none left, blocks are lost. 0 as well where the library does not
    report it."""
    temperature_c: float | None = None
    """Temperature, or None if the camera has no such feature."""
    away: int = 0
    """Number of times that the camera has been disconnected."""
    present: bool = True
    """Whether it is open; false while it is disconnected."""


class Camera(Protocol):
    """An open camera, which this program alone may control."""

    @property
    def info(self) -> CameraInfo:
        """Identity of the camera."""
        ...

    def features(self) -> Mapping[str, Feature]:
        """Return all features of its own description, by name, in the description's order."""
        ...

    def feature(self, name: str) -> Feature | None:
        """Return one feature with its current value; None if the camera has none of that name."""
        ...

    def set(self, name: str, value: str) -> None:
        """Set a feature, or run a command; RequestError: the camera has none of that name, or refuses the value."""
        ...

    def start(self) -> None:
        """Start acquisition; ScanError: the camera cannot."""
        ...

    def grab(self, timeout_s: float) -> Grab | None:
        """Return the next block, or None if none came in time.

        ScanError: the camera is disconnected or controlled by another program. The call must not wait for
        other requests to the camera, which take seconds where it does not answer.
        """
        ...

    def health(self) -> Health:
        """Return what the backend knows of the camera's health; other fields keep their defaults."""
        ...

    def close(self) -> None:
        """Release the camera, so that other programs may control it. May be called more than once."""
        ...


class Backend(Protocol):
    """A library that controls cameras."""

    @property
    def name(self) -> str:
        """Name by which users choose it."""
        ...

    @property
    def lacks(self) -> str:
        """Why it cannot be used here, and what would help; empty if it can."""
        ...

    def find(self) -> list[CameraInfo]:
        """Return the cameras that answer now; takes about a second."""
        ...

    def open(self, camera: CameraInfo) -> Camera:
        """Take control of a camera; ScanError: it does not answer, or another program controls it."""
        ...

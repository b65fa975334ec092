"""What a camera is, whoever made it and whichever library talks to it.

A backend finds cameras and opens them; an open camera says what it can do and hands out blocks as they came over the
wire, with what did not come. ``counting`` makes lines of these, and ``source`` an endless source that survives the
camera. A new backend is one module with these two classes: see ``aravis``.
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
class FoundCamera:
    """A camera that answered."""

    id: str
    """By which it is opened again: maker, model and serial number."""
    maker: str
    model: str
    serial: str
    address: str
    backend: str

    @property
    def names(self) -> tuple[str, ...]:
        """What a user may call it."""
        return self.id, self.serial, self.address


@dataclass(frozen=True, slots=True, kw_only=True)
class Feature:
    """One thing that a camera can be told or asked, by its own description."""

    name: str
    kind: FeatureKind
    value: str = ""
    """As it stands; empty: it cannot be read now."""
    choices: tuple[str, ...] = ()
    """Of an enumeration: what it takes now."""
    least: float | None = None
    greatest: float | None = None
    writable: bool = True
    category: str = ""
    """Under which the description lists it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grab:
    """One block as it came over the wire."""

    block_id: int
    """The camera's own number of it."""
    id_wraps: bool
    """Whether that number has 16 bits and begins again."""
    data: NDArray[np.uint8]
    """(bytes,) its payload, the receiver's to keep until the next is asked for."""
    missing: tuple[tuple[int, int], ...]
    """First and behind the last of the payload's bytes that did not arrive."""
    pixel_format: str
    lines: int
    pixels: int
    padding: int
    """Bytes behind each line that are no pixels."""
    time_s: float
    """When its last line was read, by the clock of ``time.monotonic``; about: when its last byte arrived."""
    triggers: int | None = None
    """Line triggers that the camera had seen by its last line, taken or not; None: it does not say. It may have 16 or
    32 bits and begin again."""
    encoder: int | None = None
    """Steps that the encoder had made by then, alike."""
    chunks: Mapping[str, int] = field(default_factory=dict)
    """What the camera sent with it, by name: frame ID, timestamp and counts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """How a camera and the way from it are."""

    lines: int = 0
    """That have come."""
    lines_lost: int = 0
    lines_per_s: float = 0.0
    blocks: int = 0
    blocks_broken: int = 0
    """That came with a part missing."""
    resends: int = 0
    """Packets that were asked for again, by the backend's count."""
    buffers_free: int = 0
    """Buffers that wait to be filled; none left: blocks are lost. 0 as well where the library does not say."""
    temperature_c: float | None = None
    """None: the camera has no such feature."""
    away: int = 0
    """How often the camera has been away."""
    present: bool = True
    """Whether it is open; not while it is away."""


class Camera(Protocol):
    """A camera that is open: this program alone may control it."""

    @property
    def found(self) -> FoundCamera:
        """Which it is."""
        ...

    def features(self) -> Mapping[str, Feature]:
        """All that its own description has, by name, in the description's order."""
        ...

    def feature(self, name: str) -> Feature | None:
        """One of them as it stands now; None: the camera has none of that name."""
        ...

    def set(self, name: str, value: str) -> None:
        """Set a feature, or run a command; RequestError: the camera has none such, or does not take that."""
        ...

    def start(self) -> None:
        """Begin to read lines; ScanError: it cannot."""
        ...

    def grab(self, timeout_s: float) -> Grab | None:
        """The next block; None: none came in that time. ScanError: the camera is gone, or not this program's any more.

        It must not wait for what else is asked of the camera, which takes seconds where it does not answer.
        """
        ...

    def health(self) -> Health:
        """What the backend itself knows of it; the rest is left as it is by default."""
        ...

    def close(self) -> None:
        """Let go of it, so that others may control it. May be called more than once."""
        ...


class Backend(Protocol):
    """A library that talks to cameras."""

    @property
    def name(self) -> str:
        """By which users ask for it."""
        ...

    @property
    def lacks(self) -> str:
        """Why it cannot be used here, and what would help; empty: it can."""
        ...

    def find(self) -> list[FoundCamera]:
        """Cameras that answer now; takes about a second."""
        ...

    def open(self, camera: FoundCamera) -> Camera:
        """Take control of one; ScanError: it does not answer, or another program controls it."""
        ...

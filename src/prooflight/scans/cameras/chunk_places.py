"""Where in a block's chunks a camera's numbers lie, by its own description, so that no block waits for the camera.

A GenICam description (standard 2.1.1, 2.8.16) has a port for every chunk, with its ID, and for every number in it a
register, at an offset from the chunk's first byte or, below nought, from behind its last.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal, Self
from xml.etree import ElementTree

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

MOST_STEPS: Final = 8
"""From a number to its register; a description that leads further leads in a circle."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChunkPlace:
    """A whole number's place within one chunk."""

    chunk_id: int
    first: int
    """Byte; below 0: from behind the last."""
    length: int
    """Bytes."""
    order: Literal["little", "big"]
    signed: bool

    def read(self, chunks: Mapping[int, bytes]) -> int | None:
        """The number, from a block's chunks by ID; None: the block has no such chunk, or a shorter one."""
        data = chunks.get(self.chunk_id, b"")
        first = self.first + (len(data) if self.first < 0 else 0)
        if first < 0 or first + self.length > len(data):
            return None
        return int.from_bytes(data[first : first + self.length], self.order, signed=self.signed)

    @classmethod
    def of(cls, register: Mapping[str, str], port: Mapping[str, str]) -> Self | None:
        """Of a register and its port, by the names of their parts; None: it is no plain whole number of a chunk."""
        try:
            return cls(
                chunk_id=int(port["ChunkID"], 16),
                first=int(register["Address"], 0),
                length=int(register["Length"], 0),
                order="big" if register.get(_ORDER) == "BigEndian" else "little",
                signed=register.get("Sign") == "Signed",
            )
        except (KeyError, ValueError):
            return None


_ORDER: Final = "Endianess"  # codespell:ignore endianess


def chunk_places(description: str, names: Iterable[str]) -> dict[str, ChunkPlace]:
    """Places of those names that are plain whole numbers in chunks, by a camera's description (XML).

    Not there: names that the camera has not, and numbers that it reckons from others.
    """
    nodes = {
        name: node
        for node in ElementTree.fromstring(description).iter()
        if (name := node.get("Name")) and _kind(node) in ("Integer", "IntReg", "Port")
    }
    found = {}
    for name in names:
        place = _place(nodes, name)
        if place is not None:
            found[name] = place
    return found


def _place(nodes: Mapping[str, ElementTree.Element], name: str) -> ChunkPlace | None:
    for _ in range(MOST_STEPS):
        node = nodes.get(name)
        if node is None:
            return None
        parts = _parts(node)
        if _kind(node) == "IntReg":
            port = nodes.get(parts.get("pPort", ""))
            return None if port is None else ChunkPlace.of(parts, _parts(port))
        name = parts.get("pValue", "")
    return None


def _parts(node: ElementTree.Element) -> dict[str, str]:
    return {_kind(part): (part.text or "").strip() for part in node}


def _kind(node: ElementTree.Element) -> str:
    """Its name without the description's own namespace."""
    return node.tag.rpartition("}")[2]

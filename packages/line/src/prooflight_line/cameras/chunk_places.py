"""Positions of a camera's numbers in a block's chunks, by its own description, so that no block waits for the camera.

A GenICam description (standard 2.1.1, 2.8.16) has a port for every chunk, with its ID, and for every number
in it a register, at an offset from the chunk's first byte or, if negative, from its end.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal, Self
from xml.etree import ElementTree

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

MOST_STEPS: Final = 8
"""Greatest number of references from a number to its register; a longer chain must be a cycle."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChunkPlace:
    """Position of an integer within one chunk."""

    chunk_id: int
    first: int
    """Offset of its first byte; if negative, from the chunk's end."""
    length: int
    """Length in bytes."""
    order: Literal["little", "big"]
    signed: bool

    def read(self, chunks: Mapping[int, bytes]) -> int | None:
        """Return the number from a block's chunks by ID; None if the block has no such chunk, or a shorter one."""
        data = chunks.get(self.chunk_id, b"")
        first = self.first + (len(data) if self.first < 0 else 0)
        if first < 0 or first + self.length > len(data):
            return None
        return int.from_bytes(data[first : first + self.length], self.order, signed=self.signed)

    @classmethod
    def of(cls, register: Mapping[str, str], port: Mapping[str, str]) -> Self | None:
        """Return the position of a register and its port, by their parts; None if it is no integer of a chunk."""
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
    """Return the positions of those names that are plain integers in chunks, by a camera's description (XML).

    Names that the camera lacks, and numbers that it derives from others, are left out.
    """
    nodes = {
        name: node
        for node in ElementTree.fromstring(description).iter()
        if (name := node.get("Name")) and _kind(node) in ("Integer", "IntReg", "Port")
    }
    places = {}
    for name in names:
        place = _place(nodes, name)
        if place is not None:
            places[name] = place
    return places


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
    """Return an element's name without the description's own namespace."""
    return node.tag.rpartition("}")[2]

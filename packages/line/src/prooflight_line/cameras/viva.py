"""GigE Vision cameras through viva-genicam, which comes from pip alone: ``pip install "prooflight-line[viva]"``."""

from __future__ import annotations

import contextlib
import importlib.util
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal, Self
from xml.etree import ElementTree

import numpy as np

from prooflight.scans.lines import runs
from prooflight_line.cameras.camera import CameraInfo, Feature, Grab, Health
from prooflight_line.cameras.pixel_formats import pixel_format
from prooflight_line.cameras.setting_up import CHUNKS, chunk, disconnected, not_taken, settable, temperature_c

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import NDArray

    from prooflight_line.cameras.camera import FeatureKind

FIND_MS: Final = 800
"""Time for cameras to answer: GigE Vision allows them 500 ms, and transmission takes some more."""
CONTROL_S: Final = 0.25
"""Interval of checks whether this program still controls the camera; the library itself knows after 0.6 s."""
OVERHEAD: Final = 36
"""Bytes of a packet that are headers: 20 of IP, 8 of UDP, 8 of GVSP."""
KINDS: Final[Mapping[str, FeatureKind]] = {
    "Integer": "integer",
    "IntConverter": "integer",
    "Float": "float",
    "Converter": "float",
    "SwissKnife": "float",
    "Enumeration": "enumeration",
    "Boolean": "boolean",
    "StringReg": "string",
    "String": "string",
    "Command": "command",
}


class Viva:
    """Backend for cameras through viva-genicam."""

    name = "viva"

    @property
    def lacks(self) -> str:
        """Why the backend cannot be used here, and what would help; empty if it can."""
        if importlib.util.find_spec("viva_genicam") is None:
            return 'viva-genicam is not installed; `pip install "prooflight-line[viva]"`'
        return ""

    def find(self) -> list[CameraInfo]:
        """See ``Backend``; loopback included."""
        return [] if self.lacks else [self._camera_info(one) for one in _answers()]

    def open(self, camera: CameraInfo) -> VivaCamera:
        """See ``Backend``."""
        for one in _answers():
            if one.ip == camera.address:
                return VivaCamera(camera, one)
        raise disconnected(camera.id, "does not answer")

    def _camera_info(self, one: Any) -> CameraInfo:
        parts = one.manufacturer or "camera", one.model or "", one.mac.replace(":", "")
        return CameraInfo(
            id="-".join(filter(None, parts)).replace(" ", "_"),
            maker=parts[0],
            model=parts[1],
            serial=parts[2],
            address=one.ip,
            backend=self.name,
        )


class VivaCamera:
    """An open camera; see ``Camera``."""

    def __init__(self, camera: CameraInfo, answer: Any) -> None:
        """Open a camera; ScanError: it does not answer, or another program controls it."""
        import viva_genicam

        self.info = camera
        self._error = viva_genicam.GenicamError
        self._lost = viva_genicam.ControlState.LOST
        self._stream: Any = None
        self._packet_bytes = 0
        self._chunk_places: dict[str, ChunkPlace] = {}
        self._reckoned: set[str] = set()
        self._taken, self._closed = False, threading.Event()
        try:
            self._camera = viva_genicam.connect_gige(answer)
        except self._error as error:
            raise disconnected(camera.id, f"cannot be opened ({error})") from error

    def features(self) -> Mapping[str, Feature]:
        """See ``Camera``."""
        listed: dict[str, Feature] = {}
        for category, names in self._camera.categories().items():
            for name in names:
                one = None if name in listed else self._feature(name, category)
                if one is not None:
                    listed[name] = one
        return listed

    def feature(self, name: str) -> Feature | None:
        """See ``Camera``."""
        return self._feature(name, "")

    def set(self, name: str, value: str) -> None:
        """See ``Camera``."""
        one = settable(self, name, value)
        try:
            if one.kind == "command":
                self._camera.execute(name)
            else:
                self._camera.set(name, value)
        except self._error as error:
            raise not_taken(self, name, value, error) from error

    def start(self) -> None:
        """See ``Camera``."""
        try:
            packet = self.feature("GevSCPSPacketSize")
            self._packet_bytes = int(packet.value) - OVERHEAD if packet and packet.value else 0
            available = {name for names in CHUNKS.values() for name in names}.intersection(
                self._camera.nodes()
            )
            self._chunk_places = chunk_places(self._camera.xml, available)
            self._reckoned = available.difference(self._chunk_places)
            self._stream = self._camera.stream(deliver_incomplete=True)
            self._stream.__enter__()
        except self._error as error:
            raise disconnected(self.info.id, f"cannot be started ({error})") from error
        threading.Thread(target=self._watch_control, name="camera control", daemon=True).start()

    def grab(self, timeout_s: float) -> Grab | None:
        """See ``Camera``."""
        begun_s = time.monotonic()
        if self._taken:  # lines may go on coming all the same
            raise disconnected(self.info.id, "is disconnected, or another program controls it")
        try:
            frame = self._stream.next_frame(max(round(1e3 * timeout_s), 1))
        except self._error:
            time.sleep(max(begun_s + timeout_s - time.monotonic(), 0.0))
            return None
        if frame is None:
            raise disconnected(self.info.id, "has ended its stream")
        if not frame.width:
            return None  # its first packet was lost, which says what the others hold
        data = np.frombuffer(frame.payload(), np.uint8)
        if not frame.is_complete:  # where its last packets were lost, their bytes are not there at all
            form = pixel_format(frame.pixel_format, where=self.info.id)
            bits = form.block_bits(lines=frame.height, pixels=frame.width)
            short = -(-bits // 8) + frame.height * frame.padding_x - data.size
            data = np.concatenate([data, np.zeros(max(short, 0), np.uint8)])
        chunks = self._chunks(frame) if frame.chunks else {}
        return Grab(
            block_id=frame.block_id,
            id_wraps=True,
            data=data,
            missing=() if frame.is_complete else empty_packets(data, self._packet_bytes),
            pixel_format=frame.pixel_format,
            lines=frame.height,
            pixels=frame.width,
            padding=frame.padding_x,
            time_s=time.monotonic(),
            triggers=chunk(chunks, "triggers"),
            encoder=chunk(chunks, "encoder"),
            chunks=chunks,
        )

    def health(self) -> Health:
        """See ``Camera``; the library does not report how many buffers are free."""
        resends = 0 if self._stream is None else self._stream.stats().resend_recovered
        return Health(resends=resends, temperature_c=temperature_c(self))

    def close(self) -> None:
        """See ``Camera``."""
        self._closed.set()
        stream, self._stream = self._stream, None
        with contextlib.suppress(self._error):
            if stream is not None:
                stream.__exit__(None, None, None)
        with contextlib.suppress(self._error):
            self._camera.close()

    def _watch_control(self) -> None:
        """Check who controls the camera, in a thread of its own, since the check waits for other requests."""
        with contextlib.suppress(self._error):
            while not self._taken and not self._closed.wait(CONTROL_S):
                self._taken = self._camera.control_state is self._lost

    def _feature(self, name: str, category: str) -> Feature | None:
        try:
            state = self._camera.feature_state(name)
        except self._error:
            return None
        kind = KINDS.get(state.kind, "other")
        if state.kind == "Category" or not state.is_implemented:
            return None
        value = state.value
        return Feature(
            name=name,
            kind=kind,
            value="" if value is None else str(value).lower() if isinstance(value, bool) else str(value),
            choices=tuple(state.enum_entries or ()),
            least=None if state.range is None else state.range.min,
            greatest=None if state.range is None else state.range.max,
            writable=state.access in ("RW", "WO"),
            category=category,
        )

    def _chunks(self, frame: Any) -> dict[str, int]:
        """Return the integers that the camera sent with a block.

        The library would wait for other requests to the camera, so it is only used for numbers that the
        camera derives from others.
        """
        raw_chunks = frame.chunks
        numbers = {name: place.read(raw_chunks) for name, place in self._chunk_places.items()}
        values = {name: value for name, value in numbers.items() if value is not None}
        if self._reckoned:
            for name, value in self._camera.chunk_features(frame).items():
                if name in self._reckoned:
                    with contextlib.suppress(TypeError, ValueError):
                        values[name] = int(value)
        return values


def empty_packets(data: NDArray[np.uint8], packet_bytes: int) -> tuple[tuple[int, int], ...]:
    """Return the first byte, and the one after the last, of the parts of a block (bytes,) that are empty, by packets.

    The library leaves zeros where a packet is missing. A packet of nothing but zeros looks the same; a camera
    with a black level sends none. packet_bytes: payload of each; 0 if unknown, where the whole block counts
    as missing.
    """
    if packet_bytes <= 0:
        return ((0, data.size),)
    whole = np.zeros(-(-data.size // packet_bytes) * packet_bytes, np.uint8)
    whole[: data.size] = data
    empty: NDArray[np.bool_] = np.logical_not(whole.reshape(-1, packet_bytes).any(axis=1))
    return tuple((first * packet_bytes, min(end * packet_bytes, data.size)) for first, end in runs(empty))


def _answers() -> list[Any]:
    import viva_genicam

    cameras: list[Any] = viva_genicam.discover(timeout_ms=FIND_MS, all=True)
    return cameras


# --- positions of numbers in a block's chunks ---
#
# By the camera's own description, so that no block waits for the camera: a GenICam description (standard 2.1.1, 2.8.16)
# has a port for every chunk, with its ID, and for every number in it a register, at an offset from the chunk's first
# byte or, if negative, from its end.

MOST_STEPS: Final = 8
"""Greatest number of references from a number to its register; a longer chain must be a cycle."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChunkPlace:
    """Position of an integer within one chunk."""

    chunk_id: int
    first: int
    """Offset of its first byte; if negative, from the chunk's end."""
    length: int
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

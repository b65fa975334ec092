"""GigE Vision and USB3 Vision cameras through Aravis."""

from __future__ import annotations

import contextlib
import ctypes
import time
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.errors import ScanError
from prooflight.rng import stream
from prooflight.scans.lines import runs
from prooflight_line.cameras.aravis_library import (
    BOOL,
    INSTALL,
    POINTER,
    SIZE_T,
    TEXT,
    UINT,
    UINT64,
    AravisError,
    GSList,
    called,
    is_a,
    library,
    plainly,
    set_property,
    text,
    unref,
)
from prooflight_line.cameras.camera import CameraInfo, Feature, Grab, Health
from prooflight_line.cameras.setting_up import (
    CHUNKS,
    chunk,
    disconnected,
    not_taken,
    settable,
    temperature_c,
    value_of,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

    from prooflight_line.cameras.camera import FeatureKind

SOCKET_BYTES: Final = 8 << 20
"""Size of the socket's buffer. With the system's own 208 KiB, every block of 1 MiB came incomplete over
loopback; with 4 to 8 MiB none did. The system gives no more than ``net.core.rmem_max`` allows."""
BUFFER_BYTES: Final = 128 << 20
"""Size of all block buffers together: half a second of the fastest GigE cameras."""
FEWEST_BUFFERS, MOST_BUFFERS = 8, 256
FIXED_BUFFER: Final = 0
"""Value of ARV_GV_STREAM_SOCKET_BUFFER_FIXED."""
PACKET_SOCKET_DISABLED: Final = 1
"""Value of ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED: as root, Aravis would read packets beside the
system's own socket, and nothing sent over loopback arrives there. Without it root and all other users read
lines in the same way."""
SUCCESS, TIMEOUT, MISSING_PACKETS = 0, 2, 3
"""Values of ARV_BUFFER_STATUS_...: complete, and with parts missing."""
WRITABLE: Final = (1, 2)
"""Values of ARV_GC_ACCESS_MODE_WO and _RW."""
KINDS: Final[tuple[tuple[str, FeatureKind], ...]] = (
    ("arv_gc_enumeration", "enumeration"),
    ("arv_gc_boolean", "boolean"),
    ("arv_gc_command", "command"),
    ("arv_gc_string", "string"),
    ("arv_gc_float", "float"),
    ("arv_gc_integer", "integer"),
)
"""Kinds of nodes, the narrowest first, since an enumeration is an integer as well."""


class Aravis:
    """Backend for cameras through libaravis-0.8."""

    name = "aravis"

    @property
    def lacks(self) -> str:
        """Why the backend cannot be used here, and what would help; empty if it can."""
        try:
            library()
        except OSError as error:
            return f"{error}; {INSTALL}"
        return ""

    def find(self) -> list[CameraInfo]:
        """See ``Backend``."""
        if self.lacks:
            return []
        plainly("arv_update_device_list", None, ())
        return [self._camera_info(number) for number in range(plainly("arv_get_n_devices", UINT, ()))]

    def open(self, camera: CameraInfo) -> AravisCamera:
        """See ``Backend``."""
        return AravisCamera(camera)

    def _camera_info(self, number: int) -> CameraInfo:
        def info(what: str) -> str:
            return text(plainly(f"arv_get_device_{what}", TEXT, (UINT,), number))

        return CameraInfo(
            id=info("id"),
            maker=info("vendor"),
            model=info("model"),
            serial=info("serial_nbr"),
            address=info("address"),
            backend=self.name,
        )


class AravisCamera:
    """An open camera; see ``Camera``. Its methods may be called from several threads, one at a time."""

    def __init__(self, camera: CameraInfo) -> None:
        """Open a camera; ScanError: it does not answer, or another program controls it."""
        self.info = camera
        self._camera = self._stream = self._parser = 0
        self._chunk_names: tuple[str, ...] = ()
        self._buffers: dict[int, NDArray[np.uint8]] = {}
        self._taken = 0
        self._canary: Canary | None = None
        self._form, self._lines, self._pixels = "", 0, 0
        try:
            self._camera = called("arv_camera_new", POINTER, (TEXT,), camera.id.encode())
        except AravisError as error:
            raise disconnected(self.info.id, f"cannot be opened ({error})") from error
        self._device = plainly("arv_camera_get_device", POINTER, (POINTER,), self._camera)
        self._genicam = plainly("arv_device_get_genicam", POINTER, (POINTER,), self._device)
        self._networked = bool(plainly("arv_camera_is_gv_device", BOOL, (POINTER,), self._camera))
        if not self._controlled:
            self.close()
            raise ScanError(
                camera.id,
                "is controlled by another program",
                remedy="end that program, or wait 3 s until the camera is free",
            )

    def features(self) -> Mapping[str, Feature]:
        """See ``Camera``."""
        return {one.name: one for one in self._walked("Root", "")}

    def feature(self, name: str) -> Feature | None:
        """See ``Camera``."""
        node = self._node(name)
        return None if node is None else self._feature(node, name, "")

    def set(self, name: str, value: str) -> None:
        """See ``Camera``."""
        one, node = settable(self, name, value), self._node(name)
        try:
            if one.kind == "command":
                called("arv_gc_command_execute", None, (POINTER,), node)
            else:
                setter = "arv_gc_feature_node_set_value_from_string"
                called(setter, None, (POINTER, TEXT), node, value.encode())
        except AravisError as error:
            raise not_taken(self, name, value, error) from error

    def start(self) -> None:
        """See ``Camera``."""
        try:
            self._begin()
        except AravisError as error:
            raise disconnected(self.info.id, f"cannot be started ({error})") from error

    def grab(self, timeout_s: float) -> Grab | None:
        """See ``Camera``."""
        self._give_back()
        if not self._controlled:  # lines may go on coming all the same
            raise disconnected(
                self.info.id, "is disconnected: it no longer answers, or another program controls it"
            )
        buffer = plainly(
            "arv_stream_timeout_pop_buffer", POINTER, (POINTER, UINT64), self._stream, round(1e6 * timeout_s)
        )
        if not buffer:
            return None
        self._taken = buffer
        status = plainly("arv_buffer_get_status", ctypes.c_int, (POINTER,), buffer)
        if status not in (SUCCESS, TIMEOUT, MISSING_PACKETS) or self._canary is None:
            return None
        block_id = plainly("arv_buffer_get_frame_id", UINT64, (POINTER,), buffer)
        if status != SUCCESS and not block_id:
            return None  # its number was lost with its first packet, so the place of its lines is unknown
        data = self._buffers[buffer]
        chunks = self._chunks(buffer) if status == SUCCESS else {}
        return Grab(
            block_id=block_id,
            id_wraps=self._networked,
            data=data,
            missing=() if status == SUCCESS else self._canary.missing(data),
            pixel_format=self._form,
            lines=self._lines,
            pixels=self._pixels,
            padding=0,
            time_s=time.monotonic(),
            triggers=chunk(chunks, "triggers"),
            encoder=chunk(chunks, "encoder"),
            chunks=chunks,
        )

    def health(self) -> Health:
        """See ``Camera``."""
        resent, missing = UINT64(), UINT64()
        free, filled = ctypes.c_int(), ctypes.c_int()
        if self._stream:
            if self._networked:
                types = (POINTER, POINTER, POINTER)
                counts = ctypes.addressof(resent), ctypes.addressof(missing)
                plainly("arv_gv_stream_get_statistics", None, types, self._stream, *counts)
            counts = ctypes.addressof(free), ctypes.addressof(filled)
            plainly("arv_stream_get_n_buffers", None, (POINTER, POINTER, POINTER), self._stream, *counts)
        return Health(resends=resent.value, buffers_free=free.value, temperature_c=temperature_c(self))

    def close(self) -> None:
        """See ``Camera``; takes seconds where the camera no longer answers."""
        camera, stream, taken, parser = self._camera, self._stream, self._taken, self._parser
        self._camera = self._stream = self._taken = self._parser = 0
        if stream:
            with contextlib.suppress(AravisError):
                called("arv_camera_stop_acquisition", None, (POINTER,), camera)
        for reference in (taken, parser, stream, camera):
            unref(reference)
        self._buffers.clear()

    # --- parts ---

    @property
    def _controlled(self) -> bool:
        """Whether the camera still accepts this program's commands, by Aravis's own check every second."""
        if not self._networked:
            return True
        return bool(plainly("arv_gv_device_is_controller", BOOL, (POINTER,), self._device))

    def _begin(self) -> None:
        camera = self._camera
        self._form = value_of(self, "PixelFormat")
        self._lines, self._pixels = (int(value_of(self, name)) for name in ("Height", "Width"))
        payload = called("arv_camera_get_payload", UINT, (POINTER,), camera)
        if self._networked:
            setter = "arv_camera_gv_set_stream_options"
            plainly(setter, None, (POINTER, ctypes.c_int), camera, PACKET_SOCKET_DISABLED)
        self._stream = called(
            "arv_camera_create_stream", POINTER, (POINTER, POINTER, POINTER), camera, None, None
        )
        if self._networked:
            kind = "arv_gv_stream_socket_buffer"
            set_property(self._stream, "socket-buffer", FIXED_BUFFER, kind=kind)
            set_property(self._stream, "socket-buffer-size", SOCKET_BYTES, kind="int")
        self._canary = Canary(payload)
        candidates = (name for names in CHUNKS.values() for name in names)
        self._chunk_names = tuple(name for name in candidates if self._node(name) is not None)
        self._parser = plainly("arv_camera_create_chunk_parser", POINTER, (POINTER,), camera)
        count = min(max(BUFFER_BYTES // payload, FEWEST_BUFFERS), MOST_BUFFERS)
        for _ in range(count):
            data = self._canary.buffer()
            buffer = plainly("arv_buffer_new", POINTER, (SIZE_T, POINTER), payload, data.ctypes.data)
            self._buffers[buffer] = data
            self._push(buffer)
        called("arv_camera_start_acquisition", None, (POINTER,), camera)

    def _chunks(self, buffer: int) -> dict[str, int]:
        """Return the integers that the camera sent with a block."""
        if not plainly("arv_buffer_has_chunks", BOOL, (POINTER,), buffer):
            return {}
        values = {}
        for name in self._chunk_names:
            with contextlib.suppress(AravisError):
                getter = "arv_chunk_parser_get_integer_value"
                types = (POINTER, POINTER, TEXT)
                values[name] = called(getter, ctypes.c_int64, types, self._parser, buffer, name.encode())
        return values

    def _push(self, buffer: int) -> None:
        plainly("arv_stream_push_buffer", None, (POINTER, POINTER), self._stream, buffer)

    def _give_back(self) -> None:
        """Return the last block's buffer to the stream: every buffer that is popped must be pushed."""
        if self._taken and self._canary is not None:
            self._canary.write(self._buffers[self._taken])
            self._push(self._taken)
        self._taken = 0

    # --- its own description ---

    def _node(self, name: str) -> int | None:
        if not self._camera:
            return None  # its description has gone with it
        node: int | None = plainly("arv_gc_get_node", POINTER, (POINTER, TEXT), self._genicam, name.encode())
        return node if node and is_a(node, "arv_gc_feature_node") else None

    def _walked(self, category: str, path: str) -> Iterator[Feature]:
        node = self._node(category)
        if node is None:
            return
        entries = plainly("arv_gc_category_get_features", ctypes.POINTER(GSList), (POINTER,), node)
        while entries:
            name = text(ctypes.cast(entries.contents.data, TEXT).value)
            entries = entries.contents.next
            of = self._node(name)
            if of is None:
                continue
            if is_a(of, "arv_gc_category"):
                yield from self._walked(name, name)
            elif self._queried(of, "arv_gc_feature_node_is_implemented"):
                yield self._feature(of, name, path)

    def _feature(self, node: int, name: str, category: str) -> Feature:
        kind: FeatureKind = next((kind_name for prefix, kind_name in KINDS if is_a(node, prefix)), "other")
        value = ""
        if kind not in ("command", "other"):
            value = text(self._queried(node, "arv_gc_feature_node_get_value_as_string", TEXT))
        numbers = {"integer": ctypes.c_int64, "float": ctypes.c_double}.get(kind)
        bounds = [
            None if numbers is None else self._queried(node, f"arv_gc_{kind}_get_{end}", numbers)
            for end in ("min", "max")
        ]
        access = plainly("arv_gc_feature_node_get_actual_access_mode", ctypes.c_int, (POINTER,), node)
        return Feature(
            name=name,
            kind=kind,
            value=value,
            choices=self._choices(node) if kind == "enumeration" else (),
            least=bounds[0],
            greatest=bounds[1],
            writable=access in WRITABLE and not self._queried(node, "arv_gc_feature_node_is_locked"),
            category=category,
        )

    def _queried(self, node: int, function: str, result: Any = BOOL) -> Any:
        """Return a property of a node, or None if it cannot be read now."""
        with contextlib.suppress(AravisError):
            return called(function, result, (POINTER,), node)
        return None

    def _choices(self, node: int) -> tuple[str, ...]:
        count = UINT()
        names = ctypes.POINTER(TEXT)
        try:
            entries = called(
                "arv_gc_enumeration_dup_available_string_values",
                names,
                (POINTER, POINTER),
                node,
                ctypes.addressof(count),
            )
        except AravisError:
            return ()
        choices = tuple(text(entries[at]) for at in range(count.value))
        plainly("g_free", None, (POINTER,), ctypes.cast(entries, POINTER))
        return choices


# --- bytes of a block that did not arrive, which Aravis does not report ---

BYTES_PER_NUMBER: Final = 4
"""Size of a word in bytes; packets of GigE Vision have a multiple of it, except for a block's last."""


class Canary:
    """Random words that are written to a buffer before it is filled; where they remain, nothing arrived.

    Two words in a row match by chance once in 2^64; a packet has 45 words and more.
    """

    def __init__(self, size: int) -> None:
        """Draw the words of a block of ``size`` bytes."""
        self._size = size
        # The words need only differ from what a camera sends, and be the same in every run.
        self._numbers = stream(size, "block-canary").integers(
            0, 1 << 32, -(-size // BYTES_PER_NUMBER), np.uint32
        )

    def buffer(self) -> NDArray[np.uint8]:
        """Return a new buffer for a block, (size,), ready to be filled."""
        whole = np.empty(self._numbers.size, np.uint32)
        one = whole.view(np.uint8)[: self._size]
        self.write(one)
        return one

    def write(self, buffer: NDArray[np.uint8]) -> None:
        """Prepare a buffer to be filled again."""
        buffer[:] = self._numbers.view(np.uint8)[: self._size]

    def missing(self, buffer: NDArray[np.uint8]) -> tuple[tuple[int, int], ...]:
        """Return the first byte, and the one after the last, of each part of a buffer that was not filled."""
        whole = self._size // BYTES_PER_NUMBER
        same = np.zeros(whole + 1, bool)
        same[:whole] = buffer[: whole * BYTES_PER_NUMBER].view(np.uint32) == self._numbers[:whole]
        rest = slice(whole * BYTES_PER_NUMBER, self._size)
        same[whole] = rest.start < rest.stop and np.array_equal(
            buffer[rest], self._numbers.view(np.uint8)[rest]
        )
        return tuple(
            (first * BYTES_PER_NUMBER, min(end * BYTES_PER_NUMBER, self._size))
            for first, end in runs(same)
            if end - first > 1 or end * BYTES_PER_NUMBER >= self._size
        )

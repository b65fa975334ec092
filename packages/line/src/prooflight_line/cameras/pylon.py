"""Basler's cameras through its own library, pylon: ``pip install "prooflight-line[basler]"``."""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import time
import warnings
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.errors import ScanError
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

    from prooflight_line.cameras.camera import FeatureKind

BUFFERS: Final = 64
NO_ID: Final = (1 << 64) - 1
"""ID of a block that the camera did not number."""
KINDS: Final[tuple[FeatureKind, ...]] = (
    *("other", "other", "integer", "boolean", "command", "float", "string", "other", "other", "enumeration"),
)
"""Kinds of features by GenApi's EInterfaceType."""
CATEGORY: Final = 8


class Pylon:
    """Backend for cameras through pylon."""

    name = "pylon"

    @property
    def lacks(self) -> str:
        """Why the backend cannot be used here, and what would help; empty if it can."""
        if importlib.util.find_spec("pypylon") is None:
            return 'pypylon is not installed; `pip install "prooflight-line[basler]"`'
        return ""

    def find(self) -> list[CameraInfo]:
        """See ``Backend``."""
        return [] if self.lacks else [self._camera_info(one) for one in _devices()]

    def open(self, camera: CameraInfo) -> PylonCamera:
        """See ``Backend``."""
        for one in _devices():
            if one.GetSerialNumber() == camera.serial:
                return PylonCamera(camera, one)
        raise disconnected(camera.id, "does not answer")

    def _camera_info(self, one: Any) -> CameraInfo:
        maker, model, serial = one.GetVendorName(), one.GetModelName(), one.GetSerialNumber()
        return CameraInfo(
            id="-".join((maker, model, serial)).replace(" ", "_"),
            maker=maker,
            model=model,
            serial=serial,
            address=one.GetIpAddress() if one.IsIpAddressAvailable() else serial,
            backend=self.name,
        )


class PylonCamera:
    """An open camera; see ``Camera``. Pylon does not report which part of a block is missing, so all of it is lost."""

    def __init__(self, camera: CameraInfo, device: Any) -> None:
        """Open a camera; ScanError: it does not answer, or another program controls it."""
        pylon, genicam = _library()
        self.info = camera
        self._pylon, self._genicam = pylon, genicam
        self._error = genicam.GenericException
        self._form, self._lines, self._pixels, self._bytes = "", 0, 0, 0
        try:
            self._camera = pylon.InstantCamera(pylon.TlFactory.GetInstance().CreateDevice(device))
            self._camera.Open()
            self._nodes = self._camera.GetNodeMap()
        except self._error as error:
            # Its message has the file and the line of pylon's own source after a colon.
            what = f"cannot be opened ({str(error).split(' : ')[0].strip()})"
            raise disconnected(camera.id, what) from error
        self._networked = device.GetDeviceClass() == "BaslerGigE"

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
        assert node is not None
        try:
            if one.kind == "command":
                node.Execute()
            else:
                node.FromString(value)
        except self._error as error:
            raise not_taken(self, name, value, error) from error

    def start(self) -> None:
        """See ``Camera``."""
        self._form = value_of(self, "PixelFormat")
        self._lines, self._pixels = (int(value_of(self, name)) for name in ("Height", "Width"))
        try:
            self._camera.MaxNumBuffer.SetValue(BUFFERS)
            self._camera.StartGrabbing(self._pylon.GrabStrategy_OneByOne)
        except self._error as error:
            raise disconnected(self.info.id, f"cannot be started ({error})") from error

    def grab(self, timeout_s: float) -> Grab | None:
        """See ``Camera``."""
        try:
            result = self._camera.RetrieveResult(
                max(round(1e3 * timeout_s), 1), self._pylon.TimeoutHandling_Return
            )
        except self._error as error:
            raise disconnected(self.info.id, f"is disconnected ({error})") from error
        if not result.IsValid():
            if self._camera.IsCameraDeviceRemoved():
                raise disconnected(self.info.id, "is disconnected: it no longer answers")
            return None
        with contextlib.closing(_Released(result)):
            return self._grab(result)

    def health(self) -> Health:
        """See ``Camera``."""
        grabber = self._camera.GetStreamGrabberNodeMap()
        resends, free = 0, 0
        with contextlib.suppress(self._error):
            node = grabber.GetNode("Statistic_Resend_Packet_Count")
            resends = 0 if node is None else int(node.GetValue())
        with contextlib.suppress(self._error):
            free = BUFFERS - int(self._camera.NumReadyBuffers.GetValue())
        return Health(resends=resends, buffers_free=free, temperature_c=temperature_c(self))

    def close(self) -> None:
        """See ``Camera``."""
        with contextlib.suppress(self._error):
            self._camera.StopGrabbing()
        with contextlib.suppress(self._error):
            self._camera.Close()

    # --- parts ---

    def _grab(self, result: Any) -> Grab | None:
        block_id = result.GetBlockID()
        if block_id == NO_ID:
            return None  # the place of its lines is unknown
        whole = result.GrabSucceeded()
        if whole:
            data = np.frombuffer(result.GetBuffer(), np.uint8)
            self._bytes = data.size
        else:
            data = np.zeros(self._bytes, np.uint8)
        chunks = self._chunks(result) if whole else {}
        return Grab(
            block_id=block_id,
            id_wraps=self._networked,
            data=data,
            missing=() if whole else ((0, max(data.size, 1 << 40)),),
            pixel_format=self._form,
            lines=self._lines,
            pixels=self._pixels,
            padding=result.GetPaddingX() if whole else 0,
            time_s=time.monotonic(),
            triggers=chunk(chunks, "triggers"),
            encoder=chunk(chunks, "encoder"),
            chunks=chunks,
        )

    def _chunks(self, result: Any) -> dict[str, int]:
        values: dict[str, int] = {}
        if not result.IsChunkDataAvailable():
            return values
        nodes = result.GetChunkDataNodeMap()
        for name in (name for names in CHUNKS.values() for name in names):
            with contextlib.suppress(self._error):
                node = nodes.GetNode(name)
                if node is not None and self._genicam.IsReadable(node):
                    values[name] = int(node.GetValue())
        return values

    def _node(self, name: str) -> Any:
        try:
            node = self._nodes.GetNode(name)
        except self._error as error:
            raise ScanError(self.info.id, f"does not answer ({error})", remedy="check its cable") from error
        if node is None or not self._genicam.IsImplemented(node):
            return None
        return None if node.GetNode().GetPrincipalInterfaceType() == CATEGORY else node

    def _walked(self, category: str, path: str) -> Iterator[Feature]:
        node = self._nodes.GetNode(category)
        for child in node.GetFeatures():
            name = child.GetNode().GetName()
            if child.GetNode().GetPrincipalInterfaceType() == CATEGORY:
                yield from self._walked(name, name)
            elif self._genicam.IsImplemented(child):
                yield self._feature(child, name, path)

    def _feature(self, node: Any, name: str, category: str) -> Feature:
        kind = KINDS[min(node.GetNode().GetPrincipalInterfaceType(), len(KINDS) - 1)]
        readable = self._genicam.IsReadable(node)
        value = node.ToString() if readable and kind not in ("command", "other") else ""
        bounded = readable and kind in ("integer", "float")
        return Feature(
            name=name,
            kind=kind,
            value={"1": "true", "0": "false"}.get(value, value) if kind == "boolean" else value,
            choices=tuple(node.GetSymbolics()) if kind == "enumeration" else (),
            least=node.GetMin() if bounded else None,
            greatest=node.GetMax() if bounded else None,
            writable=bool(self._genicam.IsWritable(node)),
            category=category,
        )


class _Released:
    """Context of a result that returns its buffer to pylon."""

    def __init__(self, result: Any) -> None:
        self._result = result

    def close(self) -> None:
        self._result.Release()


def _devices() -> list[Any]:
    pylon, _ = _library()
    return list(pylon.TlFactory.GetInstance().EnumerateDevices())


def _library() -> tuple[Any, Any]:
    # Its types lack a module name, of which Python warns; made an error, that warning ends the whole process.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return importlib.import_module("pypylon.pylon"), importlib.import_module("pypylon.genicam")

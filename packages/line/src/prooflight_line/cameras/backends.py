"""Camera backends, and the camera that a user names."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from prooflight.errors import RequestError
from prooflight_line.cameras.aravis import Aravis
from prooflight_line.cameras.pylon import Pylon
from prooflight_line.cameras.setting_up import set_up
from prooflight_line.cameras.viva import Viva

if TYPE_CHECKING:
    from prooflight.scans.camera_settings import CameraSettings
    from prooflight_line.cameras.camera import Backend, Camera, CameraInfo

BACKENDS: Final[tuple[Backend, ...]] = (Aravis(), Viva(), Pylon())
"""Backends in order of preference."""


def usable(name: str | None = None) -> list[Backend]:
    """Return the backends that can be used here, one by name or all; RequestError states what is missing."""
    candidates = [one for one in BACKENDS if name in (None, one.name)]
    if not candidates:
        choices = ", ".join(one.name for one in BACKENDS)
        raise RequestError("camera backend", f"there is no {name!r}", remedy=f"choose {choices}")
    ready = [one for one in candidates if not one.lacks]
    if not ready:
        raise RequestError(
            "camera backend", candidates[0].lacks.split("; ")[0], remedy=candidates[0].lacks.split("; ", 1)[1]
        )
    return ready


def list_cameras(backend: str | None = None) -> list[CameraInfo]:
    """Return the cameras that answer, each once, by the first backend that finds it."""
    cameras: list[CameraInfo] = []
    for one in usable(backend):
        addresses = {camera.address for camera in cameras}
        cameras += [camera for camera in one.find() if camera.address not in addresses]
    return cameras


def camera_named(name: str) -> CameraInfo:
    """Return the camera of an ID, serial number or address, with or without its backend and a colon before it.

    RequestError names the cameras that answer.
    """
    backend = None
    head, colon, rest = name.partition(":")
    if colon and head in {one.name for one in BACKENDS}:
        name, backend = rest, head
    cameras = list_cameras(backend)
    for one in cameras:
        if name in one.names:
            return one
    answer = ", ".join(one.id for one in cameras)
    remedy = (
        f"these cameras answer: {answer}"
        if cameras
        else "no camera answers: check cable, power and network address"
    )
    raise RequestError(f"camera {name}", "does not answer", remedy=remedy)


def opened(camera: CameraInfo) -> Camera:
    """Open a camera by the backend that found it; ScanError as of ``Backend.open``."""
    (backend,) = usable(camera.backend)
    return backend.open(camera)


def ready(camera: CameraInfo, settings: CameraSettings, *, where: str) -> Camera:
    """Open a camera and set it up; errors as of ``opened`` and ``set_up``, after which the camera is released."""
    one = opened(camera)
    try:
        set_up(one, settings, where=where)
    except BaseException:
        one.close()
        raise
    return one

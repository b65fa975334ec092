"""The libraries that talk to cameras, and the camera that a user names."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from prooflight.errors import RequestError
from prooflight.scans.cameras.aravis import Aravis
from prooflight.scans.cameras.pylon import Pylon
from prooflight.scans.cameras.setting_up import set_up
from prooflight.scans.cameras.viva import Viva

if TYPE_CHECKING:
    from prooflight.scans.cameras.camera import Backend, Camera, FoundCamera
    from prooflight.scans.cameras.setting_up import CameraSettings

BACKENDS: Final[tuple[Backend, ...]] = (Aravis(), Viva(), Pylon())
"""The one that is asked first comes first."""


def usable(name: str | None = None) -> list[Backend]:
    """Backends that can be used here, one by name or all; RequestError: there is none, and what would help."""
    asked = [one for one in BACKENDS if name in (None, one.name)]
    if not asked:
        known = ", ".join(one.name for one in BACKENDS)
        raise RequestError("camera backend", f"there is no {name!r}", remedy=f"choose {known}")
    ready = [one for one in asked if not one.lacks]
    if not ready:
        raise RequestError(
            "camera backend", asked[0].lacks.split("; ")[0], remedy=asked[0].lacks.split("; ", 1)[1]
        )
    return ready


def found_cameras(backend: str | None = None) -> list[FoundCamera]:
    """Cameras that answer, each once: the first backend's where several find it."""
    found: list[FoundCamera] = []
    for one in usable(backend):
        known = {camera.address for camera in found}
        found += [camera for camera in one.find() if camera.address not in known]
    return found


def found_camera(name: str, *, backend: str | None = None) -> FoundCamera:
    """The camera of that ID, serial number or address, after its backend and a colon or alone.

    RequestError names those that answer.
    """
    head, colon, rest = name.partition(":")
    if colon and head in {one.name for one in BACKENDS}:
        name, backend = rest, head
    cameras = found_cameras(backend)
    for one in cameras:
        if name in one.names:
            return one
    answer = ", ".join(one.id for one in cameras)
    remedy = (
        f"these answer: {answer}" if cameras else "none answers: look at cable, power and network address"
    )
    raise RequestError(f"camera {name}", "does not answer", remedy=remedy)


def opened(camera: FoundCamera) -> Camera:
    """Control of a camera, by the backend that found it; ScanError as of ``Backend.open``."""
    (backend,) = usable(camera.backend)
    return backend.open(camera)


def ready(camera: FoundCamera, settings: CameraSettings, *, where: str) -> Camera:
    """The same, set up as asked; errors as of ``opened`` and ``set_up``, after which others may control it."""
    one = opened(camera)
    try:
        set_up(one, settings, where=where)
    except BaseException:
        one.close()
        raise
    return one

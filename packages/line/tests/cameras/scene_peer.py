"""A GigE Vision line camera on loopback that sees scenes: Aravis' simulated camera in a process of its own.

``python scene_peer.py SCENES.npz DESCRIPTION.xml FOLLOW`` says ``ready`` and shows scenes until its standard input
ends. FOLLOW is a file that says what lies under it: a scene's name, or the protocol of a set-up, whose last question a
technician would have answered by laying something there. Exposure times are the camera's own feature.
"""

from __future__ import annotations

import ctypes
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[4]))

from packages.line.tests.cameras.scenes import Scenes

from prooflight_line.cameras.aravis_library import POINTER, SIZE_T, TEXT, UINT, library, plainly
from prooflight_line.testing.gige_peer import FILL, HEIGHT, description

SERIAL = "PL01"
RESTARTED_S = 1.5
"""Without a block asked for, after which a camera is read by another command."""


def main() -> None:
    scenes, follow = Scenes.load(Path(sys.argv[1])), Path(sys.argv[3])
    file = Path(sys.argv[2])
    file.write_text(description())
    arguments = (b"127.0.0.1", SERIAL.encode(), str(file).encode())
    peer = plainly("arv_gv_fake_camera_new_full", POINTER, (TEXT, TEXT, TEXT), *arguments)
    if not plainly("arv_gv_fake_camera_is_running", ctypes.c_int, (POINTER,), peer):
        sys.exit("another camera is on this address")
    camera = plainly("arv_gv_fake_camera_get_fake_camera", POINTER, (POINTER,), peer)
    filled_s = 0.0

    def fill(buffer: int, _data: int, exposure_us: int, _gain: int, _form: int) -> None:
        told = UINT()
        types = (POINTER, ctypes.c_uint32, POINTER)
        plainly("arv_fake_camera_read_register", ctypes.c_int, types, camera, HEIGHT, ctypes.addressof(told))
        size = plainly("arv_fake_camera_get_payload", SIZE_T, (POINTER,), camera)
        ignored = SIZE_T()
        begin = plainly("arv_buffer_get_data", POINTER, (POINTER, POINTER), buffer, ctypes.addressof(ignored))
        nonlocal filled_s
        now_s, before_s = time.monotonic(), filled_s
        filled_s = now_s
        scenes.follow(follow)
        if scenes.scene == "job" and now_s - before_s > RESTARTED_S:
            scenes.at = 0  # somebody reads anew: the job begins
        lines = scenes.lines(told.value, float(exposure_us))
        data = np.ascontiguousarray(lines[0]).astype("<u2").view(np.uint8).ravel()[:size]
        ctypes.memmove(begin, data.ctypes.data, data.size)

    callback = FILL(fill)
    plainly("arv_fake_camera_set_fill_pattern", None, (POINTER, FILL, POINTER), camera, callback, None)
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    sys.stdin.read()


if __name__ == "__main__":
    library()
    main()

"""A GigE Vision camera on loopback that plays given lines: Aravis' simulated camera in a process of its own.

``python gige_peer.py LINES.npy DESCRIPTION.xml LOST ADDRESS SERIAL`` prints ``ready`` and plays until its standard
input ends. Blocks show the next lines of the file (lines, bytes), repeatedly. The camera has more features than Aravis'
own description. Commands on its standard input, a line each: ``lost SHARE``, the share of packets lost from now on;
``encoder STEPS``, the encoder's new position; ``at LINE``, the line of the file that comes next; ``control 0``: nobody
controls the camera any more.
"""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path

import numpy as np

from prooflight_line.cameras.aravis_library import (
    POINTER,
    SIZE_T,
    TEXT,
    UINT,
    library,
    plainly,
    set_property,
)

ENCODER = 0x3000
"""Address of a register that Aravis' simulated camera does not use."""
FILL = ctypes.CFUNCTYPE(None, POINTER, POINTER, ctypes.c_uint32, ctypes.c_uint32, ctypes.c_uint32)
CONTROL = 0xA00
"""Address of GigE Vision's register for control of the camera."""
WIDTH, HEIGHT = 0x100, 0x104
LINE_RATE = """
<Float Name="AcquisitionLineRate"><pValue>LineRateConverter</pValue><Unit>Hz</Unit></Float>
<Converter Name="LineRateConverter">
  <pVariable Name="LINES">Height</pVariable>
  <FormulaTo>(1000000 * LINES / FROM)</FormulaTo><FormulaFrom>(1000000 * LINES / TO)</FormulaFrom>
  <pValue>AcquisitionFramePeriod</pValue>
</Converter>
<Float Name="DeviceTemperature"><Value>41.5</Value></Float>
<Integer Name="EncoderValue"><pValue>EncoderRegister</pValue></Integer>
<IntReg Name="EncoderRegister">
  <Address>0x3000</Address><Length>4</Length><AccessMode>RO</AccessMode><pPort>Device</pPort>
  <Sign>Unsigned</Sign><ORDER>BigEndian</ORDER>
</IntReg>
""".replace("ORDER", "".join(("Endian", "ess")))  # the standard spells it so
PIXEL_FORMATS = {
    "Mono10": 0x01100003,
    "Mono12": 0x01100005,
    "Mono12p": 0x010C0047,
    "Mono12Packed": 0x010C0006,
}


def description() -> str:
    """Return Aravis' own description, with the further features of a line camera."""
    size = SIZE_T()
    plain = plainly("arv_fake_camera_new", POINTER, (TEXT,), b"PL00")
    types = (POINTER, POINTER)
    whole = plainly("arv_fake_camera_get_genicam_xml", POINTER, types, plain, ctypes.addressof(size))
    text = ctypes.string_at(whole, size.value).decode()
    formats = "".join(
        f'<EnumEntry Name="{name}"><Value>{value}</Value></EnumEntry>'
        for name, value in PIXEL_FORMATS.items()
    )
    text = text.replace('<EnumEntry Name="BayerBG8"', formats + '<EnumEntry Name="BayerBG8"', 1)
    trigger = '<EnumEntry Name="LineStart"><Value>2</Value></EnumEntry>'
    text = text.replace('<EnumEntry Name="FrameStart"', trigger + '<EnumEntry Name="FrameStart"', 1)
    source = '<EnumEntry Name="RotaryEncoder"><Value>2</Value></EnumEntry>'
    text = text.replace('<EnumEntry Name="Line0"', source + '<EnumEntry Name="Line0"', 1)
    names = "".join(
        f"<pFeature>{name}</pFeature>"
        for name in ("AcquisitionLineRate", "DeviceTemperature", "EncoderValue")
    )
    text = text.replace(
        "<pFeature>TriggerSelector</pFeature>", names + "<pFeature>TriggerSelector</pFeature>", 1
    )
    return text.replace("</RegisterDescription>", LINE_RATE + "</RegisterDescription>")


def main() -> None:
    """Play until the standard input ends."""
    lines = np.load(sys.argv[1])
    file = Path(sys.argv[2])
    file.write_text(description())
    peer = plainly(
        "arv_gv_fake_camera_new_full",
        POINTER,
        (TEXT, TEXT, TEXT),
        sys.argv[4].encode(),
        sys.argv[5].encode(),
        str(file).encode(),
    )
    if not plainly("arv_gv_fake_camera_is_running", ctypes.c_int, (POINTER,), peer):
        sys.exit("another camera is on this address")
    set_property(peer, "gvsp-lost-ratio", float(sys.argv[3]), kind="double")
    camera = plainly("arv_gv_fake_camera_get_fake_camera", POINTER, (POINTER,), peer)
    at = 0

    def fill(buffer: int, _data: int, _exposure: int, _gain: int, _form: int) -> None:
        nonlocal at
        height = UINT()
        types = (POINTER, ctypes.c_uint32, POINTER)
        plainly(
            "arv_fake_camera_read_register", ctypes.c_int, types, camera, HEIGHT, ctypes.addressof(height)
        )
        size = plainly("arv_fake_camera_get_payload", SIZE_T, (POINTER,), camera)
        ignored = SIZE_T()
        begin = plainly("arv_buffer_get_data", POINTER, (POINTER, POINTER), buffer, ctypes.addressof(ignored))
        rows = np.arange(at, at + height.value) % len(lines)
        data = np.ascontiguousarray(lines[rows]).ravel()[:size]
        ctypes.memmove(begin, data.ctypes.data, data.size)
        at += height.value

    callback = FILL(fill)
    plainly("arv_fake_camera_set_fill_pattern", None, (POINTER, FILL, POINTER), camera, callback, None)
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    for line in sys.stdin:
        what, value = line.split()
        if what == "lost":
            set_property(peer, "gvsp-lost-ratio", float(value), kind="double")
        elif what == "at":
            at = int(value)
        else:
            types = (POINTER, ctypes.c_uint32, ctypes.c_uint32)
            register = CONTROL if what == "control" else ENCODER
            plainly("arv_fake_camera_write_register", ctypes.c_int, types, camera, register, int(value))
        sys.stdout.write("done\n")
        sys.stdout.flush()


if __name__ == "__main__":
    library()
    main()

"""The second sensor of presses in tests."""

from __future__ import annotations

BLUE_SENSOR = """
[[sensor]]
name = "blue"
pixels = 2048
pixel_pitch_um = 13.0
fill_factor = 0.90
tdi_stages = 96
line_rate_hz = 2770.0
conversion_gain_uv_per_e = 20.0
voltage_swing_v = 2.0
read_noise_e = 60.0
dark_current_e_per_s = 300.0
dsnu_e = 10.0
prnu_percent = 0.5
bits = 10
black_level_dn = 16
quantum_efficiency = { wave_nm = [380, 450, 500, 550, 730], qe = [0.2, 0.5, 0.35, 0.05, 0.0] }

[costs]"""
"""Replaces ``[costs]`` in the prototype's press file."""

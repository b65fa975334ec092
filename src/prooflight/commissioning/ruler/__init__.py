"""Measurements on a ruler page in a scan: position, pitches, sharpness, light and planes. Pure functions on arrays."""

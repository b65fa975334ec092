"""A ruler page in a scan: where it lies, pitches, sharpness, light and planes. Pure functions on arrays."""

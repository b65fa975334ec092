"""Light to numbers: illumination, lens, line sensor, noise (paper, section 3; ISET's physics)."""

"""Camera model: illumination, lens, line sensor and noise (paper, section 3; ISET's physics)."""

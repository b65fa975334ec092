"""Compiled loops of the paper's comparison, in 16-bit integers."""

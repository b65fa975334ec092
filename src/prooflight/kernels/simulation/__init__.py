"""Compiled loops of the simulated press."""

"""Compiled loops that sum evidence and rank it."""

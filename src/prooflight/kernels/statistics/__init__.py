"""Compiled loops that sum evidence up, and that rank it."""

"""Measured against expected: is it a misprint, where, of what kind, and what costs least."""

"""Measured against expected: the error map and the statistics that a decision needs (paper, section 4.1)."""

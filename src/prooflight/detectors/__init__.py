"""Detectors compare measured with expected lines: is it a misprint, where, of which kind, at what cost."""

"""The matched-filter detector, for presses that drift and jitter."""

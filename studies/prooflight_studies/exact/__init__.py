"""The exact camera: a page through the full spectral path, the reference for the fast path."""

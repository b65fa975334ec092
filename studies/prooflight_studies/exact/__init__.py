"""The exact camera: a page through the full spectral path, which the fast one is judged by."""

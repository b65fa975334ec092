"""Reported places of misprints against their true extents."""

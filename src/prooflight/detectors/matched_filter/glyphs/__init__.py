"""Glyphs of a page, each weighed against what might stand in its place."""

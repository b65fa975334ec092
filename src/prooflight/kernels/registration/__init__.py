"""Compiled loops of registration: rendering and measurement of tiles, and their evaluation."""

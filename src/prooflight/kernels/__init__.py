"""Compiled loops, with the shapes that they take; nothing here knows of pages, presses or verdicts."""

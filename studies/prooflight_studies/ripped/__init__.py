"""Presses that rip PDFs themselves, and what a promise is worth there."""

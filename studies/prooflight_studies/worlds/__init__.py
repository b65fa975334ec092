"""The study of worlds."""

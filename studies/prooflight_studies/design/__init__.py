"""The study of design."""

"""The study of running."""

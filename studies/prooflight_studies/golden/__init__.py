"""The study of golden."""

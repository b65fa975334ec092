"""The study of registration."""

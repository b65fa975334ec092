"""The study of the console."""

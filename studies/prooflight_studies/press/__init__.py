"""The study of press."""

"""The study of speed."""

"""The study of edges."""

"""The study of tables."""

"""The study of content."""

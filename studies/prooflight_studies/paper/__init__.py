"""The study of paper."""

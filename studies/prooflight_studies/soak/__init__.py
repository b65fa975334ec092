"""The study of soak."""

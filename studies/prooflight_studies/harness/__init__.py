"""The study of harness."""

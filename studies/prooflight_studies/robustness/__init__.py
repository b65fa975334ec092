"""The study of robustness."""

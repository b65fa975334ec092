"""The study of corpus."""

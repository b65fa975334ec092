"""The study of detectability."""

"""The study of misprints."""

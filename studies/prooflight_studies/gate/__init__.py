"""The study of the gate."""

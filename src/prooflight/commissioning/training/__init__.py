"""A detector trained on simulated and real prints."""

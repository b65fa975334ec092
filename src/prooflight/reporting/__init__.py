"""Presentation of verdicts and studies to people."""

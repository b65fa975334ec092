"""Compiled loops of registration: tiles rendered, measured and judged."""

"""``prooflight camera``: commands for a connected camera."""

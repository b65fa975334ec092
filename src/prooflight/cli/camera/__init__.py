"""``prooflight camera``: cameras on paper, measured, and plugged in."""

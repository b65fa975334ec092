"""``prooflight camera``: cameras as designs, as measured, and as connected devices."""

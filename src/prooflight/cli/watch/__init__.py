"""``prooflight watch``: where its lines come from, what it shows, and the plant and the console beside it."""

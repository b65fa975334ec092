"""``prooflight watch``: the source of its lines, its output, and the plant and the console next to it."""

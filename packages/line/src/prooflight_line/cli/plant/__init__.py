"""``prooflight plant``: a check of the plant's components, and a simulated controller."""

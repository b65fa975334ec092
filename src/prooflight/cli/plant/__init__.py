"""``prooflight plant``: what answers at the plant, and a plant for whoever has none."""

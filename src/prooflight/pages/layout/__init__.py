"""A job laid on sheets: sides, places of pages on them, sets, and the order in which sides pass."""

"""Bar codes and matrix codes: those that a page has must read in its scan, to the same text."""

"""Bar codes and matrix codes: those of a page must read in its scan, to the same text."""

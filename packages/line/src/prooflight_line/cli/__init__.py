"""Commands of the running press, which the program ``prooflight`` finds by entry points."""

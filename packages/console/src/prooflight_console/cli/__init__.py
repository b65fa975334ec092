"""Commands of the console, which the program ``prooflight`` finds by entry points."""

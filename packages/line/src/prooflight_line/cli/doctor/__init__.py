"""`prooflight doctor`."""

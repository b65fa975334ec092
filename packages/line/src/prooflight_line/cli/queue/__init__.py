"""`prooflight queue`."""

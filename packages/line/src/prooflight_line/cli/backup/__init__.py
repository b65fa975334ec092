"""`prooflight backup` and `prooflight restore`."""

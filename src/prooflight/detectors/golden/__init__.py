"""A scan against one that was taken for good."""

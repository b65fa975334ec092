"""A print job that the project makes itself."""

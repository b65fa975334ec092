"""Print job that the project makes itself."""

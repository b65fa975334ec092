"""Detection and identification of sheets in a continuous stream of lines."""

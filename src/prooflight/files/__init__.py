"""Files: whole or not there, bounded before they are read, and what may stand in them."""

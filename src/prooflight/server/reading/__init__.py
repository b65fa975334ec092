"""What the console reads of a journal: runs, sheets, incidents, the press; and what is new in it."""

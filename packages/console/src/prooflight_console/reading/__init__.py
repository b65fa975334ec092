"""Reading of a journal: runs, sheets, incidents and the press, and new rows as they come."""

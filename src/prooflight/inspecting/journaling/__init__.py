"""Parts of the journal: what it keeps, its tables, its files."""

"""Everything that produces a table or a curve of docs/results."""

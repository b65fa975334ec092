"""File handling: atomic writing, bounded reading, and the schema of file contents."""

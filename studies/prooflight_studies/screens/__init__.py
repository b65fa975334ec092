"""Pictures of every page of the console, for people who design it and for the documents."""

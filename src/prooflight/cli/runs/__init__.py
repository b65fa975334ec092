"""Commands on runs of the journal: what a press printed, and what people say of it."""

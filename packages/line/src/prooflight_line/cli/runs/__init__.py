"""Commands on runs of the journal: the prints of a press, and the labels that people give them."""

"""Commands on the records of many presses."""

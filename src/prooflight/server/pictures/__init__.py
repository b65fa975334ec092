"""Pictures of sheets as tiles: made when asked for, kept within a bound."""

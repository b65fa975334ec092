"""Pictures of sheets as tiles, made on request and cached within a bound."""

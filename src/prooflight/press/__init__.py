"""The press: its artefact, and the press file that a user writes."""

"""The press: its artefact, and the press file in a user's words."""

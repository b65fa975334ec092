"""Interfaces to the plant next to the press: the gate with its controller, and the outlets of results."""

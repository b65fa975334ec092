"""The gate: sheets on their way to it, what becomes of each, and the controller that moves it."""

"""The gate: sheets on their way to it, the decision for each, and the controller that moves it."""

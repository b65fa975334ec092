"""The study of zones: their predicted and observed cost, and whether the target false-alarm rate holds with them."""

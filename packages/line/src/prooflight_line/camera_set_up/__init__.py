"""Connected line camera: its live measurements, and its step-by-step set-up."""

"""The world run forward: what a press prints, with misprints, and what the camera records."""

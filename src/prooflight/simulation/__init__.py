"""Forward simulation of a press: its prints, with misprints, and the camera's recordings of them."""

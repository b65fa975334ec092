"""Cost of zones before they are saved: good prints that calibrate them, and defects that measure their sensitivity."""

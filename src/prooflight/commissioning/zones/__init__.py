"""What zones cost before they are saved: good prints that calibrate them, and defects that say what is caught."""

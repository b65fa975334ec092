"""What cameras do to a run: lines to the byte, losses by name, deaths and returns, cameras in step."""

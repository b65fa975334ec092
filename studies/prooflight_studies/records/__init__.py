"""Records of many presses measured: how far behind they are, whether a row is lost, how long a search takes."""

"""The plant beside the press: the gate and its controller, and whoever else is told what a run found."""

"""Where a page lies: landmarks of a design, a coarse search, tiles measured, and the smooth field through them."""

"""Registration of a page: landmarks of its design, a coarse search, measured tiles and a smooth field through them."""

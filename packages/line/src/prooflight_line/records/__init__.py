"""Records of many presses in one PostgreSQL database, which a shipper fills from each press's journal."""

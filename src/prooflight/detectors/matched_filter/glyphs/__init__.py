"""Likelihood-ratio tests of a page's glyphs against what might be printed in their place."""

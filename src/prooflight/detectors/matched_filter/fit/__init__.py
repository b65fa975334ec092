"""Fit of the variation of good prints to a scan, and its removal from the scan."""

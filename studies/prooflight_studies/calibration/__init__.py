"""The study of calibration."""

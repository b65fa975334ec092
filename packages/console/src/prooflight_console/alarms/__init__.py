"""Alarms as a control room handles them: priorities, shelving, statistics, and the hand-over of a shift."""

"""The study of feedback: recalibration by labels of a press that differs from the one it was trained on."""

"""The study of feedback: a press that is not the one it was taught by, calibrated anew by what people say."""

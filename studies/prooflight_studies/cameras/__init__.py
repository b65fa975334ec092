"""The study of cameras: lines to the byte, losses, failures and returns, and synchronised cameras."""

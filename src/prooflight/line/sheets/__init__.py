"""From endless lines to sheets."""

"""All targets, a family a file; a new reader is added here."""

from __future__ import annotations

from tests.fuzz import text_targets, word_targets

TARGETS = (*text_targets.TARGETS, *word_targets.TARGETS)

"""All targets, a family a file; a new reader is added here."""

from __future__ import annotations

from tests.fuzz import artefact_targets, image_targets, journal_targets, text_targets, word_targets

TARGETS = (
    *text_targets.TARGETS,
    *word_targets.TARGETS,
    *artefact_targets.TARGETS,
    *journal_targets.TARGETS,
    *image_targets.TARGETS,
)

"""Names of schema 10 of the press artefact: files that have them are read, and digests that they gave are known.

Schema 11 says the same under other names, so that a press of either schema is made into one of the other.
"""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any, Final

from prooflight.files.schema import Misfit, parsed
from prooflight.press.schema import MODELS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    Arrays = Mapping[str, NDArray[Any]]

SCHEMA: Final = "10"
NAMES: Final = {"ours": "matched_filter", "bayes": "bayes"}
"""Present names of the detectors that presses had, by those of then."""
LABELLED: Final = {"told": "labelled"}
"""The same of their fields."""


def from_schema_10(arrays: Arrays, document: str) -> tuple[dict[str, NDArray[Any]], str]:
    """Return arrays and document of a press of schema 10 as they are today; Misfit: the document is none."""
    before = re.compile(rf"^({'|'.join(NAMES)})\.(?:(told)(?=[0-9]))?")
    named = {
        before.sub(lambda m: f"{MODELS}{NAMES[m[1]]}.{LABELLED.get(m[2], '')}", one): one for one in arrays
    }
    return {name: arrays[one] for name, one in named.items()}, _renamed(document, NAMES, LABELLED)


def as_schema_10(arrays: Arrays, document: str) -> tuple[dict[str, NDArray[Any]], str]:
    """Return arrays and document of a press of today as schema 10 had them."""
    former, told = ({new: old for old, new in names.items()} for names in (NAMES, LABELLED))
    now = re.compile(rf"^{re.escape(MODELS)}({'|'.join(former)})\.(?:(labelled)(?=[0-9]))?")
    named = {now.sub(lambda m: f"{former[m[1]]}.{told.get(m[2], '')}", one): one for one in arrays}
    return {name: arrays[one] for name, one in named.items()}, _renamed(document, former, told)


def _renamed(document: str, names: Mapping[str, str], fields: Mapping[str, str]) -> str:
    """Return a document with other names of detectors and of their fields, as ``Press`` writes it."""
    facts = parsed(document)
    detectors = facts.get("detectors") if isinstance(facts, dict) else None
    if not isinstance(detectors, dict) or not all(isinstance(one, dict) for one in detectors.values()):
        raise Misfit("detectors", "is missing, or does not hold the detectors' fields")
    facts["detectors"] = {
        names.get(name, name): {fields.get(field, field): value for field, value in one.items()}
        for name, one in detectors.items()
    }
    return json.dumps(facts, sort_keys=True)

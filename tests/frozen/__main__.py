"""``python -m tests.frozen``: measure the frozen figures anew, where a change is meant to change them and says so."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

from tests.frozen.cases import CASES, figures_of
from tests.frozen.test_frozen import FIGURES

found = {}
for case in CASES:
    with tempfile.TemporaryDirectory() as folder:
        found[case.__name__] = figures_of(case, Path(folder))
    print(case.__name__, flush=True)  # noqa: T201
FIGURES.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")

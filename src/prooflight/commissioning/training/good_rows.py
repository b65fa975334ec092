"""Statistics of a press's real good pages, and the file next to its artefact in which they wait until they suffice."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import save

from prooflight.artefact import Damaged, Tensors
from prooflight.detectors.matched_filter.entry import model_of
from prooflight.detectors.matched_filter.fit.modes import PAGE_FEATURES
from prooflight.detectors.matched_filter.variation import AMOUNTS
from prooflight.errors import PressError
from prooflight.files.atomic import whole_file
from prooflight.files.schema import ArraySpec, Misfit, check_arrays

if TYPE_CHECKING:
    from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
    from prooflight.detectors.optional import ScannedPage
    from prooflight.press.artefact import Press

KIND: Final = "prooflight waiting pages"
SCHEMA: Final = "1"
SUFFIX: Final = ".waiting"
TEXTS: Final = ("kind", "schema", "measured_by", "scans", "designs")
TABLE: Final = {
    "values": ArraySpec(dtype="float32", shape=("pages", "statistics")),
    "page_features": ArraySpec(dtype="float64", shape=("pages", "features")),
    "glyphs": ArraySpec(dtype="float64", shape=("pages",)),
    "variation": ArraySpec(dtype="float32", shape=("pages", len(AMOUNTS), 2)),
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GoodRows:
    """Statistics of scans of good pages, one row each, in the order in which they were learned."""

    values: NDArray[np.float32]
    """(pages, statistics)"""
    page_features: NDArray[np.float64]
    """(pages, PAGE_FEATURES)"""
    glyphs: NDArray[np.float64]
    """(pages,) ``ScoredPage.score`` of each."""
    variation: NDArray[np.float32]
    """(pages, AMOUNTS, 2) ``page_variation``."""
    scans: tuple[str, ...]
    """Digest of each scan."""
    designs: tuple[str, ...]
    """Digest of each page's raster, which copies of a page share."""

    def __len__(self) -> int:
        """Return the number of pages."""
        return len(self.values)

    @classmethod
    def of(cls, detector: CalibratedDetector, pages: Sequence[ScannedPage]) -> Self:
        """Create rows from scanned pages; a page without a design's digest is a design of its own."""
        return cls(
            values=np.array([page.evidence["values"] for page in pages], np.float32).reshape(
                len(pages), detector.pages.values.shape[1]
            ),
            page_features=np.array([page.evidence["page_features"] for page in pages], np.float64).reshape(
                len(pages), detector.pages.page_features.shape[1]
            ),
            glyphs=np.array([page.evidence["glyphs"] for page in pages], np.float64),
            variation=np.array([page.variation for page in pages], np.float32).reshape(
                len(pages), len(AMOUNTS), 2
            ),
            scans=tuple(page.digest for page in pages),
            designs=tuple(page.design or page.digest for page in pages),
        )

    def followed_by(self, others: GoodRows) -> GoodRows:
        """Return these rows and those of the others whose scans are not among them."""
        new = others.without(self.scans)
        return GoodRows(
            values=np.concatenate([self.values, new.values]),
            page_features=np.concatenate([self.page_features, new.page_features]),
            glyphs=np.append(self.glyphs, new.glyphs),
            variation=np.concatenate([self.variation, new.variation]),
            scans=self.scans + new.scans,
            designs=self.designs + new.designs,
        )

    def without(self, scans: Sequence[str]) -> GoodRows:
        """Return the rows of other scans than these."""
        those = set(scans)
        left = [row for row, scan in enumerate(self.scans) if scan not in those]
        return GoodRows(
            values=self.values[left],
            page_features=self.page_features[left],
            glyphs=self.glyphs[left],
            variation=self.variation[left],
            scans=tuple(self.scans[row] for row in left),
            designs=tuple(self.designs[row] for row in left),
        )


def waiting_path(artefact: Path) -> Path:
    """Return the file in which pages wait until there are enough for the press ``artefact``."""
    return artefact.with_name(artefact.name + SUFFIX)


def read_waiting(artefact: Path, press: Press) -> GoodRows | None:
    """Read the pages that wait for a press; None: there are none.

    PressError: the file is damaged, or another build of the press measured its pages, so that their statistics
    do not compare with new ones.
    """
    path = waiting_path(artefact)
    if not path.exists():
        return None
    remedy = "remove it, and learn its pages again"
    detector = model_of(press)
    try:
        file = Tensors(path)
        texts, arrays = file.texts, file.arrays()
        sizes = {"statistics": detector.pages.values.shape[1], "features": PAGE_FEATURES}
        if texts.get("kind") == KIND and texts.get("measured_by") != _measured_by(press):
            what = f"another build of {press.name} measured the pages that are stored in it"
            raise PressError(path, what, remedy=remedy)
        rows = _checked(texts, arrays, sizes)
    except (Damaged, Misfit) as error:
        what = str(error) or "is damaged"
        raise PressError(path, what, remedy=remedy) from error
    return rows


def _checked(
    texts: Mapping[str, str], arrays: Mapping[str, NDArray[Any]], sizes: Mapping[str, int]
) -> GoodRows:
    """Return the rows of a file; Misfit: it is none of this kind, or its parts do not belong to each other."""
    if texts.get("kind") != KIND or texts.get("schema") != SCHEMA or set(texts) != set(TEXTS):
        raise Misfit("file", f"is not of the kind {KIND!r}, schema {SCHEMA}")
    pages = check_arrays(arrays, TABLE, sizes)["pages"]
    scans, designs = (tuple(texts[name].split()) for name in ("scans", "designs"))
    if not len(set(scans)) == len(designs) == pages:
        raise Misfit("scans", f"do not name a scan and a design of each of {pages} pages")
    return GoodRows(**arrays, scans=scans, designs=designs)


def write_waiting(artefact: Path, press: Press, rows: GoodRows) -> None:
    """Write the pages that wait for a press, all of them or none."""
    arrays: dict[str, NDArray[Any]] = {name: np.ascontiguousarray(getattr(rows, name)) for name in TABLE}
    texts = {
        "kind": KIND,
        "schema": SCHEMA,
        "measured_by": _measured_by(press),
        "scans": " ".join(rows.scans),
        "designs": " ".join(rows.designs),
    }
    with whole_file(waiting_path(artefact)) as unfinished:
        unfinished.write_bytes(save(arrays, texts))


def _measured_by(press: Press) -> str:
    """Return a digest of what a page's statistics depend on: the press, and its model before any adaptation."""
    model = model_of(press).model
    plain = replace(model, shift=np.zeros_like(model.shift), scale=np.ones_like(model.scale))
    sha = hashlib.sha256(replace(press, detectors={}, origin={}).digest.encode())
    sha.update(json.dumps(plain.facts(), sort_keys=True).encode())
    for name, array in sorted(plain.arrays().items()):
        sha.update(f"{name} {array.dtype} {array.shape}".encode())
        sha.update(np.ascontiguousarray(array).tobytes())
    return sha.hexdigest()

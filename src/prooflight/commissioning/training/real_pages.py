"""Replacement of simulated good pages by real ones, by which adaptation and false-alarm rate are fitted again.

Statistics of real good pages wait in a file next to the press's artefact until they suffice. From the same pages
``[variation]`` is estimated, next to the values that the press file states.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import save

from prooflight.artefact import Damaged, Tensors
from prooflight.commissioning.training.adapting import fit_for
from prooflight.commissioning.training.learn import Pages
from prooflight.detectors.false_alarm_rate import least_false_alarm_rate
from prooflight.detectors.matched_filter.entry import NAME, model_of
from prooflight.detectors.matched_filter.fit.modes import PAGE_FEATURES
from prooflight.detectors.matched_filter.variation import AMOUNTS, UNTOLD, Learned, learned_amounts
from prooflight.errors import PressError, RequestError
from prooflight.files.atomic import whole_file
from prooflight.files.schema import ArraySpec, Misfit, check_arrays
from prooflight.press.blocks import VARIATION
from prooflight.simulation.worlds import Amounts, amounts_of

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


FEWEST_REAL: Final = 20
"""Least number of pages: fewer could not even guarantee one false alarm in 20."""
SEEN: Final = "real_pages"
"""Key in ``Press.origin`` of the digests of the scans used in training, so that none counts twice."""
DESIGNS: Final = "real_designs"
"""Key in ``Press.origin`` of the digests of their pages' rasters, in the same order.

A press that was trained before copies were counted lacks it.
"""
WIDE: Final = 1.5
"""assumed: this factor on a stated value is a wide margin.

The amounts themselves are known to some ten per cent.
"""
REMEDY: Final = (
    "more than stated: state it in [variation] and build again; after `press learn` the rate includes it"
)
FEW: Final = "not estimated: too few pages"


@dataclass(frozen=True, slots=True, kw_only=True)
class LearnedPages:
    """Press after a call of ``learn_pages``, and the pages that it has learned, or that wait until they suffice."""

    press: Press
    """The press; unchanged while ``waiting``."""
    new: int
    """Number of pages that had not been learned before."""
    designs: tuple[str, ...]
    """Digest of each page's design."""
    alarms_before: int
    """Number of the given pages that alarmed before."""
    waiting: bool
    """Whether the pages do not yet suffice, and wait in the file next to the press."""

    @property
    def threshold(self) -> float:
        """Score above which a page alarms."""
        return model_of(self.press).threshold

    @property
    def guarantee(self) -> str:
        """The rate that is guaranteed, in words."""
        return str(model_of(self.press).guarantee)

    @property
    def sentence(self) -> str:
        """Return how many pages there are of how many designs, and what they support or lack."""
        count, copies = len(self.designs), Counter(self.designs)
        different = f"{len(copies)} {'design' if len(copies) == 1 else 'designs'}"
        if len(copies) < count:
            least, most = min(copies.values()), max(copies.values())
            each = f"{most}" if least == most else f"{least} to {most}"
            different = f"{different}, {each} {'copies' if most > 1 else 'copy'} of each"
        if self.waiting:
            lacking = FEWEST_REAL - count
            return f"{count} of {FEWEST_REAL} pages so far ({different}); learn {lacking} more"
        odds = round(1 / least_false_alarm_rate(count))
        text = (
            f"{count} pages learned ({different}): by themselves they support no rate below one in {odds:,}"
        )
        if len(copies) == count:
            return text
        odds = round(1 / least_false_alarm_rate(len(copies)))
        return f"{text} copies of these designs, and one in {odds:,} pages of new designs"


def learn_pages(
    artefact: Path, press: Press, pages: Sequence[ScannedPage], *, false_alarm_rate: float | None, out: Path
) -> LearnedPages:
    """Learn good pages with those that wait next to ``artefact``, and write the press to ``out`` if they suffice.

    All pages are written to the waiting file first, which is removed once ``artefact`` itself has learned
    them: whenever the process ends, no page is lost, and none counts twice. RequestError: see ``recalibrated``.
    PressError: the waiting file cannot be used. false_alarm_rate: None: the rate that was asked for before.
    """
    detector = model_of(press)
    alarms = sum(page.score > detector.threshold for page in pages)
    waiting = read_waiting(artefact, press)
    before = GoodRows.of(detector, []) if waiting is None else waiting
    seen = press.origin.get(SEEN, "").split()
    before = before.without(seen)
    rows = before.followed_by(_good_rows(detector, pages).without(seen))
    new, suffices = len(rows) - len(before), detector.real + len(rows) >= FEWEST_REAL
    if new and (waiting is not None or not suffices or out != artefact):
        write_waiting(artefact, press, rows)
    if not suffices:
        designs = (*_designs_of(press, detector.real), *rows.designs)
        return LearnedPages(press=press, new=new, designs=designs, alarms_before=alarms, waiting=True)
    learned = _learned(press, rows, false_alarm_rate=false_alarm_rate or detector.guarantee.requested_rate)
    learned.save(out)
    if out == artefact:
        waiting_path(artefact).unlink(missing_ok=True)
    designs = tuple(learned.origin[DESIGNS].split())
    return LearnedPages(press=learned, new=new, designs=designs, alarms_before=alarms, waiting=False)


def recalibrated(
    press: Press, pages: Sequence[ScannedPage], digests: Mapping[str, str], *, false_alarm_rate: float
) -> Press:
    """Adapt the press to these good pages; digests: of the scans, by page, of those to train on.

    Real pages take the place of simulated ones, and add up over calls. RequestError: the press was not trained
    with the matched-filter detector, a scan shows another page, or altogether there are too few real pages.
    """
    detector = model_of(press)
    rows = _good_rows(detector, [page for page in pages if page.name in digests])
    if (count := detector.real + len(rows)) < FEWEST_REAL:
        what = f"{count} good pages that were not learned from before"
        raise RequestError("good pages", what, remedy=f"give {FEWEST_REAL} or more")
    return _learned(press, rows, false_alarm_rate=false_alarm_rate)


def _good_rows(detector: CalibratedDetector, pages: Sequence[ScannedPage]) -> GoodRows:
    """Return the rows of these pages; RequestError: a scan shows another page, so that it is not good."""
    if astray := [page.name for page in pages if page.another]:
        what = f"{', '.join(astray[:5])} {'shows' if len(astray) == 1 else 'show'} another page"
        raise RequestError("good pages", what, remedy="leave out what is not good")
    return GoodRows.of(detector, pages)


def _designs_of(press: Press, count: int) -> tuple[str, ...]:
    """Return the design of each real page; those of which it was not stored count as designs of their own."""
    stored = press.origin.get(DESIGNS, "").split()[:count]
    return (*(f"unknown-{at}" for at in range(count - len(stored))), *stored)


def _learned(press: Press, rows: GoodRows, *, false_alarm_rate: float) -> Press:
    """Return the press adapted to the real pages that it has learned and to these."""
    detector = model_of(press)
    real = detector.pages.glyphs[: detector.real]
    designs = (*_designs_of(press, detector.real), *rows.designs)
    good = Pages(
        values=np.concatenate([detector.pages.values[: detector.real], rows.values]),
        page_features=np.concatenate([detector.pages.page_features[: detector.real], rows.page_features]),
        design=np.array(_in_order(designs)),
        kind=np.full(len(designs), ""),
        press=np.zeros(len(designs), np.int64),
    )
    learned = fit_for(
        detector.model,
        detector.references,
        good,
        np.zeros(len(designs), bool),
        false_alarm_rate=false_alarm_rate,
        misprint_rate=detector.misprint_rate,
        real=True,
        glyphs=np.append(real, rows.glyphs) if real.size == detector.real else None,
    )
    variation = np.concatenate([detector.pages.variation, rows.variation])
    learned = replace(learned, pages=replace(learned.pages, variation=variation))
    seen = " ".join([*press.origin.get(SEEN, "").split(), *rows.scans])
    origin = dict(press.origin) | {SEEN: seen, DESIGNS: " ".join(designs)}
    return replace(press, origin=origin).with_detector(NAME, learned)


def _in_order(designs: Iterable[str]) -> list[int]:
    """Return the number of each design, in the order in which they first come."""
    numbers: dict[str, int] = {}
    return [numbers.setdefault(design, len(numbers)) for design in designs]


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedAndLearned:
    """One amount of ``[variation]``, or several that pages of one session show combined, as independent ones add up."""

    names: tuple[str, ...]
    stated: float
    learned: Learned | None
    """Estimate; None: not estimated."""
    remark: str
    """Remedy, or the reason why it was not estimated; mostly empty."""


def stated_and_learned(press: Press) -> list[StatedAndLearned]:
    """Return every amount of ``[variation]``.

    The list is empty where the press was trained on no real page that shows them.
    """
    pages = None if NAME not in press.detectors else model_of(press).pages.variation
    if pages is None or not len(pages):
        return []
    amounts, learned = amounts_of(press), learned_amounts(pages)
    rows = [_row(one.names, amounts, one, "") for one in learned]
    estimated = {name for one in learned for name in one.names}
    for block, fields in VARIATION.items():
        for name in (f"{block}.{field}" for field in fields):
            if name not in estimated:
                reason = f"not estimated: {UNTOLD[name]}" if name in UNTOLD else FEW
                rows.append(_row((name,), amounts, None, reason))
    return rows


def _row(names: tuple[str, ...], amounts: Amounts, learned: Learned | None, remark: str) -> StatedAndLearned:
    each = [attrgetter(name)(amounts) for name in names]
    stated = math.hypot(*(max(one) if isinstance(one, tuple) else one for one in each))
    if learned is not None:
        far = stated**WIDE if names[0] == "camera.sigma_error" else WIDE * stated
        remark = REMEDY if learned.low > far else ""
    return StatedAndLearned(names=names, stated=stated, learned=learned, remark=remark)

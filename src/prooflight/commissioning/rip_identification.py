"""Identification of a press's RIP: where its edges lie beside those that are drawn in its place, by ink.

An edge is sought in the expected image where a run of pixels goes from one level to another. Its place in both
images is the mean place of the step between the levels at its ends, so that neither gain nor blur moves it.
All edges of an ink that lie further out have grown; those that lie further right have moved; what remains is
how surely single edges lie. Edges are of rasters of a test page, with edges at parts of pixels, hairlines and tints of
every ink; or of scans of good pages, which show the growth of each ink.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INK_NAMES, INKS
from prooflight.errors import ScanError
from prooflight.pages.pdf.engine_check import pdf_of
from prooflight.pages.pdf.rip_model import FILL_RULES, FillRule, RipModel

if TYPE_CHECKING:
    from prooflight.detectors.base import Inspection
    from prooflight.detectors.verdict import Verdict
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

HALF: Final = 3
"""Pixels that are looked at to either side of an edge of a raster: growth up to two of them is seen."""
TILE: Final = 32
"""Side of the tiles in which the edges of one direction count as one: neighbours lie off alike. [pixels]"""
BAND: Final = 256
"""Rows in which edges are sought at once, a tile's whole multiple."""
ENOUGH: Final = 40_000
"""Edges of one ink after which no more are sought."""
FEWEST_TILES: Final = 12
"""Fewest tiles by which an ink's growth is stated."""
ALL_TILES: Final = 10**9
"""Side of a cell that holds all tiles of all pages. [tiles]"""
LEAST_STEP: Final = 0.25
"""Least step of an edge, as a share of the range."""
PLATEAU: Final = 0.1
"""Largest change from the first to the second pixel of a run, as a share of its step."""
SAME_STEP: Final = 0.4
"""Largest difference of the steps of both images, as a share; others are no edges of the same shape."""
SURE: Final = 3.0
"""Standard errors beyond which a growth is taken for one."""
LEAST_GROWTH: Final = 0.05
"""Growth that is not drawn: it would darken pictures, whose pixels have edges too, by more than it is worth. assumed
[pixels]"""
BETTER: Final = 0.9
"""Largest ratio of an identified rule's residual to the next best one's."""
SIDE_POINTS: Final = (420.0, 320.0)
PITCH_POINTS: Final = 24.37
"""Pitch of the squares: no multiple of a pixel of any usual resolution, so that edges lie at all parts of pixels."""
SQUARE_POINTS: Final = 11.13
STAGGER_POINTS: Final = 0.173
"""Steps by which neighbours lie further down, so that no two edges of a row are rounded alike."""
SQUARES: Final = (8, 2)
"""Squares of each ink, across and down."""
HAIRLINES_POINTS: Final = (0.0, 0.06, 0.12, 0.25, 0.5)
TINTS: Final = (0.05, 0.1, 0.25, 0.5, 0.75, 0.9)
HALF_OF_SCANS: Final = 4
"""Pixels that are looked at to either side of an edge: the lens blurs it over some two."""
CELL_TILES: Final = 4
"""Side of the cells that have an offset each: 13 mm at 0.1 mm. Paper and planes move a print by parts of a pixel that
vary over some centimetres."""
ALONE: Final = 0.02
"""Largest difference, as a share of paper white, that other inks may make where an ink counts as alone."""


@dataclass(frozen=True, slots=True, kw_only=True)
class InkEdges:
    """How the edges of one ink lie beside the expected ones; standard errors are of means over tiles."""

    growth_pixels: float
    growth_sd: float
    offset_pixels: tuple[float, float]
    """Mean displacement to the right and down."""
    edge_sd: float
    """Standard deviation of a tile's edges after growth and offset. [pixels]"""
    tiles: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Identified:
    """Parameters that were identified, and sentences that say so."""

    model: RipModel
    sentences: tuple[str, ...]


def ink_edges(
    expected: Sequence[NDArray[np.floating | np.uint8]],
    seen: Sequence[NDArray[np.floating | np.uint8]],
    *,
    span: float,
    half: int = HALF,
    alone: Sequence[NDArray[np.bool_]] | None = None,
    cell_tiles: int = ALL_TILES,
) -> InkEdges | None:
    """Return how the edges of one ink lie in pages as they were printed, beside pages as expected.

    Parameters
    ----------
    expected, seen
        Pages (rows, columns) of one ink, in the same place; more is more ink.
    span
        Range of full ink.
    half
        Pixels that are looked at to either side of an edge.
    alone
        Where the ink is alone (rows, columns); None: everywhere.
    cell_tiles
        Side of the cells that have an offset each: a RIP has one, a print is moved by paper and planes from place to
        place. [tiles]

    Returns
    -------
    InkEdges or None
        None: fewer than ``FEWEST_TILES`` tiles of edges.
    """
    estimates: list[NDArray[np.float64]] = []
    for page, (there, printed) in enumerate(zip(expected, seen, strict=True)):
        tops = range(0, there.shape[0], BAND)
        order = [
            top for start in range(4) for top in tops[start::4]
        ]  # all over the page before any part of it in full
        for top in order:
            if sum(map(len, estimates)) > ENOUGH:
                break
            rows = slice(top, top + BAND)
            clear = None if alone is None else alone[page][rows]
            for axis in (0, 1):
                one = _edges(there[rows], printed[rows], span, half, axis, clear)
                one[:, 0] += top
                one[:, 0] = page * 1e6 + one[:, 0] // TILE
                estimates.append(one)
    return _fitted(np.concatenate(estimates), cell_tiles) if estimates else None


def _edges(
    expected: NDArray[np.generic],
    seen: NDArray[np.generic],
    span: float,
    half: int,
    axis: int,
    clear: NDArray[np.bool_] | None,
) -> NDArray[np.float64]:
    """Return row, column in tiles, direction right and down (0, 1 or -1), and outward displacement; (n, 5)."""
    there, printed = (np.asarray(image, np.float32) for image in (expected, seen))
    if axis == 0:
        there, printed = there.T, printed.T
        clear = None if clear is None else clear.T
    count = there.shape[1] - 2 * half + 1
    if count < 1:
        return np.zeros((0, 5))
    first, last = there[:, :count], there[:, 2 * half - 1 :]
    before, after = there[:, half - 1 : half - 1 + count], there[:, half : half + count]
    step, middle = last - first, (first + last) / 2
    edge = (
        (np.abs(step) > LEAST_STEP * span) & ((before - middle) * (after - middle) <= 0) & (before != after)
    )
    # Straight for three pixels: the steps of a slanted edge end within the window.
    rising, straight = step > 0, np.zeros_like(edge)
    for up in (True, False):
        alike = edge & (rising == up)
        straight[1:-1] |= alike[1:-1] & alike[:-2] & alike[2:]
    edge = straight
    if clear is not None:
        for at in range(0, 2 * half):
            edge &= clear[:, at : at + count]
    lines, places = np.nonzero(edge)
    window = places[:, None] + np.arange(2 * half)
    a, b = there[lines[:, None], window], printed[lines[:, None], window]
    of_a, of_b = a[:, -1] - a[:, 0], b[:, -1] - b[:, 0]
    sound = np.abs(of_b / of_a - 1) < SAME_STEP
    for image, of in ((a, of_a), (b, of_b)):
        flat = np.maximum(np.abs(image[:, 1] - image[:, 0]), np.abs(image[:, -1] - image[:, -2]))
        sound &= flat < PLATEAU * np.abs(of)
    a, b, of_a, of_b = a[sound], b[sound], of_a[sound], of_b[sound]
    place_a = ((a[:, -1:] - a) / of_a[:, None]).sum(axis=1)
    place_b = ((b[:, -1:] - b) / of_b[:, None]).sum(axis=1)
    towards = np.where(of_a < 0, 1.0, -1.0)  # less ink beyond: the shape's edge to the right or below
    moved = towards * (place_b - place_a)
    lines, at = lines[sound], places[sound] + half
    none = np.zeros(len(at))
    if axis == 0:
        return np.column_stack([at, lines // TILE, none, towards, moved])
    return np.column_stack([lines, at // TILE, towards, none, moved])


def _fitted(edges: NDArray[np.float64], cell_tiles: int) -> InkEdges | None:
    """Fit growth, and an offset for each cell and direction, to means of tiles; None: too few opposite edges.

    The standard error is robust against what edges have in common: those of a row of tiles, or of a column, may lie on
    one row or column of the device's pixels, and are rounded alike; in copies of a page they are the same edges.
    """
    if not len(edges):
        return None
    keys, of = np.unique(edges[:, :4], axis=0, return_inverse=True)
    of = of.ravel()
    means = np.bincount(of, edges[:, 4]) / np.bincount(of)
    down, sign = keys[:, 3] != 0, keys[:, 2] + keys[:, 3]
    _, group = np.unique(np.column_stack([keys[:, :2] // cell_tiles, down]), axis=0, return_inverse=True)
    group = group.ravel()
    count = np.bincount(group)

    def besides_offset(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return values - sign * (np.bincount(group, sign * values) / count)[group]

    grows = besides_offset(np.ones(len(means)))
    weight = float(grows @ grows)
    freedom = len(means) - len(count) - 1
    if weight < FEWEST_TILES or freedom < 1:
        return None
    growth = float(grows @ means) / weight
    left = besides_offset(means) - growth * grows
    shared = np.column_stack([np.where(down, keys[:, 0] % 1e6, 0), ~down * keys[:, 1], down])
    _, cluster = np.unique(shared, axis=0, return_inverse=True)
    sums = np.bincount(cluster.ravel(), grows * left)
    across, along = (
        float((sign * (means - growth))[one].mean()) if one.any() else 0.0 for one in (~down, down)
    )
    return InkEdges(
        growth_pixels=growth,
        growth_sd=float(np.sqrt((sums @ sums) * len(means) / freedom)) / weight,
        offset_pixels=(across, along),
        edge_sd=float(np.sqrt((left @ left) / freedom)),
        tiles=len(means),
    )


def identified_from_rasters(
    rasters: Sequence[NDArray[np.uint8]],
    drawn: Callable[[RipModel], Sequence[NDArray[np.uint8]]],
    *,
    dpi: float,
    is_own_engine: bool = True,
) -> Identified:
    """Identify a RIP from its rasters of pages.

    Parameters
    ----------
    rasters
        Pages (rows, columns, 4) as the press's front end makes them.
    drawn
        Draws the same pages by parameters, at the same resolution and of the same sizes.
    dpi
        Of the rasters. [pixels/inch]
    is_own_engine
        Whether fill rules can be tried, since MuPDF draws.
    """
    rules: tuple[FillRule | None, ...] = FILL_RULES if is_own_engine else (None,)
    tried = {}
    for rule in rules:
        expected = drawn(RipModel(fill=rule))
        inks = [
            ink_edges([page[..., ink] for page in expected], [page[..., ink] for page in rasters], span=255)
            for ink in range(INKS)
        ]
        tried[rule] = inks, _residual(inks)
    order = sorted(tried, key=lambda rule: tried[rule][1])
    best = order[0]
    fill: FillRule | None = best
    if len(order) > 1 and not tried[best][1] < BETTER * tried[order[1]][1]:
        fill = None
        best = "centre"
    sentences = []
    if fill is not None:
        sentences.append(
            f"The RIP fills pixels by the rule {fill}: its edges are then within {tried[fill][1]:.2f} pixels of those "
            f"that are drawn, by {order[1]} within {tried[order[1]][1]:.2f}."
        )
    elif is_own_engine:
        sentences.append(
            "These pages do not show by which rule the RIP fills pixels: several rules fit them equally well."
        )
    more = _stated(tried[best][0], 25400 / dpi)
    return Identified(model=RipModel(fill=fill, **more[0]), sentences=(*sentences, *more[1]))


def identified_from_edges(inks: Sequence[InkEdges | None], pixel_um: float) -> Identified:
    """Identify growth and residual from edges of scans, whose offset is registration's own."""
    fields, sentences = _stated(inks, pixel_um)
    return Identified(model=RipModel(**fields), sentences=tuple(sentences))


def _residual(inks: Sequence[InkEdges | None]) -> float:
    """Return how far edges lie off in all, growth included: a rule that needs none explains more. [pixels]"""
    identified = [one for one in inks if one is not None]
    if not identified:
        return 0.0
    tiles = np.array([one.tiles for one in identified], float)
    squares = [one.edge_sd**2 + one.growth_pixels**2 for one in identified]
    return float(np.sqrt(np.average(squares, weights=tiles)))


def _stated(inks: Sequence[InkEdges | None], pixel_um: float) -> tuple[dict[str, Any], list[str]]:
    """Return fields of ``RipModel``, and sentences of what was found of each ink."""
    identified = {ink: one for ink, one in enumerate(inks) if one is not None}
    sentences = [
        f"{INK_NAMES[ink].capitalize()} has no edges that show its growth: it is assumed to be 0, within a pixel."
        for ink in range(INKS)
        if ink not in identified
    ]
    if not identified:
        return {}, sentences
    growth, sd = [0.0] * INKS, [pixel_um / 12**0.5] * INKS
    for ink, one in identified.items():
        measured, sd[ink] = pixel_um * one.growth_pixels, pixel_um * one.growth_sd
        is_drawn = abs(one.growth_pixels) > max(SURE * one.growth_sd, LEAST_GROWTH)
        growth[ink] = measured if is_drawn else 0.0
        verb = "grows" if measured >= 0 else "shrinks"
        sentences.append(
            f"{INK_NAMES[ink].capitalize()} {verb} by {abs(measured):.1f} um (standard error {sd[ink]:.1f}"
            f"{'' if is_drawn else ', too little to be drawn'}), and "
            f"its edges are within {pixel_um * one.edge_sd:.1f} um (standard deviation, of {one.tiles} places)."
        )
    # Letters, which a RIP may fit to its pixels, are of one ink, and lie less surely than the shapes of the others.
    edge = max(one.edge_sd for one in identified.values())
    fields: dict[str, Any] = {
        "growth_um": tuple(round(one, 2) for one in growth),
        "growth_sd_um": tuple(round(one, 2) for one in sd),
        "edge_sd_um": round(pixel_um * edge, 2),
    }
    return fields, sentences


def test_pdf() -> bytes:
    """Return the page as a PDF."""
    paints = []
    for ink in range(INKS):
        top = SIDE_POINTS[1] - 14 - 74 * ink
        paints.append(_colour(ink, 1.0))
        for row in range(SQUARES[1]):
            for column in range(SQUARES[0]):
                x = 12.31 + PITCH_POINTS * column + STAGGER_POINTS * row
                y = top - 25.43 * row - SQUARE_POINTS - STAGGER_POINTS * column
                paints.append(
                    f"{x:.3f} {y:.3f} {SQUARE_POINTS + 0.037 * column:.3f} {SQUARE_POINTS + 0.029 * column:.3f} re f"
                )
                # A triangle beside it, whose edges cut pixels at all angles.
                paints.append(
                    f"{x + 13:.3f} {y:.3f} m {x + 22:.3f} {y + 3.1:.3f} l {x + 15:.3f} {y + 11:.3f} l f"
                )
        for line, width in enumerate(HAIRLINES_POINTS):
            x, y = 222.3 + 7.77 * line, top - 36
            paints.append(f"{width:g} w {x:.3f} {y:.3f} m {x:.3f} {y + 36:.3f} l S")
            paints.append(f"{264.0:.3f} {y + 7.13 * line:.3f} m {300.0:.3f} {y + 7.13 * line:.3f} l S")
        for patch, tint in enumerate(TINTS):
            paints += [_colour(ink, tint), f"{308 + 18 * patch} {top - 36} 16 36 re f"]
    content = "\n".join(paints).encode()
    return _document(content)


def _colour(ink: int, amount: float) -> str:
    amounts = ["0"] * INKS
    amounts[ink] = f"{amount:g}"
    return f"{' '.join(amounts)} k {' '.join(amounts)} K"


def _document(content: bytes) -> bytes:
    width, height = SIDE_POINTS
    page = f"<</Type/Page/Parent 2 0 R/Contents 4 0 R/Resources<<>>/MediaBox[0 0 {width:g} {height:g}]>>"
    return pdf_of(
        [
            b"<</Type/Catalog/Pages 2 0 R>>",
            b"<</Type/Pages/Kids[3 0 R]/Count 1>>",
            page.encode(),
            b"<</Length %d>>stream\n%s\nendstream" % (len(content), content),
        ]
    )


def identified_from_scans(inspected: Iterable[tuple[Page, Inspection]], press: Press) -> Identified:
    """Identify growth and residual of each ink from good pages of a press, as they enter it, and their inspections.

    What a day's dot gain adds to edges is part of the growth, and what its prints scatter by is part of the residual.
    ScanError: none of the scans could be placed.
    """
    expected: list[list[NDArray[np.float32]]] = [[] for _ in range(INKS)]
    seen: list[list[NDArray[np.float32]]] = [[] for _ in range(INKS)]
    alone: list[list[NDArray[np.bool_]]] = [[] for _ in range(INKS)]
    unplaced: list[Verdict] = []
    press_context, white = press.press_context(), press.sensors[0].white_dn
    for page, inspection in inspected:
        if inspection.verdict.shift_mm is None:
            unplaced.append(inspection.verdict)
            continue
        all_inks = inspection.expect().expected_dn[0]
        measured = inspection.measured_dn[0].astype(np.float32)
        for ink in range(INKS):
            if not page.cmyk[..., ink].any():
                continue
            single = np.zeros_like(page.cmyk)
            single[..., ink] = page.cmyk[..., ink]
            prediction = press_context.predict(replace(page, cmyk=single), inspection.placement)
            only = prediction.expected_dn[0][inspection.area]
            expected[ink].append(-all_inks)
            seen[ink].append(-measured)
            alone[ink].append(np.abs(only - all_inks) < ALONE * white)
    if unplaced and not any(expected):
        first = unplaced[0]
        what = "could not be placed" + f": {first.reason}" * bool(first.reason)
        raise ScanError(
            first.page, what, remedy="give scans of good prints of the job, by this press's camera"
        )
    levels = press.sensors[0].mean_dn
    inks = []
    for ink in range(INKS):
        solid = tuple(levels.shape[0] - 1 if other == ink else 0 for other in range(INKS))
        span = float(levels[0, 0, 0, 0] - levels[solid])
        inks.append(
            ink_edges(
                expected[ink],
                seen[ink],
                span=span,
                half=HALF_OF_SCANS,
                alone=alone[ink],
                cell_tiles=CELL_TILES,
            )
        )
    return identified_from_edges(inks, 1e3 * press.geometry.pixel_pitch_mm)

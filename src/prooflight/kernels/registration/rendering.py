"""Compiled rendering of tiles at the camera's pixels, and of their derivatives by the page's displacement.

A camera pixel's phase among raster pixels changes from line to line and from column to column. Raster rows are first
summed up for eight lines, whose weights are each a line's own, and the sums are turned in registers so that eight lines
are adjacent; raster columns are then summed up with weights that are each a column's own.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from prooflight.kernels.compiled import inner_kernel
from prooflight.kernels.planes import any_differ, composed_recipes, recipes_at
from prooflight.kernels.vectors import (
    INT,
    LONG,
    Group,
    fetch_nearby,
    filled,
    number_at,
    sums_of_lines,
    vector_at,
)

EIGHT = 8
SIXTEEN = 2 * EIGHT
"""Raster columns that are summed up at once: a weight that is read is used for all of them."""
_NEIGHBOURS = ([0, 8, 1, 9, 4, 12, 5, 13], [2, 10, 3, 11, 6, 14, 7, 15])
_PAIRS = ([0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15])
_HALVES = ([0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15])
_ORDER = (0, 2, 1, 3, 4, 6, 5, 7)
"""Three rounds of shuffles of two vectors that turn eight rows into columns, each one instruction; their order then."""


def _turned(groups: list[Group]) -> list[Group]:
    """Return eight groups of eight with rows as columns."""
    for places, step in ((_NEIGHBOURS, 1), (_PAIRS, 2), (_HALVES, 4)):
        turned = list(groups)
        for at in range(EIGHT):
            if at & step:
                continue
            for half, target in zip(places, (at, at + step), strict=True):
                mask = ir.Constant(ir.VectorType(INT, EIGHT), half)
                builder, one, other = groups[at].builder, groups[at].value, groups[at + step].value
                turned[target] = Group(builder, builder.shuffle_vector(one, other, mask))
        groups = turned
    return [groups[at] for at in _ORDER]


class _Array:
    """Contiguous array of an intrinsic's argument, by places in its memory; its rows' length, and how many they are."""

    def __init__(self, context: Any, builder: Any, kind: Any, array: Any) -> None:
        whole = make_array(kind)(context, builder, array)
        self.builder, self.data = builder, whole.data
        shape = cgutils.unpack_tuple(builder, whole.shape)
        self.length, self.lines = shape[-1], shape[-2:][0]

    def number(self, place: Any) -> Any:
        return self.builder.load(number_at(self.builder, self.data, place))

    def group(self, place: Any) -> Group:
        """Return eight numbers from one on."""
        eight = self.builder.load(vector_at(self.builder, self.data, place, EIGHT), align=4)
        return Group(self.builder, eight)

    def repeated(self, place: Any) -> Group:
        """Return eight times a number."""
        return Group(self.builder, filled(self.builder, self.number(place), EIGHT))

    def store(self, place: Any, group: Group) -> None:
        self.builder.store(group.value, vector_at(self.builder, self.data, place, EIGHT), align=4)


@intrinsic
def sum_rows(context, window, column, starts, places, line, table, slopes, values, tilts):  # type: ignore[no-untyped-def]
    """Sum up raster rows for sixteen columns of eight lines, from ``column`` and ``line`` on.

    window (rows, pixels); starts, places (lines,): of ``place_taps``; table, slopes (phases, taps). Written are values,
    tilts (pixels, 8): at [column + i, n] the sums over taps of the weights of line ``line + n``, and of their slopes.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        window, starts, places, table, slopes, *targets = (
            _Array(context, builder, signature.args[n], args[n]) for n in (0, 2, 3, 5, 6, 7, 8)
        )
        column, line = args[1], args[4]
        blocks: list[list[Group]] = [[] for _ in range(4)]
        for n in range(EIGHT):
            here = builder.add(line, ir.Constant(LONG, n))
            begin, first = builder.add(starts.number(here), column), places.number(here)

            def terms(k: Any, begin: Any = begin, first: Any = first) -> list[Group]:
                place = builder.add(begin, builder.mul(k, window.length))
                seen = [window.group(place), window.group(builder.add(place, ir.Constant(LONG, EIGHT)))]
                weights = [of.repeated(builder.add(first, k)) for of in (table, slopes)]
                return [weight * half for weight in weights for half in seen]

            sums = sums_of_lines(builder, ir.Constant(LONG, 0), table.length, terms, 4, EIGHT)
            for block, group in zip(blocks, sums, strict=True):
                block.append(group)
        for n, block in enumerate(blocks):
            for i, group in enumerate(_turned(block)):
                at = builder.add(column, ir.Constant(LONG, EIGHT * (n % 2) + i))
                targets[n // 2].store(builder.mul(at, ir.Constant(LONG, EIGHT)), group)
        return context.get_dummy_value()

    whole = types.int64
    return types.void(window, whole, starts, places, whole, table, slopes, values, tilts), generate


@intrinsic
def sum_columns(context, values, tilts, starts, places, column, table, slopes, out, line):  # type: ignore[no-untyped-def]
    """Sum up what ``sum_rows`` has written for eight columns of eight lines, from ``column`` and ``line`` on.

    starts, places (columns,): of ``place_taps``; table, slopes (phases, taps). Written is out (3, lines, columns): the
    sums over taps of weights by values, slopes by values, weights by tilts.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        values, tilts, starts, places, table, slopes, out = (
            _Array(context, builder, signature.args[n], args[n]) for n in (0, 1, 2, 3, 5, 6, 7)
        )
        column, line = args[4], args[8]
        blocks: list[list[Group]] = [[] for _ in range(3)]
        for i in range(EIGHT):
            here = builder.add(column, ir.Constant(LONG, i))
            begin, first = starts.number(here), places.number(here)

            def terms(k: Any, begin: Any = begin, first: Any = first) -> list[Group]:
                place = builder.add(begin, builder.mul(k, ir.Constant(LONG, EIGHT)))
                value, tilt = values.group(place), tilts.group(place)
                weight, slope = (of.repeated(builder.add(first, k)) for of in (table, slopes))
                return [weight * value, slope * value, weight * tilt]

            sums = sums_of_lines(builder, ir.Constant(LONG, 0), table.length, terms, 3, EIGHT)
            for block, group in zip(blocks, sums, strict=True):
                block.append(group)
        for n, block in enumerate(blocks):
            for i, group in enumerate(_turned(block)):
                of_image = builder.mul(out.lines, ir.Constant(LONG, n))
                row = builder.add(builder.add(of_image, line), ir.Constant(LONG, i))
                out.store(builder.add(builder.mul(row, out.length), column), group)
        return context.get_dummy_value()

    whole = types.int64
    return types.void(values, tilts, starts, places, whole, table, slopes, out, whole), generate


@inner_kernel(error_model="numpy", forceinline=True)
def place_taps(begin, ratio, table, pitch, starts, places):  # type: ignore[no-untyped-def]
    """Compute where each camera pixel's raster pixels and weights begin: starts, places (pixels,).

    begin: raster coordinate of the first one's centre less the footprint's reach; ratio: raster pixels per camera
    pixel; table (phases, taps): weights; starts are in steps of ``pitch``.
    """
    phases, count = table.shape
    for i in range(starts.size):
        at = begin + i * ratio
        first = int(at)
        starts[i] = first * pitch
        places[i] = int((at - first) * phases) * count


@inner_kernel(error_model="numpy", forceinline=True)
def render_tile(window, x, y, taps, workspace, out, ahead=None):  # type: ignore[no-untyped-def]
    """Render one tile at the camera's pixels and its derivatives by the page's displacement: out (3, lines, columns).

    x, y: raster coordinates, in the window, of the first camera pixel's centre, less the footprint's reach.
    Window rows are whole multiples of 16 long, out's lines of 8, and these of 8 in number. taps: ``SensorTaps``;
    workspace: ``Workspace``. ahead: the window that is rendered next, which is fetched from memory meanwhile, in pieces
    that the processor can wait for; None: it is in the cache.
    """
    lines, columns = out.shape[1:]
    value, tilt = workspace.value, workspace.tilt
    line_starts, line_places = workspace.lines[0, :lines], workspace.lines[1, :lines]
    starts, places = workspace.columns[0, :columns], workspace.columns[1, :columns]
    place_taps(y, taps.along_ratio, taps.along, window.shape[1], line_starts, line_places)
    place_taps(x, taps.across_ratio, taps.across, EIGHT, starts, places)
    first, last = starts[0] // EIGHT // SIXTEEN * SIXTEEN, starts[columns - 1] // EIGHT + taps.across.shape[1]
    fetched, pieces = 0, lines // EIGHT * ((last - first + SIXTEEN - 1) // SIXTEEN)
    piece = (window.size + pieces - 1) // pieces
    for line in range(0, lines, EIGHT):
        for k in range(first, last, SIXTEEN):
            if ahead is not None:
                fetch_nearby(ahead, fetched, fetched + piece)
                fetched += piece
            sum_rows(window, k, line_starts, line_places, line, taps.along, taps.along_slope, value, tilt)
        for column in range(0, columns, EIGHT):
            sum_columns(value, tilt, starts, places, column, taps.across, taps.across_slope, out, line)


@intrinsic
def displace_eight(context, packed, c, m, y, k, seen, at):  # type: ignore[no-untyped-def]
    """Put eight recipes together from inks at four places: seen[at:at + 8]; return whether any changes.

    packed, seen: uint32, with cyan lowest; places are in their memory.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        packed, seen = (make_array(signature.args[n])(context, builder, args[n]).data for n in (0, 5))
        recipes, target = (
            composed_recipes(builder, packed, args[1:5], EIGHT),
            recipes_at(builder, seen, args[6], EIGHT),
        )
        differs = any_differ(builder, recipes, builder.load(target, align=4))
        builder.store(recipes, target, align=4)
        return differs

    whole = types.int64
    return types.boolean(packed, whole, whole, whole, whole, seen, whole), generate

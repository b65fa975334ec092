"""Separation and DeviceN spaces (ISO 32000-2, 8.6.6.4 and 8.6.6.5): how a press of four inks prints each colorant.

Process inks are printed as themselves, All on each of them, None on none. A spot colour has a plate of its own, so that
overprint leaves it alone, and is printed by its tint transform, or by what the press's own unit of that ink prints. A
DeviceN space of other colorants than those of the press is painted in its alternate space, by the tint transform of all
its components, unless it is an NChannel space.

MuPDF finds plates by the names of colorants, whatever their transforms are. So colorants are renamed in memory: a spot
colour to the name of its plate, and those of a space that is painted in its alternate to names of no plate.

Imported late, by ``document`` and what it uses only: it needs PyMuPDF at import.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray
from pymupdf import _mupdf, mupdf

from prooflight.pages.pdf.resources import entries, get, items, name_of, shown_name

if TYPE_CHECKING:
    from prooflight.pages.pdf.colour_management import Inks
    from prooflight.pages.spots.spot_ink import SpotPrint

COLOURS_MAX: Final = 32
"""MuPDF's FZ_MAX_COLORS."""
PROCESS: Final = ("Cyan", "Magenta", "Yellow", "Black")
_PLATE, _MIXTURE = "plate ", "mixture "
_PROBES: Final = np.array([[0.0], [0.25], [0.5], [0.75], [1.0]])
"""Tints at which two Separations of one name are compared."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TintTransform:
    """Transform from tints to colours of an alternate space."""

    name: str
    """Name of the colorant in the file, or of the first of several."""
    inputs: int
    alternate: Any
    """Alternate space, a ``mupdf.FzColorspace``."""
    function: Any
    """Function of the transform, a ``mupdf.PdfFunction``."""

    def alternate_colours(self, tints: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return colours (colours, outputs) of tints (colours, inputs)."""
        outputs = mupdf.fz_colorspace_n(self.alternate)
        colour, out = mupdf.new_floats(COLOURS_MAX), mupdf.new_floats(COLOURS_MAX)
        converted = np.empty((len(tints), outputs))
        for row, tint in zip(converted, tints.tolist(), strict=True):
            for i, amount in enumerate(tint):
                mupdf.floats_setitem(colour, i, amount)
            # Not mupdf's: there, the result has room for one number.
            _mupdf.ll_pdf_eval_function(self.function.m_internal, colour, self.inputs, out, outputs)
            row[:] = [mupdf.floats_getitem(out, i) for i in range(outputs)]
        mupdf.delete_floats(colour)
        mupdf.delete_floats(out)
        return converted

    def ink_amounts(self, tints: NDArray[np.float64], inks: Inks, parameters: Any) -> NDArray[np.float64]:
        """Return ink amounts 0..1 (colours, 4) of tints (colours, inputs); ``parameters`` are MuPDF's, with
        the intent.
        """
        return inks.amounts(self.alternate.m_internal, self.alternate_colours(tints), parameters)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UnitTint:
    """Tints of a spot ink that the press prints by a unit of its own, whatever the file's transform of it is."""

    printed: SpotPrint

    def ink_amounts(self, tints: NDArray[np.float64], _inks: Inks, _parameters: Any) -> NDArray[np.float64]:
        """Return ink amounts 0..1 (colours, 4) of tints (colours, 1)."""
        return self.printed.cmyk(tints[:, 0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TintUse:
    """Painting of a space; by default each of its colorants is a process ink."""

    leaves_no_mark: bool = False
    is_all: bool = False
    plates: tuple[str, ...] = ()
    mixture: TintTransform | None = None


@dataclass(slots=True, kw_only=True)
class Tinted:
    """Plates of the tint spaces that a page names; false if it names no such space."""

    plates: set[str] = field(default_factory=set)
    any_space: bool = False

    def __bool__(self) -> bool:
        return self.any_space


class TintSpaces:
    """Tint spaces that a file's pages have used so far."""

    def __init__(self, spots: Sequence[SpotPrint] = ()) -> None:
        """Prepare; ``spots`` are inks of the press's own, which are printed on their plates in every space."""
        self._plates: dict[tuple[Any, ...], str] = {}
        self._transforms: dict[str, TintTransform] = {}
        self._units = {spot.name: spot for spot in spots if spot.mixture}
        self._unit_tints: dict[str, UnitTint] = {}

    def rename(self, space: Any, listed: Tinted) -> None:
        """Rename the colorants of all tint spaces within a colour space (``mupdf.PdfObj``), and list them."""
        for array in tint_arrays(space):
            listed.any_space = True
            with contextlib.suppress(Exception):  # a broken one, in which nothing can be painted
                listed.plates |= self._renamed(array)

    def plate(self, name: str) -> TintTransform | UnitTint:
        """Return the transform of a plate."""
        return self._unit_tints.get(name) or self._transforms[name]

    def use(self, space: Any) -> TintUse:
        """Return how a Separation or DeviceN space of MuPDF (low level) is painted."""
        colorants = _colorants(space)
        if all(name == "None" for name in colorants):
            return TintUse(leaves_no_mark=True)
        plates = tuple(name for name in colorants if name.startswith(_PLATE))
        mixture = self._transforms.get(colorants[0]) if colorants[0].startswith(_MIXTURE) else None
        return TintUse(is_all=colorants == ["All"], plates=plates, mixture=mixture)

    def _renamed(self, array: Any) -> set[str]:
        given = mupdf.pdf_array_get(array, 1)
        colorants = [name_of(one) for one in items(given)] or [name_of(given)]
        if colorants[0] in self._transforms or any(name in self._unit_tints for name in colorants):
            return {name for name in colorants if name.startswith(_PLATE)}
        if all(name in (*PROCESS, "None") for name in colorants) or colorants == ["All"]:
            return set()
        new = self._printed_by_units(colorants)
        if not new:
            own = _transform(array, colorants)
            is_spot = len(colorants) == 1
            new = [self._plate_of(own)] if is_spot else self._channels(array, colorants) or self._mixed(own)
        if mupdf.pdf_is_array(given):
            listed = mupdf.pdf_new_array(mupdf.pdf_get_bound_document(array), len(new))
            for name in new:
                mupdf.pdf_array_push(listed, mupdf.pdf_new_name(name))
            mupdf.pdf_array_put(array, 1, listed)
        else:
            mupdf.pdf_array_put(array, 1, mupdf.pdf_new_name(new[0]))
        return {name for name in new if name.startswith(_PLATE)}

    def _printed_by_units(self, colorants: list[str]) -> list[str]:
        """Return plates and inks of a space whose colorants the press all has, a spot ink among them, else none."""
        names = [shown_name(name) for name in colorants]
        if not all(name in self._units or name in (*PROCESS, "None") for name in names):
            return []
        return [self._unit_plate(name) if name in self._units else name for name in names]

    def _unit_plate(self, name: str) -> str:
        key = (name,)
        if key not in self._plates:
            plate = f"{_PLATE}{len(self._plates) + 1}"
            self._plates[key], self._unit_tints[plate] = plate, UnitTint(printed=self._units[name])
        return self._plates[key]

    def _plate_of(self, transform: TintTransform) -> str:
        """Return the plate of a spot colour, the same for all of one name and one transform."""
        colours = transform.alternate_colours(_PROBES).round(4)
        space = transform.alternate.m_internal
        key = transform.name, space.type, space.n, colours.tobytes()
        if key not in self._plates:
            name = f"{_PLATE}{len(self._plates) + 1}"
            self._plates[key], self._transforms[name] = name, transform
        return self._plates[key]

    def _mixed(self, transform: TintTransform) -> list[str]:
        number = len(self._transforms) + 1
        new = [f"{_MIXTURE}{number} {i + 1}" for i in range(transform.inputs)]
        self._transforms[new[0]] = transform
        return new

    def _channels(self, array: Any, colorants: list[str]) -> list[str]:
        """Return plates and inks of an NChannel space that defines the print of each of its spot colours, else none."""
        attributes = mupdf.pdf_array_get(array, 4)
        if name_of(get(attributes, "Subtype")) != "NChannel":
            return []
        inks = {ink: ink for ink in (*PROCESS, "None")} | _process_inks(get(attributes, "Process"))
        own = {name_of(key): array for key, array in entries(get(attributes, "Colorants"))}
        new = []
        for name in colorants:
            if name in own and name not in inks:
                self._renamed(own[name])
                new.append(name_of(mupdf.pdf_array_get(own[name], 1)))
            else:
                new.append(inks.get(name, ""))
        return new if all(new) else []


def _process_inks(process: Any) -> dict[str, str]:
    """Return the process inks of an NChannel space by the names of its components."""
    components = [name_of(one) for one in items(get(process, "Components"))]
    if len(components) != len(PROCESS):
        return {}
    space = mupdf.pdf_load_colorspace(get(process, "ColorSpace"))
    return dict(zip(components, PROCESS, strict=True)) if mupdf.fz_colorspace_is_cmyk(space) else {}


def _colorants(space: Any) -> list[str]:
    """Return the names of a space's colorants (low level); one that is no text makes them unknown."""
    names = []
    for i in range(space.n):
        with contextlib.suppress(UnicodeDecodeError):
            names.append(str(mupdf.ll_fz_colorspace_colorant(space, i)))
    return names if len(names) == space.n else [""]


def _transform(array: Any, colorants: list[str]) -> TintTransform:
    alternate = mupdf.pdf_load_colorspace(mupdf.pdf_array_get(array, 2))
    outputs = mupdf.fz_colorspace_n(alternate)
    function = mupdf.pdf_load_function(mupdf.pdf_array_get(array, 3), len(colorants), outputs)
    return TintTransform(name=colorants[0], inputs=len(colorants), alternate=alternate, function=function)


def tint_arrays(space: Any) -> Iterator[Any]:
    """Yield the Separation or DeviceN array that a colour space is, or is based on."""
    for _ in range(8):  # Indexed and Pattern spaces have a base; a cycle of them is none
        kind = name_of(mupdf.pdf_array_get(space, 0)) if mupdf.pdf_is_array(space) else ""
        if kind in ("Separation", "DeviceN"):
            yield space
        if kind not in ("Indexed", "I", "Pattern"):
            return
        space = mupdf.pdf_array_get(space, 1)
